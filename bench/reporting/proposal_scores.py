"""Proposals against annotations for people: a table for the terminal, and a page with its files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import pandas as pd

from bench.reporting import document
from bench.reporting.document import Bar, Block, Cell, Column, Heading, Paragraph, Table
from bench.reporting.formats import write_texts

NAME = "evaluate"
HEADINGS = {
    "range": "range",
    "group": "group",
    "object_frames": "object-frames",
    "recall": "recall, %",
    "precision": "precision, %",
    "switches": "switches",
    "false_tracks_per_minute": "false tracks a minute",
    "speed_error_median": "speed error, m/s",
    "speed_error_p90": "p90",
    "centre_error_median": "centre error, m",
    "centre_error_p90": "p90",
}
HOW = (
    "An object-frame is an annotated object that moves, in a sweep, with 10 returns or more. A proposal finds it where "
    "the returns in both boxes have an IoU of at least 0.5; a second proposal for one object is false. What a reviewer "
    "rejected is left out, and corrections count. Proposals at rest and unclear objects are neither right nor wrong.",
    "A switch is a change from one proposal to another on one object. A track is false with more false object-frames "
    "than others. Errors are of object-frames that were found, median and 90th percentile: of the velocity, and of the "
    "box's centre seen from above. n/a: nothing to count.",
)
SHARES = ("recall", "precision")


def scores_table(scores: pd.DataFrame, minutes: float) -> Table:
    """The scores as a table for the terminal: percent, m/s and m.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
    """
    note = f"Found: IoU of returns of at least 0.5; of {60 * minutes:.0f} s. Errors: medians and 90th percentiles."
    return Table(columns=_columns(HEADINGS), rows=scores[[*HEADINGS]], words=2, note=note)


def report(scores: pd.DataFrame, minutes: float, *, recordings: Sequence[str]) -> list[Block]:
    """A table for each range, and how to read them.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        recordings: that were compared.
    """
    count = f"{len(recordings)} recordings" if len(recordings) > 1 else f"1 recording, {recordings[0]}"
    blocks: list[Block] = [Paragraph(f"{count}, {60 * minutes:.0f} s of sweeps.")]
    names = [name for name in HEADINGS if name != "range"]
    for label, rows in scores.groupby("range", sort=False):
        title = "At any range" if label == "all" else f"Nearer than {str(label).removeprefix('< ')}"
        table = [
            [_share(value) if name in SHARES else value for name, value in zip(names, row, strict=True)]
            for row in rows[names].itertuples(index=False)
        ]
        blocks.append(Table(title=title, columns=_columns(names), rows=table, look="metrics"))
    return [*blocks, Heading("How to read it"), *map(Paragraph, HOW)]


def write_proposal_scores(
    out: Path, scores: pd.DataFrame, minutes: float, *, dataset: str, recordings: Sequence[str]
) -> tuple[Path, ...]:
    """Write `evaluate.html`, `.md` and `.csv`, each whole or not at all; their paths.

    Args:
        out: folder, is made.
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    title, blocks = f"Proposals of {dataset} against its annotations", report(scores, minutes, recordings=recordings)
    return write_texts(
        out,
        {
            f"{NAME}.html": document.to_page(title, blocks, folder=out),
            f"{NAME}.md": document.to_markdown([Heading(title, 1), *blocks]),
            f"{NAME}.csv": scores.to_csv(index=False, lineterminator="\n"),
        },
    )


def _columns(names: Iterable[str]) -> list[Column]:
    forms = {**dict.fromkeys(SHARES, _percent), "false_tracks_per_minute": _number("{:.1f}")}
    forms |= {name: _number("{:.2f}") for name in HEADINGS if "_error_" in name}
    return [Column(HEADINGS[name], forms.get(name, str)) for name in names]


def _number(form: str) -> Callable[[float], str]:
    return lambda value: "n/a" if pd.isna(value) else form.format(value)


def _percent(share: float) -> str:
    return _number("{:.1f}")(100 * share)


def _share(value: float) -> Cell:
    return Cell(_percent(value), bar=None if pd.isna(value) else Bar(share=value))

"""Proposals against annotations for people: a table for the terminal, and a page with its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from bench.reporting.document import Bar, Block, Cell, Column, Heading, Heads, Paragraph, Report, Table


def _number(form: str) -> Callable[[float], str]:
    return lambda value: "n/a" if pd.isna(value) else form.format(value)


def _percent(share: float) -> str:
    return _number("{:.1f}")(100 * share)


def _share(value: float) -> Cell:
    return Cell(_percent(value), bar=None if pd.isna(value) else Bar(share=value))


COLUMNS: dict[str, Heads] = {
    "range": "range",
    "group": "group",
    "object_frames": "object-frames",
    "recall": Column("recall, %", _percent),
    "precision": Column("precision, %", _percent),
    "switches": "switches",
    "false_tracks_per_minute": Column("false tracks a minute", _number("{:.1f}")),
    "speed_error_median": Column("speed error, m/s", _number("{:.2f}")),
    "speed_error_p90": Column("p90", _number("{:.2f}")),
    "centre_error_median": Column("centre error, m", _number("{:.2f}")),
    "centre_error_p90": Column("p90", _number("{:.2f}")),
}
WITH_BARS: dict[str, Heads] = {"recall": Column("recall, %", _share), "precision": Column("precision, %", _share)}
HOW = (
    "An object-frame is an annotated object that moves, in a sweep, with 10 returns or more. A proposal finds it where "
    "the returns in both boxes have an IoU of at least 0.5; a second proposal for one object is false. What a reviewer "
    "rejected is left out, and corrections count. Proposals at rest and unclear objects are neither right nor wrong.",
    "A switch is a change from one proposal to another on one object. A track is false with more false object-frames "
    "than others. Errors are of object-frames that were found, median and 90th percentile: of the velocity, and of the "
    "box's centre seen from above. n/a: nothing to count.",
)


def scores_table(scores: pd.DataFrame, minutes: float) -> Table:
    """The scores as a table for the terminal: percent, m/s and m.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
    """
    note = f"Found: IoU of returns of at least 0.5; of {60 * minutes:.0f} s. Errors: medians and 90th percentiles."
    return Table(columns=COLUMNS, rows=scores, words=2, note=note)


def report(scores: pd.DataFrame, minutes: float, *, dataset: str, recordings: Sequence[str]) -> Report:
    """A table for each range, and how to read them.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        dataset: name of the data set.
        recordings: that were compared.
    """
    count = f"{len(recordings)} recordings" if len(recordings) > 1 else f"1 recording, {recordings[0]}"
    blocks: list[Block] = [Paragraph(f"{count}, {60 * minutes:.0f} s of sweeps.")]
    columns = {name: column for name, column in (COLUMNS | WITH_BARS).items() if name != "range"}
    for label, rows in scores.groupby("range", sort=False):
        title = "At any range" if label == "all" else f"Nearer than {str(label).removeprefix('< ')}"
        blocks.append(Table(title=title, columns=columns, rows=rows, look="metrics"))
    blocks += [Heading("How to read it"), *map(Paragraph, HOW)]
    return Report(title=f"Proposals of {dataset} against its annotations", blocks=blocks, numbers=scores, page=True)


def write_proposal_scores(
    out: Path, scores: pd.DataFrame, minutes: float, *, dataset: str, recordings: Sequence[str]
) -> tuple[Path, ...]:
    """Write `evaluate.html`, `.md` and `.csv`; their paths.

    Args:
        out: folder, is made.
        scores: as all that follow, see `report`.
        minutes: how long the sweeps took.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    return report(scores, minutes, dataset=dataset, recordings=recordings).write(out, "evaluate")

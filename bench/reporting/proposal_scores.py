"""Proposals against annotations for people: a table for the terminal, and a page with its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from bench.atomic import write_text
from bench.reporting.document import Bar, Block, Cell, Column, Heading, Heads, Paragraph, Report, Table


def _number(form: str) -> Callable[[float], str]:
    return lambda value: "n/a" if pd.isna(value) else form.format(value)


def _percent(share: float) -> str:
    return _number("{:.1f}")(100 * share)


def _share(value: float) -> Cell:
    return Cell(_percent(value), bar=None if pd.isna(value) else Bar(share=value))


WHERE: dict[str, Heads] = {"range": "range", "group": "group"}
COUNTS: dict[str, Heads] = {
    "object_frames": "object-frames",
    "recall": Column("recall, %", _percent),
    "precision": Column("precision, %", _percent),
    "switches": "switches",
    "false_tracks_per_minute": Column("false tracks a minute", _number("{:.1f}")),
    "class_right": Column("class right, %", _percent),
}
ERRORS: dict[str, Heads] = {
    "speed_error_median": Column("speed error, m/s", _number("{:.2f}")),
    "speed_error_p90": Column("p90", _number("{:.2f}")),
    "centre_error_median": Column("centre error, m", _number("{:.2f}")),
    "centre_error_p90": Column("p90", _number("{:.2f}")),
    "size_error_median": Column("size error, m", _number("{:.2f}")),
    "size_error_p90": Column("p90", _number("{:.2f}")),
    "yaw_error_deg_median": Column("yaw error, degrees", _number("{:.1f}")),
    "yaw_error_deg_p90": Column("p90", _number("{:.1f}")),
}
COLUMNS = WHERE | COUNTS | ERRORS
WORST: dict[str, Heads] = {"recording": "recording", "track": "track", "wrong": "what is wrong", "frames": "frames"}
MOST_SHOWN = 20  # of the worst tracks
WITH_BARS: dict[str, Heads] = {"recall": Column("recall, %", _share), "precision": Column("precision, %", _share)}
HOW = (
    "An object-frame is an annotated object that moves, in a sweep, with 10 returns or more. A proposal finds it where "
    "the returns in both boxes have an IoU of at least 0.5; a second proposal for one object is false. What a reviewer "
    "rejected is left out, and corrections count. Proposals at rest and unclear objects are neither right nor wrong.",
    "A switch is a change from one proposal to another on one object. A track is false with more false object-frames "
    "than others. Class right: of object-frames that were found. Errors are of the same, median and 90th percentile: "
    "of the velocity, of the box's centre seen from above, of its size (the largest difference of length, width and "
    "height) and of its heading, from 0 to 180 degrees. n/a: nothing to count.",
    "The worst tracks are those with the most object-frames that are missed, false, of another class, or whose box has "
    "a side that is off by more than 1 m or a heading that is off by more than 20 degrees. evaluate-tracks.csv has "
    "them all. What is false is named as proposed, all else as annotated.",
)


def scores_tables(scores: pd.DataFrame, minutes: float, worst: pd.DataFrame) -> list[Table]:
    """Everything as tables for the terminal: percent, m/s, m and degrees.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        worst: see `bench.annotation.worst_tracks`.
    """
    found = f"Found: IoU of returns of at least 0.5; of {60 * minutes:.0f} s."
    return [
        Table(columns=WHERE | COUNTS, rows=scores, words=2, note=found),
        Table(columns=WHERE | ERRORS, rows=scores, words=2, note="Errors: medians and 90th percentiles."),
        *_worst(worst),
    ]


def _worst(worst: pd.DataFrame) -> list[Table]:
    """A table of the worst tracks, where there are any."""
    more = len(worst) - MOST_SHOWN
    note = f"{more} more are in evaluate-tracks.csv." if more > 0 else ""
    rows = worst.head(MOST_SHOWN)
    return [Table(title="The worst tracks", columns=WORST, rows=rows, words=3, note=note)] if len(rows) else []


def report(
    scores: pd.DataFrame,
    minutes: float,
    *,
    worst: pd.DataFrame,
    dataset: str,
    recordings: Sequence[str],
) -> Report:
    """A table for each range, of the worst tracks, and how to read them.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        worst: see `bench.annotation.worst_tracks`.
        dataset: name of the data set.
        recordings: that were compared.
    """
    count = f"{len(recordings)} recordings" if len(recordings) > 1 else f"1 recording, {recordings[0]}"
    blocks: list[Block] = [Paragraph(f"{count}, {60 * minutes:.0f} s of sweeps.")]
    columns = {name: column for name, column in (COLUMNS | WITH_BARS).items() if name != "range"}
    for label, rows in scores.groupby("range", sort=False):
        title = "At any range" if label == "all" else f"Nearer than {str(label).removeprefix('< ')}"
        blocks.append(Table(title=title, columns=columns, rows=rows, look="metrics"))
    blocks += [*_worst(worst), Heading("How to read it"), *map(Paragraph, HOW)]
    return Report(title=f"Proposals of {dataset} against its annotations", blocks=blocks, numbers=scores, page=True)


def write_proposal_scores(
    out: Path,
    scores: pd.DataFrame,
    minutes: float,
    *,
    worst: pd.DataFrame,
    dataset: str,
    recordings: Sequence[str],
) -> tuple[Path, ...]:
    """Write `evaluate.html`, `.md` and `.csv`, and `evaluate-tracks.csv`; their paths.

    Args:
        out: folder, is made.
        scores: as all that follow, see `report`.
        minutes: how long the sweeps took.
        worst: all tracks with which something is wrong.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    told = report(scores, minutes, worst=worst, dataset=dataset, recordings=recordings)
    tracks = out / "evaluate-tracks.csv"
    files = told.write(out, "evaluate")
    write_text(tracks, worst.to_csv(index=False))
    return *files, tracks

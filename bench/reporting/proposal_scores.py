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


def scores_tables(scores: pd.DataFrame, minutes: float, confusion: pd.DataFrame, worst: pd.DataFrame) -> list[Table]:
    """Everything as tables for the terminal: percent, m/s, m and degrees.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        confusion: see `bench.annotation.class_confusion`.
        worst: see `bench.annotation.worst_tracks`.
    """
    found = f"Found: IoU of returns of at least 0.5; of {60 * minutes:.0f} s."
    return [
        Table(columns=WHERE | COUNTS, rows=scores, words=2, note=found),
        Table(columns=WHERE | ERRORS, rows=scores, words=2, note="Errors: medians and 90th percentiles."),
        *_details(confusion, worst),
    ]


def _details(confusion: pd.DataFrame, worst: pd.DataFrame) -> list[Table]:
    """Tables of classes and of the worst tracks, where there are any."""
    names = [str(name) for name in confusion.columns]
    classes = Table(
        title="Object-frames that were found, by annotated and proposed class",
        columns=["annotated", *(f"as {name}" for name in names)],
        rows=[[str(name), *map(int, row)] for name, row in zip(confusion.index, confusion.to_numpy(), strict=True)],
    )
    more = len(worst) - MOST_SHOWN
    tracks = Table(
        title="The worst tracks",
        columns=WORST,
        rows=worst.head(MOST_SHOWN),
        words=3,
        note=f"{more} more are in evaluate-tracks.csv." if more > 0 else "",
    )
    return [table for table in (classes, tracks) if len(table.rows)]


def report(
    scores: pd.DataFrame,
    minutes: float,
    *,
    confusion: pd.DataFrame,
    worst: pd.DataFrame,
    dataset: str,
    recordings: Sequence[str],
) -> Report:
    """A table for each range, of classes and of the worst tracks, and how to read them.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        confusion: see `bench.annotation.class_confusion`.
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
    blocks += [*_details(confusion, worst), Heading("How to read it"), *map(Paragraph, HOW)]
    return Report(title=f"Proposals of {dataset} against its annotations", blocks=blocks, numbers=scores, page=True)


def write_proposal_scores(
    out: Path,
    scores: pd.DataFrame,
    minutes: float,
    *,
    confusion: pd.DataFrame,
    worst: pd.DataFrame,
    dataset: str,
    recordings: Sequence[str],
) -> tuple[Path, ...]:
    """Write `evaluate.html`, `.md` and `.csv`, and `evaluate-tracks.csv`; their paths.

    Args:
        out: folder, is made.
        scores: as all that follow, see `report`.
        minutes: how long the sweeps took.
        confusion: of the classes.
        worst: all tracks with which something is wrong.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    told = report(scores, minutes, confusion=confusion, worst=worst, dataset=dataset, recordings=recordings)
    tracks = out / "evaluate-tracks.csv"
    files = told.write(out, "evaluate")
    write_text(tracks, worst.to_csv(index=False))
    return *files, tracks

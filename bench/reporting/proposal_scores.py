"""Proposals against annotations for people: tables for the terminal, and a page with its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from bench.atomic import write_text
from bench.reporting.document import Block, Column, Heading, Heads, Paragraph, Report, Table


def _number(digits: int, *, times: float = 1.0) -> Callable[[float], str]:
    return lambda value: "n/a" if pd.isna(value) else f"{times * value:.{digits}f}"


WHERE: dict[str, Heads] = {"range": "range", "group": "group"}
COUNTS: dict[str, Heads] = {
    "object_frames": "object-frames",
    "recall": Column("recall, %", _number(1, times=100)),
    "precision": Column("precision, %", _number(1, times=100)),
    "switches": "switches",
    "false_tracks_per_minute": Column("false tracks a minute", _number(1)),
    "class_right": Column("class right, %", _number(1, times=100)),
}
ERRORS: dict[str, Heads] = {
    f"{error}_{of}": Column(heading, _number(digits))
    for error, name, digits in (
        ("speed_error", "speed error, m/s", 2),
        ("centre_error", "centre error, m", 2),
        ("size_error", "size error, m", 2),
        ("yaw_error_deg", "yaw error, degrees", 1),
    )
    for of, heading in (("median", name), ("p90", "p90"))
}
WORST: dict[str, Heads] = {"recording": "recording", "track": "track", "wrong": "what is wrong", "frames": "frames"}
MOST_SHOWN = 20  # of the worst tracks
HOW = (
    "An object-frame is an annotated object that moves, in a sweep, with 10 returns or more. A proposal finds it where "
    "the returns in both boxes have an IoU of at least 0.5; a second proposal for one object is false. What a reviewer "
    "rejected is left out, and corrections count. Proposals at rest and unclear objects are neither right nor wrong.",
    "A switch is a change from one proposal to another on one object. A track is false with more false object-frames "
    "than others. Class right and errors: of object-frames that were found, median and 90th percentile. n/a: nothing "
    "to count.",
    "The worst tracks are those with the most object-frames that are missed, false, of another class, or whose box is "
    "off by more than 1 m or 20 degrees; evaluate-tracks.csv has them all.",
)


def scores_tables(scores: pd.DataFrame, minutes: float, worst: pd.DataFrame) -> list[Table]:
    """Everything as tables: percent, m/s, m and degrees; that of the worst tracks where there are any.

    Args:
        scores: see `bench.annotation.proposal_scores`.
        minutes: how long the sweeps took.
        worst: see `bench.annotation.worst_tracks`.
    """
    found = f"Found: IoU of returns of at least 0.5; of {60 * minutes:.0f} s."
    more = len(worst) - MOST_SHOWN
    note = f"{more} more are in evaluate-tracks.csv." if more > 0 else ""
    tracks = Table(title="The worst tracks", columns=WORST, rows=worst.head(MOST_SHOWN), words=3, note=note)
    return [
        Table(columns=WHERE | COUNTS, rows=scores, words=2, note=found),
        Table(columns=WHERE | ERRORS, rows=scores, words=2, note="Errors: medians and 90th percentiles."),
        *([tracks] if len(worst) else []),
    ]


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
        scores: as `minutes`, see `scores_tables`.
        minutes: how long the sweeps took.
        worst: all tracks with which something is wrong.
        dataset: name of the data set.
        recordings: that were compared.

    Raises:
        OutputError: a file cannot be written.
    """
    count = f"{len(recordings)} recordings" if len(recordings) > 1 else f"1 recording, {recordings[0]}"
    blocks: list[Block] = [
        Paragraph(f"{count}, {60 * minutes:.0f} s of sweeps."),
        *scores_tables(scores, minutes, worst),
        Heading("How to read it"),
        *map(Paragraph, HOW),
    ]
    title = f"Proposals of {dataset} against its annotations"
    files = Report(title=title, blocks=blocks, numbers=scores, page=True).write(out, "evaluate")
    tracks = out / "evaluate-tracks.csv"
    write_text(tracks, worst.to_csv(index=False))
    return *files, tracks

"""All runs of a folder, in groups that compare."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from bench.errors import BenchError, DataError
from bench.evaluation.summary import Figure
from bench.harness import RunSummary
from bench.reporting.compare.stored_runs import differing_settings, read_stored_run, settings_text

UNITS = "units"  # a run that did not end has these and no summary
ORDERED_BY = "iou"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A run in a table.

    Attributes:
        run: folder, relative to the one that was searched.
        method: with the settings in which its runs of the group differ.
        figures: by name, over all moving objects and all images.
        frames_per_second: images scored over the wall time of the run.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
    """

    run: str
    method: str
    figures: dict[str, Figure]
    frames_per_second: float
    date: str
    code: str
    failures: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Runs of one data set, split, protocol and reference, best first by IoU over all moving object-frames."""

    dataset: str
    split: str | None
    protocol: str
    protocol_digest: str
    reference_fingerprint: str
    object_frames: int
    recordings: int
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaderboard:
    """What a folder holds.

    Attributes:
        groups: runs that compare; never two in one table that do not.
        damaged: folder and fault of every run that cannot be read.
    """

    groups: tuple[Group, ...]
    damaged: tuple[tuple[str, str], ...]


def read_leaderboard(folder: Path) -> Leaderboard:
    """Find and read all runs under a folder, at any depth.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    if not folder.is_dir():
        raise DataError(folder, wanted="a folder of runs", came="no such folder")
    found = {file.parent for file in folder.rglob("summary.json")}
    found |= {units.parent for units in folder.rglob(UNITS) if units.is_dir()}
    if not found:
        raise DataError(folder, wanted="at least one run", came="no summary.json at any depth")
    sound: list[tuple[str, RunSummary]] = []
    damaged: list[tuple[str, str]] = []
    for run in sorted(found):
        name = run.relative_to(folder).as_posix()
        try:
            sound.append((name, read_stored_run(run).summary))
        except BenchError as error:
            damaged.append((name, str(error)))
    keys = sorted({_key(summary) for _, summary in sound})
    groups = [_group([(n, s) for n, s in sound if _key(s) == key]) for key in keys]
    return Leaderboard(groups=tuple(groups), damaged=tuple(damaged))


def _key(summary: RunSummary) -> tuple[str, str, str, str]:
    return summary.dataset, summary.split or "", summary.protocol.digest, summary.reference_fingerprint


def _group(runs: list[tuple[str, RunSummary]]) -> Group:
    first = runs[0][1]
    settings = differing_settings([summary for _, summary in runs])
    entries = [_entry(name, summary, own) for (name, summary), own in zip(runs, settings, strict=True)]
    return Group(
        dataset=first.dataset,
        split=first.split,
        protocol=first.protocol.name,
        protocol_digest=first.protocol.digest,
        reference_fingerprint=first.reference_fingerprint,
        object_frames=first.all_moving.object_frames,
        recordings=first.all_moving.recordings,
        entries=tuple(sorted(entries, key=_order)),
    )


def _entry(name: str, summary: RunSummary, settings: dict[str, object]) -> Entry:
    made, moving = summary.provenance, summary.all_moving
    method = f"{summary.method.name} ({settings_text(settings)})" if settings else summary.method.name
    commit = "" if made.commit is None else f" {made.commit[:8]}{'+' if made.commit.endswith('+') else ''}"
    return Entry(
        run=name,
        method=method,
        figures={figure: moving.figure(figure) for figure in moving.figure_names()}
        | {"false_positive_coverage": summary.false_positives.coverage},
        frames_per_second=made.images / made.seconds if made.seconds else math.nan,
        date=made.started_utc[:10],
        code=f"{made.version}{commit}",
        failures=len(summary.failures),
    )


def _order(entry: Entry) -> tuple[float, str]:
    value = entry.figures[ORDERED_BY].value
    return (math.inf if math.isnan(value) else -value), entry.run

"""All runs of a folder, in groups that compare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import BenchError, DataError
from bench.evaluation import summarise
from bench.evaluation.common_images import CommonImages
from bench.evaluation.summary import Figure
from bench.harness import RunSummary
from bench.reporting.compare.like_for_like import fingerprint, restricted
from bench.reporting.compare.stored_runs import StoredRun, differing_settings, read_stored_run, settings_text

UNITS = "units"  # a run that did not end has these and no summary
ORDERED_BY = "iou"
# Of the images of each run, so many must be common: one run that scored a few would else shrink the table of all.
LEAST_COMMON = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A run in a table.

    Attributes:
        run: folder, relative to the one that was searched.
        method: with the settings in which its runs of the group differ.
        figures: by name, over all moving objects and all images of the group.
        images: that the run scored; the group may be taken over fewer.
        frames_per_second: images scored over the wall time of the run.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
    """

    run: str
    method: str
    figures: dict[str, Figure]
    images: int
    frames_per_second: float
    date: str
    code: str
    failures: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Runs of one data set, split and protocol, on the images that all of them scored, where their references agree.

    Best first by IoU over all moving object-frames.

    Attributes:
        images: that all runs scored; all figures are of these.
        reference_fingerprint: of the reference on these images.
    """

    dataset: str
    split: str | None
    protocol: str
    protocol_digest: str
    reference_fingerprint: str
    images: int
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
        raise DataError(folder, expected="a folder of runs", got="no such folder")
    found = {file.parent for file in folder.rglob("summary.json")}
    found |= {units.parent for units in folder.rglob(UNITS) if units.is_dir()}
    if not found:
        raise DataError(folder, expected="at least one run", got="no summary.json at any depth")
    sound: list[StoredRun] = []
    damaged: list[tuple[str, str]] = []
    for run in sorted(found):
        name = run.relative_to(folder).as_posix()
        try:
            sound.append(read_stored_run(run, label=name))
        except BenchError as error:
            damaged.append((name, str(error)))
    groups: list[Group] = []
    for key in sorted({_key(run) for run in sound}):
        runs = [run for run in sound if _key(run) == key]
        if len({_reference(run) for run in runs}) > 1:
            runs = _readable(runs, damaged)
        groups += [_group(alike) for alike in _comparable(runs)]
    return Leaderboard(groups=tuple(groups), damaged=tuple(sorted(damaged)))


def _readable(runs: Sequence[StoredRun], damaged: list[tuple[str, str]]) -> list[StoredRun]:
    """The runs whose tables can be read and are those of their summary; the others are told as damaged."""
    kept = []
    for run in runs:
        try:
            if fingerprint(run) != _reference(run):
                raise DataError(
                    run.folder, expected="the tables that summary.json is of", got="those of another reference"
                )
            kept.append(run)
        except BenchError as error:
            damaged.append((run.label, str(error)))
    return kept


def _key(run: StoredRun) -> tuple[str, str, str]:
    return run.summary.dataset, run.summary.split or "", run.summary.protocol.digest


def _comparable(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Runs of one data set, split and protocol in groups whose references agree on their common images."""
    groups: list[list[StoredRun]] = []
    for run in sorted(runs, key=lambda run: (-run.summary.images.evaluated, run.label)):
        joined = next((group for group in groups if _agree(group, run)), None)
        if joined is None:
            groups.append([run])
        else:
            joined.append(run)
    return groups


def _agree(group: Sequence[StoredRun], run: StoredRun) -> bool:
    """Whether a run has enough images in common with all of a group, and the same reference on them."""
    if any(_reference(one) == _reference(run) for one in group):
        return True
    images = _common_images([*group, run])
    common, scored = images.count(), max(one.summary.images.evaluated for one in (*group, run))
    if not common or common < LEAST_COMMON * scored:
        return False
    return fingerprint(restricted(group[0], images)) == fingerprint(restricted(run, images))


def _reference(run: StoredRun) -> str:
    return run.summary.reference_fingerprint


def _common_images(runs: Sequence[StoredRun]) -> CommonImages:
    """The images of all runs; those of the same reference scored the same."""
    return CommonImages(list({_reference(run): run.frames for run in runs}.values()))


def _group(runs: Sequence[StoredRun]) -> Group:
    first = runs[0]
    reference, figures = _reference(first), [run.summary for run in runs]
    if len({_reference(run) for run in runs}) > 1:
        images = _common_images(runs)
        reference = fingerprint(restricted(first, images))
        figures = [_figures_on(run, images) for run in runs]
    settings = differing_settings([run.summary for run in runs])
    entries = [_entry(run, of_run, own) for run, of_run, own in zip(runs, figures, settings, strict=True)]
    return Group(
        dataset=first.summary.dataset,
        split=first.summary.split,
        protocol=first.summary.protocol.name,
        protocol_digest=first.summary.protocol.digest,
        reference_fingerprint=reference,
        images=figures[0].images.evaluated,
        object_frames=figures[0].all_moving.object_frames,
        recordings=figures[0].all_moving.recordings,
        entries=tuple(sorted(entries, key=_order)),
    )


def _figures_on(run: StoredRun, images: CommonImages) -> RunSummary:
    """The summary with all figures of some images only."""
    kept = restricted(run, images)
    figures = summarise(kept.objects, kept.frames, protocol=run.rules)
    return run.summary.model_copy(update={name: getattr(figures, name) for name in type(figures).model_fields})


def _entry(run: StoredRun, figures: RunSummary, settings: dict[str, object]) -> Entry:
    summary, moving = run.summary, figures.all_moving
    made = summary.provenance
    method = f"{summary.method.name} ({settings_text(settings)})" if settings else summary.method.name
    commit = "" if made.commit is None else f" {made.commit[:8]}{'+' if made.commit.endswith('+') else ''}"
    return Entry(
        run=run.label,
        method=method,
        figures={figure: moving.figure(figure) for figure in moving.figure_names()}
        | {"false_positive_coverage": figures.false_positives.coverage},
        images=summary.images.evaluated,
        frames_per_second=made.images / made.seconds if made.seconds else math.nan,
        date=made.started_utc[:10],
        code=f"{made.version}{commit}",
        failures=len(summary.failures),
    )


def _order(entry: Entry) -> tuple[float, str]:
    value = entry.figures[ORDERED_BY].value
    return (math.inf if math.isnan(value) else -value), entry.run

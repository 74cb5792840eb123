"""The runs of a folder in groups that compare, with what bounds them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from bench.errors import BenchError, DataError
from bench.evaluation import find_metric
from bench.evaluation.summary import Metric, ObjectMetrics
from bench.evaluation.sums import ALL_MOVING
from bench.harness.answers import read_seconds
from bench.harness.digests import short_digest
from bench.harness.manifest import ANSWERS_MANIFEST, MANIFEST, PREDICTIONS_DIGEST, Manifest, differences
from bench.harness.stored import SUMMARY, StoredRun, read_run, reference_digest, refuse_unscored
from bench.harness.verify import is_verified
from bench.reporting import formats
from bench.reporting.compare.runs import name_methods, on_common_images, reference_of, why_apart
from bench.reporting.sweep import TABLE as TABLE_OF_SWEEP

ORDERED_BY = "iou"
RANKING_PROTOCOL = "surface-v1"  # orders methods as exact masks do (reports/paper/reference.md)
FALSE_POSITIVES, OF_PIXELS = "false_positive_coverage", "segmentation_iou"  # of whole images, the same in every row


class Kind(StrEnum):
    """Kind of masks that a run scores."""

    METHOD = "method"
    ORACLE = "oracle"  # is given what no method may know
    CEILING = "ceiling"  # the exact masks, pixel by pixel


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A run in a table.

    Attributes:
        run: folder, relative to the one that was searched.
        folder: of the run.
        method: with the settings in which its runs of the group differ.
        kind: a method, or what bounds methods.
        values: row -> metric -> value, of all images of the group; what is of whole images stands in every row.
        images: that the run scored; the group may be taken over fewer.
        cost_ms: median time of the method for an image; None of what is none.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
        verified: its counts were found again from its masks, on this machine.
    """

    run: str
    folder: Path
    method: str
    kind: Kind
    values: Mapping[str, Mapping[str, Metric]]
    images: int
    cost_ms: float | None
    date: str
    code: str
    failures: int
    verified: bool = False

    @property
    def metrics(self) -> Mapping[str, Metric]:
        """Over all moving objects."""
        return self.values[ALL_MOVING]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """Runs of one data set, split and protocol, on the images that all of them scored, where their references agree.

    Best first by IoU over all moving object-frames.

    Attributes:
        card: file of the data set's card, as the runs name it.
        rows: all moving objects, then the categories that occur, by name; of the first run, for their cases.
        images: that all runs scored; all values are of these.
        reference_digest: of the reference on these images.
        unreviewed: says that nobody has looked at the annotations, as `RunSummary.unreviewed`.
    """

    dataset: str
    card: str
    split: str | None
    protocol: str
    protocol_digest: str
    reference_digest: str
    images: int
    rows: Mapping[str, ObjectMetrics]
    entries: tuple[Entry, ...]
    unreviewed: str = ""

    @property
    def judged(self) -> bool:
        """True if its protocol is the one that says which method is best."""
        return self.protocol == RANKING_PROTOCOL

    @property
    def methods(self) -> tuple[Entry, ...]:
        """Those that anybody could run, best first."""
        return tuple(entry for entry in self.entries if entry.kind is Kind.METHOD)

    def ceiling(self, row: str, metric: str) -> float:
        """Return the value of the exact masks; NaN where it is unknown.

        The run of the exact masks gives it for every metric; without it, the runs of data with truth give it for two.
        """
        exact = next((entry for entry in self.entries if entry.kind is Kind.CEILING), None)
        if exact is not None:
            return exact.values[row][metric].value
        own = self.entries[0].values[row].get(f"ceiling_{metric}")
        return math.nan if own is None else own.value


def shown_metrics(group: Group) -> dict[str, str]:
    """The metrics of the tables: names and headings.

    IoU, by which runs are ordered, false positives, IoU of the pixels of all images, coverage, detection at the highest
    level with its chance level.
    """
    highest = ["detection_rate", *formats.detection_levels(group.entries[0].metrics)][-1]
    names = (ORDERED_BY, FALSE_POSITIVES, OF_PIXELS, "tpr_all", highest, formats.chance_of(highest), "iou_detected")
    return {name: find_metric(name).label for name in names}


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaderboard:
    """Runs of a folder, in groups.

    Attributes:
        groups: runs that compare; never two in one table that do not.
        damaged: folder and fault of every run that cannot be read.
    """

    groups: tuple[Group, ...]  # data sets of most recordings first; of one, first those by the judging protocol
    damaged: tuple[tuple[str, str], ...]


def read_leaderboard(folder: Path) -> Leaderboard:
    """Find and read all runs under a folder, at any depth; the values of a sweep below it are no entries.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    sound, damaged = read_runs(folder)
    groups: list[Group] = []
    for runs in _of_one_protocol(sound):
        if len({reference_of(run) for run in runs}) > 1:
            runs = readable(runs, damaged)
        groups += [group_of(alike) for alike in _comparable(runs)]
    most: dict[str, int] = {}
    for group in groups:
        most[group.dataset] = max(group.rows[ALL_MOVING].recordings, most.get(group.dataset, 0))
    groups.sort(key=lambda g: (-most[g.dataset], g.dataset, g.split or "", not g.judged))  # else as they came
    return Leaderboard(groups=tuple(groups), damaged=tuple(sorted(damaged)))


def read_runs(folder: Path) -> tuple[list[StoredRun], list[tuple[str, str]]]:
    """Read the runs under a folder, at any depth, itself included.

    Returns:
        sound: the results by each protocol, called as the folder of the run below this one.
        damaged: folder and fault of each that cannot be read.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    if not folder.is_dir():
        raise DataError(folder, expected="a folder of runs", got="no such folder")
    found = {file.parent for file in folder.rglob(MANIFEST) if (file.parent.parent / ANSWERS_MANIFEST).is_file()}
    found |= {file.parent for file in folder.glob(SUMMARY)}  # the results of one protocol, named themselves
    found = {one for one in found if one.parents[1] == folder or not (one.parents[1] / TABLE_OF_SWEEP).is_file()}
    if not found:
        raise DataError(folder, expected="at least one run", got=f"no {ANSWERS_MANIFEST} at any depth")
    sound: list[StoredRun] = []
    damaged: list[tuple[str, str]] = []
    for results in sorted(found):
        run = results.parent
        name = run.relative_to(folder).as_posix() if folder in run.parents else run.resolve().name
        try:
            stored = read_run(results, label=name)
            refuse_unscored(stored.summary, results)
            sound.append(stored)
        except BenchError as error:
            damaged.append((f"{name}/{results.name}", str(error)))
    return sound, damaged


def readable(runs: Sequence[StoredRun], damaged: list[tuple[str, str]]) -> list[StoredRun]:
    """The runs whose tables can be read and are those of their summary; the others are listed as damaged."""
    readable = []
    for run in runs:
        try:
            if reference_digest(run.objects, run.frames) != reference_of(run):
                raise DataError(
                    run.folder, expected="the tables that summary.json is of", got="those of another reference"
                )
            readable.append(run)
        except BenchError as error:
            damaged.append((f"{run.label}/{run.folder.name}", str(error)))
    return readable


def _of_one_protocol(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Runs in groups of one data set, split and protocol, sorted by these."""
    groups: list[list[StoredRun]] = []
    for run in sorted(runs, key=_order):
        if groups and all(d.comparable for d in differences(groups[-1][0].manifest, run.manifest)):
            groups[-1].append(run)
        else:
            groups.append([run])
    return groups


def _order(run: StoredRun) -> tuple[str, str, str]:
    manifest = run.manifest
    return manifest.dataset.name, manifest.dataset.split or "", manifest.protocol.digest


def _comparable(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Runs of one data set, split and protocol in groups whose references agree on their common images."""
    groups: list[list[StoredRun]] = []
    for run in sorted(runs, key=lambda run: (-run.summary.images.evaluated, run.label)):
        joined = next((group for group in groups if not why_apart(group, run)), None)
        if joined is None:
            groups.append([run])
        else:
            joined.append(run)
    return groups


def group_of(runs: Sequence[StoredRun]) -> Group:
    """Take runs that compare over the images that all of them scored."""
    compared, reference = on_common_images(runs)
    first, metrics = runs[0].manifest, compared[0].metrics
    methods = name_methods([run.manifest for run in runs], hidden=HIDDEN_SETTINGS)
    entries = [_entry(run, own) for run, own in zip(compared, methods, strict=True)]
    categories = {name: row for name, row in metrics.categories.items() if row.object_frames}
    return Group(
        dataset=first.dataset.name,
        card=first.dataset.card,
        split=first.dataset.split,
        protocol=first.protocol.name,
        protocol_digest=first.protocol.digest,
        reference_digest=reference,
        images=metrics.images.evaluated,
        rows={ALL_MOVING: metrics.all_moving} | categories,
        entries=tuple(sorted(entries, key=_best_first)),
        unreviewed=next((run.summary.unreviewed for run in runs if run.summary.unreviewed), ""),
    )


def _best_first(entry: Entry) -> tuple[float, str]:
    value = entry.metrics[ORDERED_BY].value
    return (math.inf if math.isnan(value) else -value), entry.run


ORACLE_SETTINGS = ("sees_the_truth", "sees_the_reference")  # true for what is given more than a method may know
HIDDEN_SETTINGS = (*ORACLE_SETTINGS, "scenario")  # distinguish no methods: a table says the kind, and a path is a path


def _entry(run: StoredRun, method: str) -> Entry:
    summary, compared, code = run.summary, run.metrics, run.manifest.code
    commit = "" if code.commit is None else f" {short_digest(code.commit)}"
    of_images = {FALSE_POSITIVES: compared.false_positives.coverage, OF_PIXELS: compared.segmentation.iou}
    of_rows = {ALL_MOVING: compared.all_moving} | compared.categories
    return Entry(
        run=run.label,
        folder=run.folder,
        method=method,
        kind=_kind(run.manifest),
        values={
            row: {name: found.metric(name) for name in found.metric_names()} | of_images
            for row, found in of_rows.items()
        },
        images=summary.images.evaluated,
        cost_ms=_cost_ms(run),
        date=summary.provenance.started_utc[:10],
        code=f"{code.version}{commit}",
        failures=len(summary.failures),
        verified=is_verified(run),
    )


def _kind(manifest: Manifest) -> Kind:
    settings = manifest.method.settings
    if not any(settings.get(name) for name in ORACLE_SETTINGS):
        return Kind.METHOD
    exact = manifest.method.name == "truth" and settings.get("cell_size_px") == 1
    return Kind.CEILING if exact else Kind.ORACLE


def _cost_ms(run: StoredRun) -> float | None:
    """Median time of the method for an image, as the answers hold it."""
    if _kind(run.manifest) is not Kind.METHOD or PREDICTIONS_DIGEST in run.manifest.method.settings:
        return None
    seconds = read_seconds(run.answers)
    return 1e3 * float(np.nanmedian(seconds)) if np.isfinite(seconds).any() else None

"""A leaderboard: the runs of a folder in groups that compare, ranked, with what bounds them, beside the shipped ones.

"Best" is a method only where `compare` shows it better than every other one; else it is the first.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import BenchError, DataError
from bench.evaluation import find_metric, load_protocol
from bench.evaluation.summary import Metric, ObjectMetrics
from bench.evaluation.sums import ALL_MOVING
from bench.harness.answers import read_seconds
from bench.harness.digests import short_digest
from bench.harness.manifest import ANSWERS_MANIFEST, MANIFEST, PREDICTIONS_DIGEST, Manifest, differences
from bench.harness.stored import SUMMARY, StoredRun, read_run, reference_digest, refuse_unscored
from bench.harness.verify import is_verified
from bench.methods import known_methods
from bench.methods.registry import describe_method
from bench.reporting import formats
from bench.reporting.compare import (
    Shown,
    differing_settings,
    name_method,
    on_common_images,
    reference_of,
    what_is_shown_of,
    why_apart,
)
from bench.reporting.findings import SWEEP

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
        name: as readers know it.
        about: what it does, in a line; "" where that is not known here.
        code_file: that holds it; "" for one that is not of this package.
        kind: a method, or what bounds methods.
        values: row -> metric -> value, of all images of the group; what is of whole images stands in every row.
        images: that the run scored; the group may be taken over fewer.
        cost_ms: median time of the method for an image; None of what is none.
        date: UTC, on which it was started.
        code: version and commit.
        failures: images, units and recordings that could not be used.
        verified: its counts were found again from its masks, on this machine.
        shipped: it is a row of the leaderboard that comes with the package, and no run.
        rank: among the methods of the group; None for what is none.
        behind: the first of the group is shown to be better; None for the first, and where that was not compared.
    """

    run: str
    folder: Path
    method: str
    name: str
    about: str
    code_file: str
    kind: Kind
    values: Mapping[str, Mapping[str, Metric]]
    images: int
    cost_ms: float | None
    date: str
    code: str
    failures: int
    verified: bool = False
    shipped: bool = False
    rank: int | None = None
    behind: bool | None = None

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

    @property
    def best(self) -> bool:
        """True if the first method is shown to be better than each of the others."""
        return self.judged and len(self.methods) > 1 and all(entry.behind for entry in self.methods[1:])

    def ceiling(self, row: str, metric: str) -> float:
        """Return the value of the exact masks; NaN where it is unknown.

        The run of the exact masks gives it for every metric; without it, the runs of data with truth give it for two.
        """
        exact = [e for e in self.entries if e.kind is Kind.CEILING and metric in e.values[row]]
        if exact:
            return exact[0].values[row][metric].value
        known = (entry.values[row].get(f"ceiling_{metric}") for entry in self.entries)
        return next((ceiling.value for ceiling in known if ceiling is not None), math.nan)


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
    found = {one for one in found if one.parents[1] == folder or not (one.parents[1] / SWEEP).is_file()}
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
    """Take runs that compare over the images that all of them scored, and rank them."""
    compared, reference = on_common_images(runs)
    first, metrics = runs[0].manifest, compared[0].metrics
    differing = differing_settings([run.manifest for run in runs], hidden=HIDDEN_SETTINGS)
    pairs = [(_entry(run, own), run) for run, own in zip(compared, differing, strict=True)]
    pairs.sort(key=lambda pair: _best_first(pair[0]))
    methods = [pair for pair in pairs if pair[0].kind is Kind.METHOD]
    entries = [entry for entry, _ in pairs if entry.kind is not Kind.METHOD] + [entry for entry, _ in methods[:1]]
    for entry, run in methods[1:]:
        judged = first.protocol.name == RANKING_PROTOCOL
        better = judged and what_is_shown_of(run, methods[0][1], ORDERED_BY) is Shown.BETTER
        entries.append(replace(entry, behind=better if judged else None))
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
        entries=_ranked(entries),
        unreviewed=next((run.summary.unreviewed for run in runs if run.summary.unreviewed), ""),
    )


def _ranked(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """In their order by IoU, each method with its rank."""
    ordered = sorted(entries, key=_best_first)
    ranks = iter(range(1, len(ordered) + 1))
    return tuple(replace(e, rank=next(ranks) if e.kind is Kind.METHOD else None) for e in ordered)


def _best_first(entry: Entry) -> tuple[float, str]:
    value = entry.metrics[ORDERED_BY].value
    return (math.inf if math.isnan(value) else -value), entry.run


ORACLE_SETTINGS = ("sees_the_truth", "sees_the_reference")  # true for what is given more than a method may know
HIDDEN_SETTINGS = (*ORACLE_SETTINGS, "scenario")  # distinguish no methods: a table says the kind, and a path is a path


# What readers call a method, and its settings; others are called as in the registry.
NAMES = {
    "spherical": "the paper's method",
    "spherical-guided": "the paper's constraints on guided flow",
    "spherical-sparse": "the paper's constraints on tracks",
    "spherical-visual-odometry": "the paper's method by visual odometry",
    "epipolar-only": "epipolar constraint alone",
    "positive-depth-only": "positive-depth constraint alone",
    "positive-height-only": "positive-height constraint alone",
    "anti-parallel-only": "anti-parallel constraint alone",
    "three-view-only": "three-view constraint alone",
    "learned": "small network",
    "exact-flow": "the paper's method on exact flow",
    "truth": "exact masks",
}
SETTINGS = {
    "flow=dis": "with DIS flow",
    "first_guess=True": "with a first guess of the flow",
    "cell_size_px=5": "on the paper's cells",
}


def _entry(run: StoredRun, differing: Mapping[str, object]) -> Entry:
    summary, compared, code, method = run.summary, run.metrics, run.manifest.code, run.manifest.method
    commit = "" if code.commit is None else f" {short_digest(code.commit)}"
    of_images = {FALSE_POSITIVES: compared.false_positives.coverage, OF_PIXELS: compared.segmentation.iou}
    of_rows = {ALL_MOVING: compared.all_moving} | compared.categories
    changed = {name: value for name, value in method.changed_settings().items() if name in differing}
    words = [SETTINGS.get(f"{name}={value}", f"{name}={value}") for name, value in sorted(changed.items())]
    known = method.place == known_methods().get(method.name) and method.is_own
    return Entry(
        run=run.label,
        folder=run.folder,
        method=name_method(method.name, differing),
        name=", ".join([NAMES.get(method.name, method.name), *words]),
        about=describe_method(method.place) if known else "",
        code_file=method.place.partition(":")[0].replace(".", "/") + ".py" if method.is_own else "",
        kind=_kind(run.manifest),
        values={
            row: {name: of_row.metric(name) for name in of_row.metric_names()} | of_images
            for row, of_row in of_rows.items()
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


# The stored form, which comes with the package.

SCHEMA_VERSION = 3
OF_GROUP = ("dataset", "split", "protocol", "protocol_digest", "reference_digest")
OF_ENTRY = ("run", "method", "name", "about", "code_file", "kind", "images", "cost_ms", "date", "code", "failures",
            "verified", "rank", "behind")  # fmt: skip


def fields(record: object, names: Sequence[str]) -> dict[str, object]:
    """Attributes of a record by name."""
    return {name: getattr(record, name) for name in names}


def as_content(board: Leaderboard) -> dict[str, object]:
    """The content of `leaderboard.json`: values as [value, low, high] of the interval, or [value]; no shipped rows."""
    return {
        "schema_version": SCHEMA_VERSION,
        "best": list(best_methods(board)),
        "groups": [_group_content(group) for group in board.groups],
        "damaged": [{"run": run, "fault": fault} for run, fault in board.damaged],
    }


def _group_content(group: Group) -> dict[str, object]:
    names = shown_metrics(group)
    ceilings = {row: {name: known_ceiling(group, row, name) for name in names} for row in group.rows}
    return fields(group, (*OF_GROUP, "judged", "images")) | {
        "metrics": names,
        "rows": [
            {"name": row, "label": formats.LABELS[row], "object_frames": of.object_frames, "recordings": of.recordings}
            | {"ceiling": {name: value for name, value in ceilings[row].items() if value is not None}}
            for row, of in group.rows.items()
        ],
        "entries": [
            fields(entry, OF_ENTRY)
            | {"values": {row: {name: [m.value, *(m.ci95 or ())] for name, m in values.items() if name in names}
                          for row, values in entry.values.items() if row in group.rows}}
            for entry in group.entries if not entry.shipped
        ],
        **formats.annotations_field(group.unreviewed),
    }  # fmt: skip


def known_ceiling(group: Group, row: str, name: str) -> float | None:
    """Value of the exact masks; None for what has no ceiling, and where it is unknown."""
    if name.startswith(("chance", "ceiling", "unknown")):
        return None
    value = group.ceiling(row, name)
    return None if math.isnan(value) else value


def with_shipped(board: Leaderboard, file: Path) -> Leaderboard:
    """Put the shipped rows beside the runs that compare with them: same data, protocol, images and reference.

    A method that the folder holds itself stands there once, as the folder has it.

    Args:
        board: of a folder.
        file: `leaderboard.json`; one of another schema adds nothing.
    """
    try:
        stored = json.loads(file.read_bytes())
        if stored["schema_version"] != SCHEMA_VERSION:
            return board
        groups = [_beside_shipped(group, stored["groups"]) for group in board.groups]
    except (OSError, ValueError, LookupError, TypeError):
        return board
    return replace(board, groups=tuple(groups))


def _beside_shipped(group: Group, stored: Sequence[Mapping[str, Any]]) -> Group:
    same = (*OF_GROUP, "images")
    content = next((one for one in stored if all(one[name] == getattr(group, name) for name in same)), None)
    if content is None:
        return group
    own = {entry.method for entry in group.entries}
    shipped = [_shipped_entry(entry, group) for entry in content["entries"] if entry["method"] not in own]
    return replace(group, entries=_ranked([*group.entries, *shipped]))


def _shipped_entry(content: Mapping[str, Any], group: Group) -> Entry:
    values = {
        row: {
            name: Metric(
                value=math.nan if numbers[0] is None else numbers[0],
                ci95=(numbers[1], numbers[2]) if len(numbers) > 1 else None,
                cases=group.rows[row].object_frames,
                recordings=group.rows[row].recordings,
            )
            for name, numbers in metrics.items()
        }
        for row, metrics in content["values"].items()
    }
    told = {name: content[name] for name in OF_ENTRY} | {"kind": Kind(content["kind"]), "behind": None}
    return Entry(folder=Path(), values=values, shipped=True, **told)


def best_methods(board: Leaderboard) -> Iterator[dict[str, object]]:
    """For each data set the method that leads under the protocol that ranks, and its score in words.

    Oracles are none. It is "best" where it is shown to be better than every other method, else "first".
    """
    today = load_protocol(RANKING_PROTOCOL).digest
    for dataset in dict.fromkeys(group.dataset for group in board.groups):
        judged = [g for g in board.groups if (g.dataset, g.split, g.judged) == (dataset, None, True) and g.methods]
        if judged:
            group = max(judged, key=lambda group: (group.protocol_digest == today, len(group.methods)))
            first, ceiling = group.methods[0], group.ceiling(ALL_MOVING, ORDERED_BY)
            iou = first.metrics[ORDERED_BY]
            few = "" if iou.ci95 else " (too few recordings for an interval)"
            of = "" if math.isnan(ceiling) else f", ceiling {formats.percent(ceiling)}"
            false = formats.percent(first.metrics[FALSE_POSITIVES].value)
            unreviewed = f"; {group.unreviewed.rstrip('.')}" if group.unreviewed else ""
            yield {
                "dataset": dataset,
                "protocol": group.protocol,
                "protocol_digest": group.protocol_digest,
                "rank": "best" if group.best else "first",
                "method": first.name,
                "of": len(group.methods),
                "not_behind": [entry.name for entry in group.methods if entry.behind is False],
                "score": f"IoU {formats.with_interval(iou)}{few} over all moving object-frames{of}, false positives "
                f"{false} of the image{unreviewed}",
                "date": first.date,
                "code": first.code,
            }


def best_line(file: Path, *, dataset: str, beside: str = RANKING_PROTOCOL) -> str | None:
    """The best method of a stored leaderboard on a data set, in one line.

    None where it has none, or one by an earlier state of the protocol, whose scores do not compare with today's.

    Args:
        file: `leaderboard.json`.
        dataset: name of the data set.
        beside: protocol of the scores that the line stands beside; with another one they do not compare.
    """
    try:
        best = next(best for best in json.loads(file.read_bytes())["best"] if best["dataset"] == dataset)
        if best["protocol_digest"] != load_protocol(RANKING_PROTOCOL).digest:
            return None
        line = "{rank} of {of} methods on all of {dataset} by {protocol}: {method}, {score} ({file}, {date}, {code})"
        other = "" if beside == RANKING_PROTOCOL else f"; scores by {beside} do not compare with it"
        return line.format(file=file, **best) + other
    except (OSError, ValueError, LookupError, TypeError, StopIteration, RecursionError):
        return None

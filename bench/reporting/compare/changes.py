"""What changed from the first run to each of the others: metrics by row with a verdict, and object-frames."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd

from bench.errors import DataError
from bench.evaluation import (
    PairedChange,
    Protocol,
    changes_in_parts,
    compare_sums,
    find_metric,
    headlines,
    holm,
)
from bench.evaluation.comparison import SIGNIFICANCE
from bench.evaluation.definitions import false_share, image_metrics, object_metrics
from bench.evaluation.rows import EVALUATED, IMAGE, group_recordings, merge_rows
from bench.evaluation.summary import NO_CASES, Metric, take_ratios
from bench.evaluation.sums import ALL_MOVING, CATEGORY, FRAMES
from bench.harness.manifest import Aspect, differences
from bench.reporting.compare.runs import differing_settings, on_common_images, settings_text
from bench.reporting.formats import LABELS, chance_of
from bench.reporting.stored_run import StoredRun, pick


class Verdict(StrEnum):
    """A change in words."""

    BETTER = "better"
    WORSE = "worse"
    NOT_SHOWN = "no difference shown"
    THE_SAME = "the same"
    TOO_FEW = "too few recordings"
    NO_CASES = "no cases in one of the runs"


def judge(change: PairedChange, *, p_holm: float | None, improvement: float) -> Verdict:
    """Say what a change shows.

    Args:
        change: of a metric.
        p_holm: its p-value, corrected for the rows of the metric.
        improvement: the difference in the metric's direction.

    Returns:
        Better or worse only if the 95 % interval excludes 0 and the corrected p-value is at most 5 %; neither is there
        for fewer than six recordings.
    """
    if math.isnan(change.difference):
        return Verdict.NO_CASES
    if change.difference == 0 and change.ci95 is None:
        return Verdict.THE_SAME
    if change.ci95 is None or p_holm is None:
        return Verdict.TOO_FEW
    low, high = change.ci95
    if low <= 0 <= high or p_holm > SIGNIFICANCE:
        return Verdict.NOT_SHOWN
    return Verdict.BETTER if improvement > 0 else Verdict.WORSE


# The metrics that are judged, and the only ones whose p-values are corrected.
HEADLINES = {metric.name: metric.label for metric in headlines()}
FALSE_POSITIVE_COVERAGE = "false_positive_coverage"
# Of whole images, those that are shown in percent; F1 follows from precision and recall.
OF_FRAMES = [m.name for m in image_metrics() if m.higher_is_better is not None and m.is_ratio and m.name != "f1"]
NO_CHANGE = PairedChange(
    before=math.nan, after=math.nan, difference=math.nan, ci95=None, p_value=None, cases_before=0, cases_after=0,
    recordings=0,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """One metric of one row.

    Attributes:
        change: before, after, and the paired interval.
        intervals: of the values before and after, each by itself; None for too few recordings.
        p_holm: p-value corrected over the rows of the metric; None for metrics that are not headlines, and where there
            is no p-value.
        verdict: None for metrics that are not headlines.
        chance: chance level before and after; None where the metric has none.
        ceiling: what the exact masks get on the same images; None where not both runs carry it.
    """

    change: PairedChange
    intervals: tuple[tuple[float, float] | None, tuple[float, float] | None]
    p_holm: float | None
    verdict: Verdict | None
    chance: tuple[Metric, Metric] | None
    ceiling: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RowChange:
    """One row of the table.

    Attributes:
        name: category, "all_moving" or "frames".
        label: for tables.
        frames: object-frames, in the last row image-frames.
        recordings: that hold them.
        metrics: by name.
    """

    name: str
    label: str
    frames: int
    recordings: int
    metrics: Mapping[str, MetricChange]


def row_changes(sums_before: pd.DataFrame, sums_after: pd.DataFrame, *, protocol: Protocol) -> list[RowChange]:
    """Compare the categories, all moving objects, and the false positives.

    Holm's correction runs over the rows of one headline metric that have a p-value: the categories and the row of all
    moving objects. False-positive coverage has one row, so that its p-value stays as it is. A row without a p-value
    (cases of both in fewer than six recordings) does not count.

    Args:
        sums_before: of the run compared against.
        sums_after: of the other run.
        protocol: of both.
    """
    sides = [sums[sums["breakdown"].isin([CATEGORY, ALL_MOVING, FRAMES])] for sums in (sums_before, sums_after)]
    ratios = [take_ratios(sums) for sums in sides]
    compared = compare_sums(*sides).reset_index().to_dict("records")
    found = {(row["breakdown"], row["slice"], row["metric"]): PairedChange.of(row) for row in compared}
    of_objects = [m.name for m in object_metrics(protocol.scoring.detection_levels) if m.higher_is_better is not None]
    rows = [(CATEGORY, str(category)) for category in protocol.reference.categories]
    names = dict.fromkeys((*rows, (ALL_MOVING, ALL_MOVING)), of_objects) | {(FRAMES, FRAMES): OF_FRAMES}
    changes = {(*row, m): found.get((*row, m), NO_CHANGE) for row, metrics in names.items() for m in metrics}
    corrected: dict[tuple[str, str, str], float | None] = {}
    for metric in HEADLINES:
        keys = [key for key in changes if key[2] == metric]
        corrected |= dict(zip(keys, holm([changes[key].p_value for key in keys]), strict=True))

    def metric_change(key: tuple[str, str, str]) -> MetricChange:
        (breakdown, name, metric), change, p_holm = key, changes[key], corrected.get(key)
        row = breakdown, name
        improvement = find_metric(metric).improvement(change.difference)
        before, after = (of_run.get(key, NO_CASES).ci95 for of_run in ratios)
        by_chance = [of_run.get((*row, chance_of(metric)), NO_CASES) for of_run in ratios]
        ceilings = [of_run.get((*row, f"ceiling_{metric}"), NO_CASES).value for of_run in ratios]  # equal where known
        return MetricChange(
            change=change,
            intervals=(before, after),
            p_holm=p_holm,
            verdict=judge(change, p_holm=p_holm, improvement=improvement) if metric in HEADLINES else None,
            chance=(by_chance[0], by_chance[1]) if metric.startswith("detection_rate") else None,
            ceiling=None if any(map(math.isnan, ceilings)) else ceilings[0],
        )

    cases = {
        row: ratios[0].get((*row, FALSE_POSITIVE_COVERAGE if row[0] == FRAMES else "iou"), NO_CASES) for row in names
    }
    return [
        RowChange(
            name=row[1],
            label=LABELS[row[1]],
            frames=cases[row].cases,
            recordings=cases[row].recordings,
            metrics={metric: metric_change((*row, metric)) for metric in metrics},
        )
        for row, metrics in names.items()
    ]


LISTED = 10  # of each kind, one per track


class Kind(StrEnum):
    """Why a frame is worth a look."""

    LOST = "newly missed"
    GAINED = "newly detected"
    FELL = "coverage fell"
    ROSE = "coverage rose"
    MORE_FALSE = "more false positives"
    FEWER_FALSE = "fewer false positives"


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionCounts:
    """Detected object-frames of a row; `after - before == gained - lost`."""

    name: str
    object_frames: int
    before: int
    after: int
    gained: int
    lost: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedFrame:
    """A frame that changed.

    Attributes:
        kind: in which way.
        recording: of the image.
        camera: of the image.
        timestamp_ns: of the image.
        track_id: of the object; None for false positives.
        what: the object in words; empty for false positives.
        before: coverage of the object, or false-positive coverage of the image.
        after: the same in the other run.
        iou_before: of the object; None for false positives.
        iou_after: of the object; None for false positives.
    """

    kind: Kind
    recording: str
    camera: str
    timestamp_ns: int
    track_id: str | None = None
    what: str = ""
    before: float
    after: float
    iou_before: float | None = None
    iou_after: float | None = None


def paired_objects(before: StoredRun, after: StoredRun) -> Iterator[pd.DataFrame]:
    """The evaluated object-frames of both runs, one per row, as `object_changes` sets them side by side, in parts.

    Raises:
        DataError: the runs did not evaluate the same object-frames, though their summaries say so.
    """
    for part in changes_in_parts(before.objects, after.objects):
        alone = part[~part["change"].isin(["gained", "lost", "both", "neither"])]
        if len(alone):
            first = " ".join(str(alone.iloc[0][name]) for name in (*IMAGE, "track_id"))
            raise DataError(
                after.folder / "objects.parquet",
                expected=f"the object-frames of {before.folder}, whose reference has the same digest",
                got=f"at least {len(alone)} that only one has, first {first}",
                hint="run again what was changed by hand",
            )
        yield part


def sum_changes(
    parts: Iterable[pd.DataFrame], *, categories: tuple[str, ...], limit: int = LISTED
) -> tuple[list[DetectionCounts], list[ChangedFrame]]:
    """Count the detections, and pick the object-frames that changed most.

    Args:
        parts: whole recordings, as `paired_objects` gives them.
        categories: of the protocol.
        limit: of object-frames of each kind; at most one of each track and kind, largest change of coverage first, of
            equals the largest object.

    Returns:
        detections: gained and lost, by category and of all.
        frames: the object-frames that changed most.
    """
    counts: list[pd.DataFrame] = []

    def counted() -> Iterator[pd.DataFrame]:
        for rows in parts:
            lost, gained, both = (rows["change"] == change for change in ("lost", "gained", "both"))
            numbers = {run: rows[f"detected_{run}"].astype(bool) for run in ("before", "after")}
            numbers |= {"gained": gained, "lost": lost}
            counts.append(pd.DataFrame({"category": rows["category"], "object_frames": 1} | numbers))
            change = (rows["coverage_after"] - rows["coverage_before"]).astype(float)
            kinds = {Kind.LOST: lost, Kind.GAINED: gained}
            kinds |= {Kind.FELL: both & (change < 0), Kind.ROSE: both & (change > 0)}
            yield _of_kinds(rows, kinds, size=change.abs())

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        ranked = rows.sort_values(["size", "region_px"], ascending=False, kind="stable")
        return ranked.drop_duplicates(["kind", "recording", "track_id"]).groupby("kind").head(limit)

    changed = pick(counted(), largest)
    by_category = pd.concat(counts).groupby("category").sum().astype(int)
    by_category.loc[ALL_MOVING] = by_category.sum()
    by_category = by_category.reindex([*categories, ALL_MOVING], fill_value=0)
    detections = [
        DetectionCounts(name=str(name), **{str(count): int(number) for count, number in row.items()})
        for name, row in by_category.iterrows()
    ]
    return detections, _frames(changed, value="coverage")


def changed_images(before: StoredRun, after: StoredRun) -> list[ChangedFrame]:
    """The image with most more and the one with most fewer false positives; none where nothing changed."""
    counts = [run.frames.recordings() for run in (before, after)]

    def parts() -> Iterator[pd.DataFrame]:
        for group in group_recordings({name: rows for name, rows in counts[0].items() if name in counts[1]}) or [[]]:
            rows = merge_rows(_false_shares(before, group), _false_shares(after, group), on=IMAGE)
            rows = rows.sort_values(IMAGE, ignore_index=True)
            change = rows["share_after"] - rows["share_before"]
            yield _of_kinds(rows, {Kind.MORE_FALSE: change > 0, Kind.FEWER_FALSE: change < 0}, size=change.abs())

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        return rows.sort_values("size", ascending=False, kind="stable").drop_duplicates("kind")

    return _frames(pick(parts(), largest), value="share")


def _of_kinds(rows: pd.DataFrame, kinds: Mapping[Kind, pd.Series[bool]], *, size: pd.Series[float]) -> pd.DataFrame:
    """The rows that changed, with the kind and the size of the change."""
    kind = np.select(list(kinds.values()), list(kinds), "")
    changed: pd.DataFrame = rows.assign(kind=kind, size=size).loc[kind != ""]
    return changed


def _frames(changed: pd.DataFrame, *, value: str) -> list[ChangedFrame]:
    """The rows as frames, by kind, the largest change first."""
    rows = changed.to_dict("records")
    return [_frame(row, value) for kind in Kind for row in rows if row["kind"] == kind]


def _frame(row: Mapping[Hashable, Any], value: str) -> ChangedFrame:
    of_object: dict[str, Any] = {}
    if "track_id" in row:
        words = f"{row['object_class']} '{row['track_id']}', {str(row['category']).replace('_', ' ')}"
        of_object = {"track_id": str(row["track_id"]), "what": f"{words}, {float(row['range_m']):.1f} m"}
        of_object |= {name: float(row[name]) for name in ("iou_before", "iou_after")}
    return ChangedFrame(
        kind=Kind(row["kind"]),
        recording=str(row["recording"]),
        camera=str(row["camera"]),
        timestamp_ns=int(row["timestamp_ns"]),
        before=float(row[f"{value}_before"]),
        after=float(row[f"{value}_after"]),
        **of_object,
    )


def _false_shares(run: StoredRun, recordings: Sequence[str]) -> pd.DataFrame:
    frames = run.frames.read(recordings, [*IMAGE, "status", "width", "height", "fp_px"])
    return frames[frames["status"] == EVALUATED].assign(share=false_share)[[*IMAGE, "share"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnFrame:
    """A picture of a changed frame.

    Attributes:
        title: that stands above it.
        name: of its file.
        jpeg: the file.
    """

    title: str
    name: str
    jpeg: bytes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunComparison:
    """One run against the first.

    Attributes:
        before: the run compared against.
        after: the other run.
        images: how many each scored, and how many of these both did; all values are of the last.
        methods: of both, with the settings in which they differ.
        rows: of the table.
        detections: gained and lost, by category and of all.
        frames: that changed most.
        notes: what a reader should know: on how many images the runs are compared, whether the data's files differ.
        drawn: pictures of some of the frames.
        remarks: why other pictures could not be made.
    """

    before: StoredRun
    after: StoredRun
    images: tuple[int, int, int]
    methods: tuple[str, str]
    rows: list[RowChange]
    detections: list[DetectionCounts]
    frames: list[ChangedFrame]
    notes: tuple[str, ...]
    drawn: tuple[DrawnFrame, ...] = ()
    remarks: tuple[str, ...] = ()


def verdict_line(comparison: RunComparison) -> str:
    """One sentence: which headline metrics are better, worse, or not shown to differ; and in which categories."""
    rows = {row.name: row for row in comparison.rows}
    everything = {**rows[ALL_MOVING].metrics, **rows[FRAMES].metrics}
    overall = [(metric, everything[metric]) for metric in HEADLINES if metric in everything]
    said = []
    for verdict in Verdict:
        names = [HEADLINES[metric] for metric, found in overall if found.verdict is verdict]
        if names:
            said.append(f"{verdict.value}: {'; '.join(names)}")
    return f"{comparison.after.label} against {comparison.before.label}, over everything: {'. '.join(said)}."


def _notes(before: StoredRun, after: StoredRun, images: tuple[int, int, int]) -> tuple[str, ...]:
    notes = [f"Compared on the {images[2]} images that both scored."]
    if len(set(images)) > 1:
        notes[0] = notes[0][:-1] + f": {before.label} scored {images[0]}, {after.label} {images[1]}."
    found = differences(before.summary.manifest, after.summary.manifest)
    if any(difference.aspect is Aspect.DATA for difference in found):
        notes.append(
            "The files of the data set changed between the runs, though the reference on these images did not."
        )
    if code := [str(difference) for difference in found if difference.aspect in (Aspect.CODE, Aspect.METHOD_CODE)]:
        notes.append(f"Made by different code: {'; '.join(code)}.")
    return tuple(notes)


def _compare(first: StoredRun, other: StoredRun) -> RunComparison:
    before, after, common = on_common_images(first, other)
    images = (before.summary.images.evaluated, after.summary.images.evaluated, common)
    protocol = before.protocol
    categories = tuple(str(category) for category in protocol.reference.categories)
    detections, frames = sum_changes(paired_objects(before, after), categories=categories)
    settings = differing_settings([before.summary, after.summary])
    names = [run.summary.manifest.method.name for run in (before, after)]
    methods = [f"{name} ({settings_text(own)})" if own else name for name, own in zip(names, settings, strict=True)]
    return RunComparison(
        before=before,
        after=after,
        images=images,
        methods=(methods[0], methods[1]),
        rows=row_changes(before.sums, after.sums, protocol=protocol),
        detections=detections,
        frames=[*frames, *changed_images(before, after)],
        notes=_notes(before, after, images),
    )


def compare_runs(runs: Sequence[StoredRun]) -> list[RunComparison]:
    """Compare the first of several runs with each of the others, on the images that both scored.

    Raises:
        DataError: a table is damaged.
        UsageError: no image was scored by both, or the references differ on these.
    """
    return [_compare(runs[0], other) for other in runs[1:]]

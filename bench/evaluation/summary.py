"""Summary of a run: the metrics of the paper's table, as `summary.json` stores them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any

import pandas as pd
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer

from bench.evaluation.definitions import (
    CAUSE,
    CEILINGS,
    COUNTS,
    EVERY_ROW,
    FALSE_POSITIVES,
    IMAGE_FRAMES,
    MARKED,
    OBJECT_FRAMES,
    SEGMENTATION,
    Definition,
    cause_metric,
    find_metric,
    object_metrics,
)
from bench.evaluation.intervals import ratio_interval
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import IMAGE_STATUSES
from bench.evaluation.sums import ALL_MOVING, CATEGORY, FRAMES, object_breakdowns
from bench.records.reference import IgnoreReason, Status

# 0/0 is NaN in memory and null in JSON.
Ratio = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else value, return_type=float | None, when_used="json"),
]


class _SummaryModel(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ProtocolOfRun(_SummaryModel):
    """Protocol that made the metrics; those of different digests are never put in one table."""

    name: str
    version: int
    digest: str


class Metric(_SummaryModel):
    """One metric of a table.

    Attributes:
        value: a ratio in [0, 1], or a mean; NaN without cases.
        ci95: 95 % interval by recording (`bench.evaluation.intervals`); None where fewer than six of them hold cases.
        cases: what the metric is taken over: object-frames, image-frames, or pixels for the segmentation metrics.
        recordings: that hold cases.
    """

    value: Ratio
    ci95: tuple[float, float] | None
    cases: int
    recordings: int


NO_CASES = Metric(value=math.nan, ci95=None, cases=0, recordings=0)


class _Metrics(BaseModel):
    """Metrics by the names of their definitions, which say what they mean.

    Declared are those that a reader may count on, so that editors complete them and a file without them is refused; a
    metric that is added to the definitions needs no declaration to be stored and read.
    """

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Metric]

    def metric(self, name: str) -> Metric:
        """A metric by its name in `metric_names()`."""
        found: Metric = getattr(self, name)
        return found

    def metric_names(self) -> tuple[str, ...]:
        """All metrics of the row."""
        declared = [name for name, field in type(self).model_fields.items() if field.annotation is Metric]
        return (*declared, *self.__pydantic_extra__)


class ObjectMetrics(_Metrics):
    """A row of the table: evaluated object-frames of one kind.

    Beside the declared ones there are, for every detection level of the protocol, `detection_rate_<percent>` and
    `chance_<percent>` (for example `detection_rate_10`), and for protocols with unknown bands `unknown_share`, the mean
    share of the object-frames' possible pixels that is not certain, and for data with exact masks `ceiling_tpr_all` and
    `ceiling_iou`, what these get under the same protocol; `metric(name)` finds all of them.

    Attributes:
        object_frames: how many.
        tracks: objects that they come from.
        recordings: recordings that they come from.
    """

    object_frames: int
    tracks: int
    recordings: int
    detection_rate: Metric
    chance: Metric
    tpr: Metric
    tpr_all: Metric
    iou: Metric
    iou_detected: Metric


class FalsePositiveMetrics(_Metrics):
    """The last row of the table: image-frames of one kind.

    Attributes:
        frames: scored image-frames.
        recordings: that they come from.
    """

    frames: int
    recordings: int
    coverage: Metric
    coverage_valid: Metric
    frame_rate: Metric
    components_per_frame: Metric


class SegmentationMetrics(_Metrics):
    """The field's usual metrics of the moving class, from summed pixel counts outside I."""

    iou: Metric
    precision: Metric
    recall: Metric
    f1: Metric


class ObjectLedger(_SummaryModel):
    """Numbers of annotated objects in all images, by outcome.

    Attributes:
        annotated: all of them; equal to `evaluated + static + sum(ignored.values())`.
        evaluated: scored.
        static: not moving, not evaluated.
        ignored: by reason.
    """

    annotated: int
    evaluated: int
    static: int
    ignored: dict[str, int]


class FrameLedger(_SummaryModel):
    """Numbers of images, by outcome; `problems` counts the failed and skipped ones by their message.

    Attributes:
        not_annotated: with a mask, but without annotations to score it by.
    """

    images: int
    evaluated: int
    failed: int
    skipped: int
    not_annotated: int = 0
    problems: dict[str, int]


class Summary(_SummaryModel):
    """All metrics of a run.

    Attributes:
        categories: by name, in the order of the paper's table.
        all_moving: the categories pooled.
        false_positives: over all scored images.
        segmentation: over all scored images.
        false_positive_causes: share of the false-positive pixels by the cause that a method names.
        breakdowns: "object_class", "range_m", "speed_mps", "class_and_speed", "ego_speed_mps", "camera", "points" ->
            bin or name -> row; the bins are written "[a, b)", those of a class "pedestrian, [a, b)".
        objects: ledger of the annotated objects.
        images: ledger of the images.
        marked: mean share of V that is detected, over the images that are not annotated.
    """

    categories: dict[str, ObjectMetrics]
    all_moving: ObjectMetrics
    false_positives: FalsePositiveMetrics
    segmentation: SegmentationMetrics
    false_positive_causes: dict[str, Metric]
    breakdowns: dict[str, dict[str, ObjectMetrics]]
    objects: ObjectLedger
    images: FrameLedger
    marked: Metric = NO_CASES


def not_annotated(metrics: Summary) -> str:
    """A sentence on the images that have no scores since they are not annotated; empty without any."""
    images, marked = metrics.images, 100 * metrics.marked.value
    if not images.not_annotated:
        return ""
    which = f"{images.not_annotated} of {images.images} images are not" if images.evaluated else "Not"
    return f"{which} annotated: no scores; on average {marked:.1f} % of their valid pixels are marked."


def take_ratio(sums: pd.DataFrame, definition: Definition) -> Metric:
    """The value of a metric of one slice, with its interval.

    Args:
        sums: numerator and denominator of each recording.
        definition: of the metric.
    """
    held = sums[sums["denominator"] > 0]
    numerators, denominators = held["numerator"].to_numpy(), held["denominator"].to_numpy()
    cases = float(denominators.sum())
    return Metric(
        value=float(numerators.sum()) / cases if cases else math.nan,
        ci95=ratio_interval(numerators, denominators, within=definition.bounds),
        cases=int(cases),
        recordings=len(held),
    )


Key = tuple[str, str, str]  # breakdown, slice and metric


def summary_of(sums: pd.DataFrame, *, protocol: Protocol) -> Summary:
    """Take all metrics of a run from its table of sums."""
    is_count, key = sums["metric"].isin(COUNTS), ["breakdown", "slice", "metric"]
    groups: Iterable[tuple[Any, pd.DataFrame]] = sums[~is_count].groupby(key, sort=False)
    ratios: dict[Key, Metric] = {of: take_ratio(part, find_metric(of[2])) for of, part in groups}
    counts: dict[Key, int] = sums[is_count].groupby(key)["numerator"].sum().astype(int).to_dict()  # type: ignore[assignment]
    of_objects = object_metrics(
        protocol.scoring.detection_levels,
        unknown_bands=protocol.reference.unknown_band is not None,
        ceilings=bool((sums["metric"] == CEILINGS[0].name).any()),
    )

    def metrics(breakdown: str, name: str, definitions: Iterable[Definition]) -> dict[str, Metric]:
        return {m.field: ratios.get((breakdown, name, m.name), NO_CASES) for m in definitions}

    def row(breakdown: str, name: str) -> ObjectMetrics:
        every = ratios.get((breakdown, name, EVERY_ROW[OBJECT_FRAMES]), NO_CASES)
        tracks = counts.get((breakdown, name, "tracks"), 0)
        return ObjectMetrics(
            object_frames=every.cases,
            tracks=tracks,
            recordings=every.recordings,
            **metrics(breakdown, name, of_objects),
        )

    # Also the cameras without a scored image.
    cameras = sorted(name for breakdown, name, metric in counts if (breakdown, metric) == ("camera", "images"))
    breakdowns = object_breakdowns(protocol, cameras).items()
    rows = {breakdown: {name: row(breakdown, name) for name in names} for breakdown, (names, _) in breakdowns}
    images = ratios.get((FRAMES, FRAMES, EVERY_ROW[IMAGE_FRAMES]), NO_CASES)
    of_images = metrics(FRAMES, FRAMES, FALSE_POSITIVES)
    causes = sorted(metric.removeprefix(CAUSE) for split, _, metric in ratios if split == FRAMES and CAUSE in metric)
    return Summary(
        categories=rows.pop(CATEGORY),
        all_moving=rows.pop(ALL_MOVING)[ALL_MOVING],
        false_positives=FalsePositiveMetrics(frames=images.cases, recordings=images.recordings, **of_images),
        segmentation=SegmentationMetrics(**metrics(FRAMES, FRAMES, SEGMENTATION)),
        false_positive_causes={name: ratios[FRAMES, FRAMES, cause_metric(name).name] for name in causes},
        breakdowns=rows,
        objects=_object_ledger(counts),
        images=_frame_ledger(counts),
        marked=ratios.get((FRAMES, FRAMES, MARKED.name), NO_CASES),
    )


def _object_ledger(counts: Mapping[Key, int]) -> ObjectLedger:
    status = {one: counts.get(("status", one.value, "annotated"), 0) for one in Status}
    reasons = {one.value: counts.get(("reason", one.value, "annotated"), 0) for one in IgnoreReason}
    return ObjectLedger(
        annotated=sum(status.values()),
        evaluated=status[Status.EVALUATED],
        static=status[Status.STATIC],
        ignored={reason: count for reason, count in reasons.items() if count},
    )


def _frame_ledger(counts: Mapping[Key, int]) -> FrameLedger:
    ended = {name: counts.get(("status", name, "images"), 0) for name in IMAGE_STATUSES}
    problems = {name: count for (breakdown, name, _), count in counts.items() if breakdown == "problem"}
    return FrameLedger(images=sum(ended.values()), problems=dict(sorted(problems.items())), **ended)

"""What a run comes to: the metrics of the paper's table, as `summary.json` stores them."""

from __future__ import annotations

import math
from collections import Counter
from typing import Annotated

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, model_validator

from bench.evaluation.intervals import MEAN, RATIO, ratio_interval
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows
from bench.evaluation.slices import ALL_MOVING, CATEGORY, FRAMES
from bench.evaluation.sums import (
    CAUSE,
    CEILING_RATIOS,
    FALSE_POSITIVE_RATIOS,
    MEANS,
    OBJECT_RATIOS,
    SEGMENTATION_RATIOS,
    UNKNOWN_RATIO,
    RowLedger,
    RunSums,
    SliceSums,
    SumRatio,
    level_ratios,
    sum_run,
)
from bench.records.reference import IgnoreReason, Status

# 0/0 is NaN in memory and null in JSON.
Ratio = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else value, return_type=float | None, when_used="json"),
]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ProtocolStamp(_Part):
    """Which protocol made the metrics; those of different digests are never put in one table."""

    name: str
    version: int
    digest: str


class Metric(_Part):
    """One metric of a table.

    Attributes:
        value: a ratio in [0, 1], or a mean; NaN without cases.
        ci95: 95 % interval by recording (`bench.evaluation.intervals`); None where fewer than six of them hold cases.
        cases: what the metric is taken over: object-frames, image-frames, or pixels for the segmentation metrics.
        recordings: that hold cases; None in summaries of older versions, which did not count them. Their intervals
            promised more than they held (percentile bootstrap, from two recordings on) and are not taken over.
    """

    value: Ratio
    ci95: tuple[float, float] | None
    cases: int
    recordings: int | None

    @model_validator(mode="before")
    @classmethod
    def _of_older_versions(cls, content: object) -> object:
        if isinstance(content, dict) and "recordings" not in content:
            return content | {"ci95": None, "recordings": None}
        return content


class ObjectMetrics(BaseModel):
    """A row of the table: evaluated object-frames of one kind.

    Beside the declared ones there are, for every detection level of the protocol, `detection_rate_<percent>` and
    `chance_<percent>` (for example `detection_rate_10`), and for protocols with unknown bands `unknown_share`, the mean
    share of the object-frames' possible pixels that is not certain, and for data with exact masks `ceiling_tpr_all` and
    `ceiling_iou`, what these get under the same protocol; `metric(name)` finds all of them.

    Attributes:
        object_frames: how many.
        tracks: objects that they come from.
        recordings: recordings that they come from.
        detection_rate: share with at least one pixel detected.
        chance: the same against the mask of another frame, over the object-frames that have one.
        tpr: mean coverage of the detected object-frames (the paper's wording).
        tpr_all: mean coverage of all object-frames.
        iou: mean IoU of all object-frames; an undetected one has 0.
        iou_detected: mean IoU of the detected object-frames, which is what the paper's column can be compared with.
    """

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Metric]

    object_frames: int
    tracks: int
    recordings: int
    detection_rate: Metric
    chance: Metric
    tpr: Metric
    tpr_all: Metric
    iou: Metric
    iou_detected: Metric

    def metric(self, name: str) -> Metric:
        """A metric by its name in `metric_names()`."""
        found: Metric = getattr(self, name)
        return found

    def metric_names(self) -> tuple[str, ...]:
        """All metrics of the row."""
        declared = [name for name, field in type(self).model_fields.items() if field.annotation is Metric]
        return (*declared, *self.__pydantic_extra__)


class FalsePositiveMetrics(_Part):
    """The last row of the table: image-frames of one kind.

    Attributes:
        frames: scored image-frames.
        recordings: that they come from; None in summaries of older versions.
        coverage: mean of FP / (width x height), the paper's "total area of the image".
        coverage_valid: mean of FP / |V|.
        frame_rate: share of frames with a false-positive component larger than the protocol states.
        components_per_frame: mean number of components of the mask with false-positive pixels.
    """

    frames: int
    recordings: int | None = None
    coverage: Metric
    coverage_valid: Metric
    frame_rate: Metric
    components_per_frame: Metric


class SegmentationMetrics(_Part):
    """The field's usual metrics of the moving class, from summed pixel counts outside I."""

    iou: Metric
    precision: Metric
    recall: Metric
    f1: Metric


class ObjectLedger(_Part):
    """Where every annotated object of every image ended.

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


class FrameLedger(_Part):
    """Where every image ended; `problems` counts the failed and skipped ones by their message."""

    images: int
    evaluated: int
    failed: int
    skipped: int
    problems: dict[str, int]


class Summary(_Part):
    """All metrics of a run.

    Attributes:
        protocol: that made them.
        categories: by name, in the order of the paper's table.
        all_moving: the categories pooled.
        false_positives: over all scored images.
        segmentation: over all scored images.
        false_positive_causes: share of the false-positive pixels by the cause that a method names.
        breakdowns: "object_class", "range_m", "ego_speed_mps", "camera", "points" -> bin or name -> row; the bins are
            written "[a, b)".
        false_positive_breakdowns: "ego_speed_mps", "camera" -> bin or name -> row.
        objects: ledger of the annotated objects.
        images: ledger of the images.
    """

    protocol: ProtocolStamp
    categories: dict[str, ObjectMetrics]
    all_moving: ObjectMetrics
    false_positives: FalsePositiveMetrics
    segmentation: SegmentationMetrics
    false_positive_causes: dict[str, Metric]
    breakdowns: dict[str, dict[str, ObjectMetrics]]
    false_positive_breakdowns: dict[str, dict[str, FalsePositiveMetrics]]
    objects: ObjectLedger
    images: FrameLedger


def ratio_metric(sums: SliceSums, index: int, ratio: SumRatio) -> Metric:
    """The ratio of two sums over one slice.

    Args:
        sums: of a split.
        index: of the slice.
        ratio: names of the accumulators above and below; none below 0, and where it is 0, so is the one above.
    """
    numerators, denominators = (sums.accumulators[name][:, index] for name in ratio)
    cases = float(denominators.sum())
    return Metric(
        value=float(numerators.sum()) / cases if cases else math.nan,
        ci95=ratio_interval(numerators, denominators, within=MEAN if ratio[0] in MEANS else RATIO),
        cases=int(cases),
        recordings=int(np.count_nonzero(denominators)),
    )


def object_metrics(sums: SliceSums, *, protocol: Protocol) -> dict[str, ObjectMetrics]:
    """Take the metrics of every slice of a split.

    Args:
        sums: over the evaluated object-frames.
        protocol: says at which coverages an object counts as detected, and whether regions have unknown bands.
    """
    ratios = OBJECT_RATIOS | level_ratios(protocol.scoring.detection_levels)
    if protocol.reference.unknown_band is not None:
        ratios |= UNKNOWN_RATIO
    if sums.accumulators["with_ceiling"].any():
        ratios |= CEILING_RATIOS
    return {
        name: ObjectMetrics(
            object_frames=int(sums.rows[:, index].sum()),
            tracks=int(sums.tracks[:, index].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, index])),
            **{metric: ratio_metric(sums, index, ratio) for metric, ratio in ratios.items()},
        )
        for index, name in enumerate(sums.names)
    }


def false_positive_metrics(sums: SliceSums) -> dict[str, FalsePositiveMetrics]:
    """Take the false-positive metrics of every slice of a split.

    Args:
        sums: over the scored image-frames.
    """
    return {
        name: FalsePositiveMetrics(
            frames=int(sums.rows[:, index].sum()),
            recordings=int(np.count_nonzero(sums.rows[:, index])),
            **{metric: ratio_metric(sums, index, ratio) for metric, ratio in FALSE_POSITIVE_RATIOS.items()},
        )
        for index, name in enumerate(sums.names)
    }


def segmentation_metrics(sums: SliceSums) -> SegmentationMetrics:
    """Take the metrics of the moving class from summed counts of all images; what lies in I is in none of them."""
    return SegmentationMetrics(**{name: ratio_metric(sums, 0, ratio) for name, ratio in SEGMENTATION_RATIOS.items()})


def false_positive_causes(sums: SliceSums) -> dict[str, Metric]:
    """Share of the false-positive pixels by the cause that the method names, by name; empty if it names none."""
    names = sorted(name.removeprefix(CAUSE) for name in sums.accumulators if name.startswith(CAUSE))
    return {name: ratio_metric(sums, 0, (CAUSE + name, "fp")) for name in names}


def object_ledger(ledger: RowLedger) -> ObjectLedger:
    """The ledger of the objects table."""
    status = ledger.statuses
    reasons = {reason: ledger.reasons[Status.IGNORED.value, reason.value] for reason in IgnoreReason}
    found = ObjectLedger(
        annotated=ledger.rows,
        evaluated=status[Status.EVALUATED.value],
        static=status[Status.STATIC.value],
        ignored={reason.value: count for reason, count in reasons.items() if count},
    )
    ended = found.evaluated + found.static + sum(found.ignored.values())
    assert ended == found.annotated, "every annotated object is evaluated, static or ignored for a known reason"
    return found


def frame_ledger(ledger: RowLedger) -> FrameLedger:
    """The ledger of the frames table; the problems by their message."""
    status, problems = ledger.statuses, Counter[str]()
    for (_, problem), count in ledger.reasons.items():
        if problem:
            problems[problem] += count
    found = FrameLedger(
        images=ledger.rows,
        evaluated=status["evaluated"],
        failed=status["failed"],
        skipped=status["skipped"],
        problems=dict(sorted(problems.items())),
    )
    assert found.evaluated + found.failed + found.skipped == found.images, "every image is scored or accounted for"
    return found


def summarise(objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None) -> Summary:
    """Reduce the tables of a run to its metrics.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order, in memory or stored.
        frames: of `FRAMES_SCHEMA`, rows in any order, in memory or stored.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; changes no byte of the summary.
    """
    return summary_of(sum_run(objects, frames, protocol=protocol, rows_at_once=rows_at_once), protocol=protocol)


def summary_of(sums: RunSums, *, protocol: Protocol) -> Summary:
    """All metrics of a run from its sums."""
    of_objects = {split: object_metrics(part, protocol=protocol) for split, part in sums.objects.items()}
    of_frames = {split: false_positive_metrics(part) for split, part in sums.frames.items()}
    return Summary(
        protocol=ProtocolStamp(name=protocol.name, version=protocol.version, digest=protocol.digest),
        categories=of_objects.pop(CATEGORY),
        all_moving=of_objects.pop(ALL_MOVING)[ALL_MOVING],
        false_positives=of_frames.pop(FRAMES)[FRAMES],
        segmentation=segmentation_metrics(sums.frames[FRAMES]),
        false_positive_causes=false_positive_causes(sums.frames[FRAMES]),
        breakdowns=of_objects,
        false_positive_breakdowns=of_frames,
        objects=object_ledger(sums.object_ledger),
        images=frame_ledger(sums.frame_ledger),
    )

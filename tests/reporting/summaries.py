"""Summaries with numbers that a reader can follow into the tables."""

from __future__ import annotations

import math

from bench.evaluation.summary import (
    FalsePositiveMetrics,
    FrameLedger,
    Metric,
    ObjectLedger,
    ObjectMetrics,
    SegmentationMetrics,
    Summary,
)
from bench.records.reference import Category

RATES = {
    Category.CROSSING: 0.7214,
    Category.OVERTAKING: 1.0,
    Category.PRECEDING: 0.3333333333333333,
    Category.APPROACHING: 0.5,
}


def figure(value: float, *, cases: int = 100, spread: float = 0.05) -> Metric:
    if math.isnan(value):
        return Metric(value=value, ci95=None, cases=0, recordings=0)
    ends = max(value - spread, 0.0), min(value + spread, 1.0)
    return Metric(value=value, ci95=ends, cases=cases, recordings=8)


def object_figures(rate: float, *, object_frames: int = 100, tracks: int = 7) -> ObjectMetrics:
    cases = 0 if math.isnan(rate) else object_frames
    shares = {
        "detection_rate": 1.0, "detection_rate_10": 0.9, "detection_rate_50": 0.5, "chance": 0.4, "chance_10": 0.2,
        "chance_50": 0.1, "tpr": 0.8, "tpr_all": 0.7, "iou": 0.45, "iou_detected": 0.6,
    }  # fmt: skip
    return ObjectMetrics(
        object_frames=cases,
        tracks=tracks if cases else 0,
        recordings=8 if cases else 0,
        **{name: figure(share * rate, cases=cases) for name, share in shares.items()},
    )


def banded_summary() -> Summary:
    """The same under a protocol with unknown bands: a quarter of each row is unknown."""
    found = summary()
    banded = {
        name: row.model_copy(update={"unknown_share": figure(0.25, cases=row.object_frames)})
        for name, row in (found.categories | {"all": found.all_moving}).items()
    }
    return found.model_copy(update={"all_moving": banded.pop("all"), "categories": banded})


def summary() -> Summary:
    """All categories but the static host, which has no cases."""
    categories = {c.value: object_figures(RATES.get(c, math.nan)) for c in Category if c is not Category.MOVING}
    return Summary(
        categories=categories,
        all_moving=object_figures(0.6),
        false_positives=FalsePositiveMetrics(
            frames=250,
            recordings=9,
            coverage=figure(0.1052),
            coverage_valid=figure(0.15),
            frame_rate=figure(0.88),
            components_per_frame=Metric(value=12.5, ci95=(11.0, 14.25), cases=250, recordings=9),
        ),
        segmentation=SegmentationMetrics(iou=figure(0.2), precision=figure(0.3), recall=figure(0.7), f1=figure(0.4)),
        false_positive_causes={},
        breakdowns={},
        objects=ObjectLedger(annotated=400, evaluated=400, static=0, ignored={}),
        images=FrameLedger(images=250, evaluated=250, failed=0, skipped=0, problems={}),
    )

"""The rows of the paper's table, ours beside the paper's; every form of the table is written from these."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from bench.evaluation import published
from bench.evaluation.summary import FalsePositiveMetrics, Metric, ObjectMetrics, Summary
from bench.reference.records import Category

LABELS = {
    Category.CROSSING: "Crossing (epipolar)",
    Category.OVERTAKING: "Overtaking (positive depth)",
    Category.PRECEDING: "Preceding (positive height)",
    Category.APPROACHING: "Approaching (anti-parallel)",
    Category.STATIC_EGO: "Static ego-vehicle (degenerate)",
    Category.MOVING: "Moving (kind not told)",
}
FALSE_POSITIVES = "false_positives"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One figure, ours and the paper's; ratios in [0, 1].

    Attributes:
        value: ours; NaN without cases.
        ci95: 95 % interval of ours; None where there is none.
        cases: what ours is taken over.
        paper: the paper's; NaN where it has none.
    """

    value: float
    ci95: tuple[float, float] | None
    cases: int
    paper: float

    @property
    def difference_points(self) -> float:
        """Ours minus the paper's in percentage points; NaN where either is missing."""
        return round(100.0 * (self.value - self.paper), 10)  # without the noise of binary fractions


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One row of the table.

    Attributes:
        name: category, or "false_positives".
        label: as in the paper.
        frames: object-frames, in the last row image-frames.
        paper_frames: the paper's.
        tracks: objects; None in the last row.
        recordings: that hold the frames; None in the last row of a summary of an older version.
        figures: by the names of `ObjectMetrics`, in the last row of `FalsePositiveMetrics`.
    """

    name: str
    label: str
    frames: int
    paper_frames: int
    tracks: int | None
    recordings: int | None
    figures: Mapping[str, Comparison]


def table_rows(summary: Summary) -> list[TableRow]:
    """The rows of the table: the categories in the paper's order, then the false positives.

    The paper's TPR and IoU stand beside ours over the detected object-frames: as averages over all of them they would
    contradict its detection rate (0.72 x 0.64 is less than 0.55).
    """
    rows = [_category_row(Category(name), figures) for name, figures in summary.categories.items()]
    return [*rows, _false_positive_row(summary.false_positives)]


def _category_row(category: Category, figures: ObjectMetrics) -> TableRow:
    theirs = published.CATEGORIES.get(category)
    paper = {"detection_rate": theirs.detection_rate, "tpr": theirs.tpr, "iou_detected": theirs.iou} if theirs else {}
    return TableRow(
        name=category.value,
        label=LABELS[category],
        frames=figures.object_frames,
        paper_frames=theirs.object_frames if theirs else 0,
        tracks=figures.tracks,
        recordings=figures.recordings,
        figures={name: _compare(figures.metric(name), paper.get(name)) for name in figures.metric_names()},
    )


def _false_positive_row(figures: FalsePositiveMetrics) -> TableRow:
    return TableRow(
        name=FALSE_POSITIVES,
        label="False positives",
        frames=figures.frames,
        paper_frames=published.IMAGE_FRAMES,
        tracks=None,
        recordings=figures.recordings,
        figures={
            "coverage": _compare(figures.coverage, published.FALSE_POSITIVE_COVERAGE),
            "coverage_valid": _compare(figures.coverage_valid, None),
            "frame_rate": _compare(figures.frame_rate, None),
            "components_per_frame": _compare(figures.components_per_frame, None),
        },
    )


def _compare(figure: Metric, paper: float | None) -> Comparison:
    return Comparison(
        value=figure.value, ci95=figure.ci95, cases=figure.cases, paper=math.nan if paper is None else paper
    )

"""The same detections and better ones, against lidar polygons and exact masks."""

from __future__ import annotations

import math

from bench.evaluation import Figure, ObjectFigures
from bench.harness.audit import AuditSummary, Scoring
from bench.reference import Category
from bench.reporting.audit_sheet import AuditTable
from bench.reporting.numbers import count
from bench.reporting.sheets import INTERVALS, Sheet
from bench.reporting.tables import LABELS

SCORINGS = {
    Scoring.LIDAR: "lidar polygons",
    Scoring.MASKS: "exact masks",
    Scoring.EXACT_MOTION: "+ exact motion",
    Scoring.EXACT_FLOW: "+ exact flow",
    Scoring.CELLS: "perfect cells",
}
RATES = {"detection_rate": "Detection", "detection_rate_50": "Detection at 50 %"}
COVERAGES = {"tpr": "TPR, detected", "tpr_all": "TPR, all", "iou": "IoU, all", "iou_detected": "IoU, detected"}


def score_table(audit: AuditSummary) -> AuditTable:
    """One line per kind of motion and scoring, then the false positives."""
    first = next(iter(audit.scores.values()))
    rates = {name: heading for name, heading in RATES.items() if name in first.all_moving.figure_names()}
    rows = []
    for category, found in first.categories.items():
        if not found.object_frames:
            continue
        for scoring, scores in audit.scores.items():
            cells = _cells(scores.categories[category], rates)
            rows.append((LABELS[Category(category)], SCORINGS[Scoring(scoring)], *cells))
    for scoring, scores in audit.scores.items():
        false = scores.false_positives
        blank = [""] * (len(rates) + len(COVERAGES) - 1)
        head = "False positives", SCORINGS[Scoring(scoring)], count(false.recordings), str(false.frames)
        rows.append((*head, _figure(false.coverage), *blank))
    return AuditTable(
        sheet=Sheet(
            title="What the reference, the ego-motion and the flow do to the score, in percent",
            headings=("Type", "Scored", "Recordings", "Frames", *rates.values(), *COVERAGES.values()),
            rows=tuple(rows),
        ),
        note="The same object-frames in all lines of a type; types without any are left out. Lidar polygons: the "
        "benchmark. Exact masks: the same detections. Exact motion: ego-motion, calibration and road are exact, the "
        "flow is estimated. Exact flow: nothing is estimated, the method's own limit; the flow is that of each cell's "
        "centre. Perfect cells: every cell whose centre shows a moving object and no other, the limit of the grid. "
        f"False positives: area of the image. {INTERVALS}",
        labels=2,
    )


def _cells(row: ObjectFigures, rates: dict[str, str]) -> tuple[str, ...]:
    plain = [_figure(row.figure(name), interval=False) for name in rates]
    return (
        str(row.recordings),
        str(row.object_frames),
        *plain,
        *(_figure(row.figure(name), interval=name != "tpr") for name in COVERAGES),
    )


def _figure(figure: Figure, *, interval: bool = True) -> str:
    if math.isnan(figure.value):
        return "n/a"
    bounds = figure.ci95 if interval else None
    return f"{100 * figure.value:.1f}" + ("" if bounds is None else f" {100 * bounds[0]:.0f}-{100 * bounds[1]:.0f}")

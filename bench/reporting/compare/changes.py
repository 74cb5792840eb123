"""What changed from one run to another, by row of the table and metric."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bench.evaluation import Protocol
from bench.evaluation.run_sums import RunSums
from bench.evaluation.score_sheet import PairedChange, holm, paired_change, sheet_of
from bench.evaluation.slices import ALL_MOVING, FRAMES
from bench.evaluation.summary import Figure, Summary
from bench.evaluation.totals import figures_of
from bench.reporting.compare.verdicts import Verdict, judge

FALSE_POSITIVE_COVERAGE = "false_positive_coverage"
# The metrics that are judged, and the only ones whose p-values are corrected.
HEADLINES = {
    "detection_rate": "Detection rate",
    "tpr": "TPR, detected",
    "iou_detected": "IoU, detected",
    FALSE_POSITIVE_COVERAGE: "False-positive coverage",
}
_OF_FRAMES = (FALSE_POSITIVE_COVERAGE, "false_positive_coverage_valid", "false_positive_frame_rate", "segmentation_iou",
              "precision", "recall")  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """One metric of one row.

    Attributes:
        change: before, after, and the paired interval.
        p_holm: p-value corrected over the rows of the metric; None for metrics that are not headlines, and where there
            is no p-value.
        verdict: None for metrics that are not headlines.
        chance: chance level before and after; None where the metric has none.
    """

    change: PairedChange
    p_holm: float | None
    verdict: Verdict | None
    chance: tuple[Figure, Figure] | None


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


def row_changes(sums_before: RunSums, sums_after: RunSums, *, rules: Protocol) -> list[RowChange]:
    """Compare the categories, all moving objects, and the false positives.

    Holm's correction runs over the rows of one headline metric that have a p-value: the categories and the row of all
    moving objects. False-positive coverage has one row, so that its p-value stays as it is. A row without a p-value
    (cases of both in fewer than six recordings) does not count.

    Args:
        sums_before: of the run compared against.
        sums_after: of the other run.
        rules: their protocol.
    """
    before, after = (sheet_of(sums, protocol=rules) for sums in (sums_before, sums_after))
    summaries = figures_of(sums_before, protocol=rules), figures_of(sums_after, protocol=rules)
    of_objects = [*(str(category) for category in rules.reference.categories), ALL_MOVING]
    names = {row: [name for name in before.slices[row] if name not in _OF_FRAMES] for row in of_objects}
    names[FRAMES] = list(_OF_FRAMES)
    sums = {(row, m): (before.slices[row][m], after.slices[row][m]) for row, metrics in names.items() for m in metrics}
    changes = {key: paired_change(*pair) for key, pair in sums.items()}
    corrected = _corrected({key: change.p_value for key, change in changes.items()})

    def metric_change(row: str, metric: str) -> MetricChange:
        key = row, metric
        verdict = None
        if metric in HEADLINES:
            lower = metric == FALSE_POSITIVE_COVERAGE
            verdict = judge(changes[key], p_holm=corrected[key], lower_is_better=lower)
        return MetricChange(
            change=changes[key],
            p_holm=corrected.get(key),
            verdict=verdict,
            chance=_chance(row, metric, summaries),
        )

    return [
        RowChange(
            name=row,
            label=_label(row),
            frames=before.counts[row]["evaluated" if row == FRAMES else "object_frames"],
            recordings=len(sums[row, metrics[0]][0].denominators),
            metrics={metric: metric_change(row, metric) for metric in metrics},
        )
        for row, metrics in names.items()
    ]


def headline_changes(rows: list[RowChange]) -> list[tuple[str, MetricChange]]:
    """The headline metrics over everything: all moving objects, and the false positives of all images."""
    by_name = {row.name: row for row in rows}
    return [(m, by_name[FRAMES if m == FALSE_POSITIVE_COVERAGE else ALL_MOVING].metrics[m]) for m in HEADLINES]


def _corrected(p_values: Mapping[tuple[str, str], float | None]) -> dict[tuple[str, str], float | None]:
    corrected: dict[tuple[str, str], float | None] = {}
    for metric in HEADLINES:
        keys = [key for key in p_values if key[1] == metric]
        corrected |= dict(zip(keys, holm([p_values[key] for key in keys]), strict=True))
    return corrected


def _chance(row: str, metric: str, summaries: tuple[Summary, Summary]) -> tuple[Figure, Figure] | None:
    if not metric.startswith("detection_rate"):
        return None
    name = metric.replace("detection_rate", "chance")
    before, after = (s.all_moving if row == ALL_MOVING else s.categories[row] for s in summaries)
    return before.figure(name), after.figure(name)


def _label(row: str) -> str:
    return "False positives" if row == FRAMES else row.replace("_", " ").capitalize()

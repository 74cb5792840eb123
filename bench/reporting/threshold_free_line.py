"""The figures that need no threshold, in a sentence."""

from __future__ import annotations

from bench.evaluation import Metric, ThresholdFreeMetrics
from bench.reporting.sheets import percent


def threshold_free_line(figures: ThresholdFreeMetrics) -> str:
    """For example "Over all thresholds: AUPRC 71.2 % [60.1, 80.3], ... ", with what the bins leave open."""
    return (
        f"Over all thresholds: AUPRC {_with_interval(figures.auprc)}, false-positive rate at 95 % recall "
        f"{_with_interval(figures.fpr95)}; over the pixels of {figures.images} images, from histograms: without bins "
        f"AUPRC lies in {_span(figures.auprc_bounds)}, the rate in {_span(figures.fpr95_bounds)}."
    )


def _with_interval(figure: Metric) -> str:
    interval = "" if figure.ci95 is None else f" [{100 * figure.ci95[0]:.1f}, {100 * figure.ci95[1]:.1f}]"
    return percent(figure.value, cases=figure.cases) + interval


def _span(bounds: tuple[float, float]) -> str:
    return " to ".join(percent(bound, digits=2) for bound in bounds)

"""A metric of two runs over the same recordings: what changed, and whether chance could have done it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.bootstrap import CONFIDENCE, resample, sequence_weights
from bench.evaluation.metric_sums import MetricSums

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedChange:
    """How a metric changed from one run to another over the same recordings.

    Attributes:
        before: value, NaN without cases.
        after: value, NaN without cases.
        difference: after minus before.
        ci95: 95 % interval of the difference by cluster bootstrap over recordings; None where either run has cases in
            fewer than two recordings.
        p_value: two-sided, of no change; None where `ci95` is.
        cases_before: of `before`.
        cases_after: of `after`.
        recordings: with cases in either run.
    """

    before: float
    after: float
    difference: float
    ci95: tuple[float, float] | None
    p_value: float | None
    cases_before: int
    cases_after: int
    recordings: int


def paired_change(before: MetricSums, after: MetricSums, *, draws: int, seed: int) -> PairedChange:
    """Compare a metric of two runs over the same data.

    The recordings with cases in either run are resampled with replacement, both runs by the same draws. Draws in which
    one run has no case (0/0) are left out. Such an interval is too narrow for few recordings: of two that changed the
    same way, every draw says so. Between runs that differ by chance alone, p fell below 0.05 in 44 % of simulated
    pairs over 2 recordings, 21 % over 3, 16 % over 5, 10 % over 10, and 8 % over 20 and 40; who judges asks for
    enough of them.

    Args:
        before: sums of the one run.
        after: sums of the other.
        draws: how many times to resample.
        seed: of the generator.

    Source:
        Percentile interval and its inversion to a p-value, Efron and Tibshirani 1993, sections 13.3 and 15.4; one is
        added to both counts, Davison and Hinkley 1997, section 4.2, so that no p-value is 0.
    """
    recordings = sorted(before.denominators.keys() | after.denominators.keys())
    ci95, p_value = None, None
    if min(len(before.denominators), len(after.denominators)) >= 2:
        weights = sequence_weights(len(recordings), draws=draws, seed=seed)
        drawn = _drawn(after, recordings, weights) - _drawn(before, recordings, weights)
        both = drawn[~np.isnan(drawn)]
        ci95, p_value = _interval_and_p_value(both) if len(both) else (None, None)
    return PairedChange(
        before=before.value,
        after=after.value,
        difference=after.value - before.value,
        ci95=ci95,
        p_value=p_value,
        cases_before=before.cases,
        cases_after=after.cases,
        recordings=len(recordings),
    )


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Correct p-values for being several; None, which is no test, stays None and is not counted.

    Source:
        Holm 1979, A simple sequentially rejective multiple test procedure.
    """
    tests = sorted((p, place) for place, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, place) in enumerate(tests):
        largest = max(largest, min(1.0, (len(tests) - rank) * p))
        corrected[place] = largest
    return corrected


def _drawn(sums: MetricSums, recordings: list[str], weights: Column) -> Column:
    """(draws,) the metric in each draw, NaN where it has no case."""
    numerator, denominator = (
        resample(np.array([by_recording.get(name, 0.0) for name in recordings]), weights=weights)
        for by_recording in (sums.numerators, sums.denominators)
    )
    return np.where(denominator > 0, numerator / np.where(denominator > 0, denominator, 1), np.nan)


def _interval_and_p_value(drawn: Column) -> tuple[tuple[float, float], float]:
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail])
    other_side = min(np.count_nonzero(drawn <= 0), np.count_nonzero(drawn >= 0))
    return (float(low), float(high)), min(1.0, 2 * (int(other_side) + 1) / (len(drawn) + 1))

"""Ratios of sums by recording, with their intervals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.bootstrap import cluster_interval
from bench.evaluation.slice_sums import SliceSums
from bench.evaluation.summary import Figure
from bench.evaluation.terms import Ratio


def ratio_figure(sums: SliceSums, place: int, ratio: Ratio, *, weights: NDArray[np.float64]) -> Figure:
    """The ratio of two sums over one slice.

    Args:
        sums: of a split.
        place: of the slice.
        ratio: names of the terms above and below; none below 0, and where it is 0, so is the one above.
        weights: (draws, S) float64, from `sequence_weights`.
    """
    numerators, denominators = (sums.terms[name][:, place] for name in ratio)
    cases = float(denominators.sum())
    return Figure(
        value=float(numerators.sum()) / cases if cases else math.nan,
        ci95=cluster_interval(numerators, denominators, weights=weights),
        cases=int(cases),
    )

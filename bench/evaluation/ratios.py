"""Ratios of sums by recording, with their intervals."""

from __future__ import annotations

import math

import numpy as np

from bench.evaluation.intervals import MEAN, RATIO, ratio_interval
from bench.evaluation.slice_sums import SliceSums
from bench.evaluation.summary import Figure
from bench.evaluation.terms import MEANS, Ratio


def ratio_figure(sums: SliceSums, place: int, ratio: Ratio) -> Figure:
    """The ratio of two sums over one slice.

    Args:
        sums: of a split.
        place: of the slice.
        ratio: names of the terms above and below; none below 0, and where it is 0, so is the one above.
    """
    numerators, denominators = (sums.terms[name][:, place] for name in ratio)
    cases = float(denominators.sum())
    return Figure(
        value=float(numerators.sum()) / cases if cases else math.nan,
        ci95=ratio_interval(numerators, denominators, within=MEAN if ratio[0] in MEANS else RATIO),
        cases=int(cases),
        recordings=int(np.count_nonzero(denominators)),
    )

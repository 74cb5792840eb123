"""What a paired change allows to be said, never more than its interval."""

from __future__ import annotations

import math
from enum import StrEnum

from bench.evaluation.score_sheet import PairedChange

SIGNIFICANCE = 0.05
# That n recordings all change the same way by chance has the probability 2 / 2**n: above 5 % up to n = 5. The bootstrap
# of so few knows nothing of that, as all its draws agree; so nothing is concluded before six.
FEWEST_RECORDINGS = 6


class Verdict(StrEnum):
    """A change in words."""

    BETTER = "better"
    WORSE = "worse"
    NOT_SHOWN = "no difference that the data can show"
    THE_SAME = "the same"
    TOO_FEW = "too few recordings to judge"
    NO_CASES = "no cases in one of the runs"


def judge(change: PairedChange, *, p_holm: float | None, recordings: int, lower_is_better: bool) -> Verdict:
    """Say what a change shows.

    Args:
        change: of a metric.
        p_holm: its p-value, corrected for the rows of the metric.
        recordings: with cases in both runs.
        lower_is_better: of the metric.

    Returns:
        Better or worse only if the 95 % interval excludes 0, the corrected p-value is at most 5 %, and there are at
        least `FEWEST_RECORDINGS` recordings.

    Source:
        Sign test, Conover 1999, Practical Nonparametric Statistics, section 3.4.
    """
    if math.isnan(change.difference):
        return Verdict.NO_CASES
    if change.difference == 0 and change.ci95 in (None, (0.0, 0.0)):
        return Verdict.THE_SAME
    if change.ci95 is None or p_holm is None or recordings < FEWEST_RECORDINGS:
        return Verdict.TOO_FEW
    low, high = change.ci95
    if low <= 0 <= high or p_holm > SIGNIFICANCE:
        return Verdict.NOT_SHOWN
    return Verdict.BETTER if (change.difference < 0) == lower_is_better else Verdict.WORSE

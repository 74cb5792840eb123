"""What a paired change allows to be said, never more than its interval."""

from __future__ import annotations

import math
from enum import StrEnum

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.score_sheet import PairedChange

SIGNIFICANCE = 0.05


class Verdict(StrEnum):
    """A change in words."""

    BETTER = "better"
    WORSE = "worse"
    NOT_SHOWN = "no difference that the data can show"
    THE_SAME = "the same"
    TOO_FEW = "too few recordings for a verdict"
    NO_CASES = "no cases in one of the runs"


def judge(change: PairedChange, *, p_holm: float | None, lower_is_better: bool) -> Verdict:
    """Say what a change shows.

    Args:
        change: of a metric.
        p_holm: its p-value, corrected for the rows of the metric.
        lower_is_better: of the metric.

    Returns:
        Better or worse only if the 95 % interval excludes 0 and the corrected p-value is at most 5 %; neither is there
        for fewer than six recordings.
    """
    if math.isnan(change.difference):
        return Verdict.NO_CASES
    if change.difference == 0 and change.ci95 is None:
        return Verdict.THE_SAME
    if change.ci95 is None or p_holm is None:
        return Verdict.TOO_FEW
    low, high = change.ci95
    if low <= 0 <= high or p_holm > SIGNIFICANCE:
        return Verdict.NOT_SHOWN
    return Verdict.BETTER if (change.difference < 0) == lower_is_better else Verdict.WORSE


def verdict_text(verdict: Verdict, change: PairedChange) -> str:
    """A verdict for people, for example "better" or "too few recordings for a verdict: 4, needs 6"."""
    if verdict is Verdict.TOO_FEW:
        return f"{verdict.value}: {change.recordings}, needs {FEWEST_RECORDINGS}"
    return verdict.value

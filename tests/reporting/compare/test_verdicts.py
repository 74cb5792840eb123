import math
from dataclasses import replace

import pytest

from bench.evaluation import PairedChange
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting.compare.changes import Verdict, judge

CHANGE = PairedChange(
    before=0.5, after=0.6, difference=0.1, ci95=(0.05, 0.15), p_value=0.001, cases_before=9, cases_after=9, recordings=9
)
FALL = replace(CHANGE, difference=-0.1, ci95=(-0.15, -0.05))


@pytest.mark.parametrize(
    ("change", "p_holm", "lower_is_better", "verdict"),
    [
        (CHANGE, 0.01, False, Verdict.BETTER),
        (CHANGE, 0.01, True, Verdict.WORSE),
        (FALL, 0.01, False, Verdict.WORSE),
        (FALL, 0.01, True, Verdict.BETTER),
        (CHANGE, 0.051, False, Verdict.NOT_SHOWN),
        (replace(CHANGE, ci95=(0.0, 0.15)), 0.01, False, Verdict.NOT_SHOWN),
        (replace(CHANGE, ci95=(-0.01, 0.15)), 0.01, False, Verdict.NOT_SHOWN),
        (replace(CHANGE, ci95=None), None, False, Verdict.TOO_FEW),
        (replace(CHANGE, difference=0.0, ci95=None), 1.0, False, Verdict.THE_SAME),
        (replace(CHANGE, difference=0.0, ci95=(-0.1, 0.1)), 1.0, False, Verdict.NOT_SHOWN),
        (replace(CHANGE, after=math.nan, difference=math.nan, ci95=None), None, False, Verdict.NO_CASES),
    ],
)
def test_no_more_is_said_than_the_interval_allows(change, p_holm, lower_is_better, verdict):
    assert judge(change, p_holm=p_holm, improvement=change.difference * (-1 if lower_is_better else 1)) is verdict


def test_the_fewest_recordings_are_those_of_a_sign_test():
    assert 2 / 2**FEWEST_RECORDINGS <= 0.05 < 2 / 2 ** (FEWEST_RECORDINGS - 1)

import math

import pytest

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting.compare import Shown, what_is_shown

RISE = {"difference": 0.1, "ci95": (0.05, 0.15), "p_holm": 0.01}
FALL = {"difference": -0.1, "ci95": (-0.15, -0.05), "p_holm": 0.01}


@pytest.mark.parametrize(
    ("change", "lower_is_better", "verdict"),
    [
        (RISE, False, Shown.BETTER),
        (RISE, True, Shown.WORSE),
        (FALL, False, Shown.WORSE),
        (FALL, True, Shown.BETTER),
        (RISE | {"p_holm": 0.051}, False, Shown.NOT_SHOWN),
        (RISE | {"ci95": (0.0, 0.15)}, False, Shown.NOT_SHOWN),
        (RISE | {"ci95": (-0.01, 0.15)}, False, Shown.NOT_SHOWN),
        (RISE | {"ci95": None, "p_holm": math.nan}, False, Shown.TOO_FEW),
        ({"difference": 0.0, "ci95": None, "p_holm": 1.0}, False, Shown.THE_SAME),
        ({"difference": 0.0, "ci95": (-0.1, 0.1), "p_holm": 0.01}, False, Shown.NOT_SHOWN),
        ({"difference": math.nan, "ci95": None, "p_holm": math.nan}, False, Shown.NO_CASES),
    ],
)
def test_no_more_is_said_than_the_interval_allows(change, lower_is_better, verdict):
    improvement = change["difference"] * (-1 if lower_is_better else 1)
    assert what_is_shown(change | {"improvement": improvement}) is verdict


def test_the_fewest_recordings_are_those_of_a_sign_test():
    assert 2 / 2**FEWEST_RECORDINGS <= 0.05 < 2 / 2 ** (FEWEST_RECORDINGS - 1)

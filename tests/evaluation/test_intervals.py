"""Intervals that take recordings as independent."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.evaluation.intervals import (
    MEAN,
    RATIO,
    RATIO_CHANGE,
    Jackknife,
    ValueBounds,
    degrees_of_freedom,
    jackknife,
    ratio_interval,
)

PAIRS = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=6, max_size=12)


def interval(
    numerators: list[float], denominators: list[float], within: ValueBounds = RATIO
) -> tuple[float, float] | None:
    return ratio_interval(np.array(numerators, dtype=float), np.array(denominators, dtype=float), within=within)


def exact_degrees(counts: list[int]) -> float:
    """The definition, pair by pair, in fractions."""
    w = [Fraction(count, sum(counts)) for count in counts]
    c, square = [(share / (1 - share)) ** 2 for share in w], sum(share**2 for share in w)
    pairs = [(i, j, (i == j) + square - w[i] - w[j]) for i in range(len(w)) for j in range(len(w))]
    expected = sum(c[i] * cov for i, j, cov in pairs if i == j)
    return float(expected**2 / sum(c[i] * c[j] * cov**2 for i, j, cov in pairs))


def test_a_ratio_and_a_mean_of_equal_recordings_to_check_by_hand() -> None:
    # Ten recordings of the same size, half at 0.4 and half at 0.6: standard error sqrt((0.1 / 3)^2), t of 9 degrees.
    logit = 2.2622 * (0.1 / 3) / (0.5 * 0.5)
    ends = 1 / (1 + math.exp(logit)), 1 / (1 + math.exp(-logit))
    assert interval([4, 6] * 5, [10] * 10) == pytest.approx(ends, abs=1e-4)
    reach = 2.2622 * (1 / 3) / 5
    ends = 5 * math.exp(-reach), 5 * math.exp(reach)
    assert interval([40, 60] * 5, [10] * 10, within=MEAN) == pytest.approx(ends, abs=1e-3)


def test_no_interval_from_fewer_than_six_recordings_with_cases_and_those_without_change_nothing() -> None:
    some, none = [1.0, 2, 3, 4, 5, 5], [0.0] * 20
    for recordings in range(6):
        assert interval(some[:recordings], [10] * recordings) is None
        assert interval(some[:recordings] + none, [10] * recordings + none) is None
    assert interval(some + none, [10] * 6 + none) == interval(some, [10] * 6) is not None


def test_all_perfect_recordings_leave_open_what_was_not_seen() -> None:
    # If more than 39 % of the recordings were not perfect, six perfect ones would come in less than 5 % of the draws.
    assert interval([10] * 6, [10] * 6) == pytest.approx((0.05 ** (1 / 6), 1.0))
    assert interval([0] * 6, [10] * 6) == pytest.approx((0.0, 1 - 0.05 ** (1 / 6)))
    low, _ = interval([10] * 100, [10] * 100) or (0, 0)
    assert low == pytest.approx(0.970, abs=1e-3)


def test_recordings_that_agree_below_perfect_leave_open_as_much_to_both_sides() -> None:
    unseen = 1 - 0.05 ** (1 / 6)
    found = interval([3, 6, 1.5, 3, 3, 3], [4, 8, 2, 4, 4, 4])
    assert found == pytest.approx((0.75 * (1 - unseen), 0.75 + 0.25 * unseen))
    assert interval([0] * 6, [4] * 6, within=MEAN) is None
    assert interval([0] * 6, [4] * 6, within=RATIO_CHANGE) == pytest.approx((-unseen, unseen))


@given(PAIRS)
def test_an_interval_lies_around_its_metric_and_within_what_is_possible(pairs: list[tuple[int, int]]) -> None:
    numerators, denominators = [float(min(p)) for p in pairs], [float(max(p)) for p in pairs]
    found = interval(numerators, denominators)
    assert (found is None) == (sum(d > 0 for d in denominators) < 6)
    if found is not None:
        value = sum(numerators) / sum(denominators)
        assert 0 <= found[0] <= value + 1e-12
        assert value - 1e-12 <= found[1] <= 1
        assert found[1] - found[0] > 0


@given(PAIRS)
def test_misses_mirror_hits(pairs: list[tuple[int, int]]) -> None:
    hits, every = [float(min(p)) for p in pairs], [float(max(p)) for p in pairs]
    found, mirrored = interval(hits, every), interval([e - h for h, e in zip(hits, every, strict=True)], every)
    assert mirrored == (found and pytest.approx((1 - found[1], 1 - found[0]), abs=1e-9))


@given(st.lists(st.integers(1, 1000), min_size=6, max_size=9), st.sampled_from([0, 10**4, 10**6, 10**9]))
def test_degrees_of_freedom_are_those_of_the_definition(counts: list[int], more: int) -> None:
    counts[0] += more
    found = degrees_of_freedom(np.array(counts) / sum(counts))
    assert found == pytest.approx(exact_degrees(counts), rel=1e-9)
    assert 1 - 1e-9 <= found <= len(counts) - 1 + 1e-9


def test_one_large_recording_widens_the_interval() -> None:
    even, odd = interval([4, 6] * 5, [10] * 10), interval([400, 600] + [4, 6] * 4, [1000, 1000] + [10] * 8)
    assert np.ptp(odd) > 2 * np.ptp(even)


@given(PAIRS, st.floats(-0.9, 0.9))
def test_the_p_value_of_an_end_is_five_percent(pairs: list[tuple[int, int]], shift: float) -> None:
    without = shift + np.array([0.001 * (a - b) for a, b in pairs])
    found = jackknife(shift, without, shares=np.full(len(pairs), 1 / len(pairs)))
    assume(found.standard_error > 0)
    ends = found.interval(RATIO_CHANGE)
    assert ends is not None
    assume(ends[0] > -0.999 and ends[1] < 0.999)
    assert [found.p_value(RATIO_CHANGE, of=end) for end in ends] == pytest.approx([0.05, 0.05], rel=1e-3)


def test_the_sign_test_speaks_where_all_recordings_agree() -> None:
    agreed = Jackknife(value=0.3, standard_error=0.0, degrees=5.0, recordings=6)
    assert agreed.p_value(RATIO_CHANGE) == 2 / 2**6
    assert agreed.p_value(RATIO_CHANGE, of=0.3) == 1.0

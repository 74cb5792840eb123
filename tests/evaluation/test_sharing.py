"""Whole pixels shared in proportion."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from bench.evaluation.counts import share_in_proportion


def test_seven_pixels_over_three_equal_weights() -> None:
    assert share_in_proportion(np.array([7]), weights=np.array([[1, 1, 1]])).tolist() == [3, 2, 2]


def test_a_row_without_weight_gives_nothing() -> None:
    assert share_in_proportion(np.array([7, 2]), weights=np.array([[0, 0], [0, 5]])).tolist() == [0, 2]


def test_no_columns_and_no_rows() -> None:
    assert share_in_proportion(np.array([7]), weights=np.zeros((1, 0), dtype=np.int64)).shape == (0,)
    assert share_in_proportion(np.zeros(0, dtype=np.int64), weights=np.zeros((0, 2), dtype=np.int64)).tolist() == [0, 0]


@given(st.integers(0, 400_000), npst.arrays(np.int64, st.integers(1, 6), elements=st.integers(0, 300_000)))
def test_shares_are_exact_in_sum_and_within_a_pixel_of_the_proportion(amount: int, weight: NDArray[np.int64]) -> None:
    shares = share_in_proportion(np.array([amount]), weights=weight[None])
    assert shares.sum() == (amount if weight.any() else 0)
    exact = amount * weight / max(weight.sum(), 1)
    assert (np.abs(shares - exact) < 1).all()
    assert not shares[weight == 0].any()

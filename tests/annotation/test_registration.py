"""Registration of the points of a track."""

import numpy as np
import pytest

from bench.annotation.registration import _visible_shift


@pytest.mark.parametrize("returns", [4, 40])
def test_a_long_object_is_shifted_by_the_ends_that_both_sweeps_see(returns):
    side = np.column_stack([np.linspace(0.0, 4.0, returns), np.zeros(returns), np.ones(returns)])
    uncut = np.zeros(returns, dtype=bool)
    moved = side + np.array([0.5, 0.0, 0.0])
    np.testing.assert_allclose(_visible_shift((side, moved), (uncut, uncut), np.array([0.3, 0.0])), [0.5, 0.0])

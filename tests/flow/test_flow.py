import cv2
import numpy as np
import pytest

from bench.errors import ShapeError, UnknownNameError, UsageError
from bench.flow import DENSE_FLOWS, cell_mean, dense_flow


def shifted_pair(du, dv):
    """`end` is `start` moved by (du, dv): start[v, u] == end[v + dv, u + du]."""
    noise = cv2.GaussianBlur(np.random.default_rng(0).uniform(0, 255, (120, 160)).astype(np.float32), (0, 0), 2.0)
    start = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return start, np.roll(start, (dv, du), axis=(0, 1))


@pytest.mark.parametrize("name", sorted(DENSE_FLOWS))
def test_flow_points_from_the_first_image_to_the_second(name):
    start, end = shifted_pair(3, -2)
    flow = dense_flow(name)(start, end)
    assert flow.shape == (120, 160, 2)
    np.testing.assert_allclose(np.median(flow[20:-20, 20:-20], axis=(0, 1)), [3, -2], atol=0.1)


@pytest.mark.parametrize("name", sorted(DENSE_FLOWS))
def test_flow_does_not_remember_the_last_pair(name):
    flow = dense_flow(name)
    first = flow(*shifted_pair(3, -2))
    flow(*shifted_pair(-4, 1))
    np.testing.assert_array_equal(first, flow(*shifted_pair(3, -2)))


def test_flow_refuses_what_it_cannot_do():
    grey = np.zeros((10, 10), np.uint8)
    with pytest.raises(ShapeError, match="two grey uint8 images"):
        dense_flow("dis")(grey, np.zeros((10, 11), np.uint8))
    with pytest.raises(UnknownNameError, match="farneback"):
        dense_flow("farnebeck")
    with pytest.raises(UnknownNameError, match="medium"):
        dense_flow("dis", preset="slow")
    with pytest.raises(UsageError, match="at least 12 px a side, got 10 x 10"):
        dense_flow("dis")(grey, grey)
    with pytest.raises(UsageError, match="window"):
        dense_flow("farneback", window=3)


def test_cell_mean_by_hand():
    values = np.arange(20, dtype=np.float32).reshape(4, 5)
    # Cells of 2: the fifth column is repeated to fill the last cell.
    expected = [[(0 + 1 + 5 + 6) / 4, (2 + 3 + 7 + 8) / 4, (4 + 9) / 2], [13, 15, 16.5]]
    np.testing.assert_allclose(cell_mean(values, 2), expected)
    two = cell_mean(np.dstack([values, -values]), 2)
    np.testing.assert_allclose(two[..., 1], -np.array(expected))
    with pytest.raises(ShapeError, match="from 1 to 5, got 1000000000000000000000000000000"):
        cell_mean(values, 10**30)
    with pytest.raises(ShapeError, match="from 1 to 5, got 0"):
        cell_mean(values, 0)

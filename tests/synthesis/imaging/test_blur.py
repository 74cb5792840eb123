"""Motion blur is a mean over what the lens sees along a pixel's way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.exposure import blur

SHAPE = (20, 33)


def blurred(
    grey: NDArray[np.float32],
    motion_vectors: NDArray[np.float32],
    inverse_depth: NDArray[np.float32],
    valid: NDArray[np.bool_],
) -> NDArray[np.float32]:
    out = np.full(grey.shape, np.nan, dtype=np.float32)
    contiguous = np.ascontiguousarray
    blur(contiguous(grey), contiguous(motion_vectors), contiguous(inverse_depth), contiguous(valid), out)
    return out


def ways_px(u: float, v: float) -> NDArray[np.float32]:
    return np.stack([np.full(SHAPE, u, np.float32), np.full(SHAPE, v, np.float32)])


def test_blur_down_is_blur_across_of_the_turned_picture() -> None:
    rng = np.random.default_rng(1)
    grey, inverse_depth = (rng.random(SHAPE, dtype=np.float32) for _ in range(2))
    motion_vectors, valid = rng.normal(0.0, 6.0, (2, *SHAPE)).astype(np.float32), rng.random(SHAPE) < 0.9
    upright = blurred(grey, motion_vectors, inverse_depth, valid)
    turned = blurred(grey.T, motion_vectors[::-1].transpose(0, 2, 1), inverse_depth.T, valid.T)
    assert np.array_equal(upright, turned.T)
    assert not np.allclose(upright, grey, atol=0.01)


def test_a_way_of_three_pixels_is_the_mean_over_three_pixels() -> None:
    grey = np.zeros(SHAPE, dtype=np.float32)
    grey[10, 16] = 1.0
    picture = blurred(grey, ways_px(3.0, 0.0), np.ones(SHAPE, np.float32), np.ones(SHAPE, np.bool_))
    # The straight lines between the pixels, from 1.5 px before to 1.5 px after; a third of their integral.
    expected = np.array([0.0, 0.125, 0.875, 1.0, 0.875, 0.125, 0.0]) / 3.0
    assert np.allclose(picture[10, 13:20], expected, atol=1e-6)
    assert not picture[:10].any()


def test_what_the_lens_does_not_see_stays_out() -> None:
    grey, valid = np.full(SHAPE, 0.5, dtype=np.float32), np.ones(SHAPE, dtype=np.bool_)
    grey[:, 20:], valid[:, 20:] = 100.0, False
    picture = blurred(grey, ways_px(9.0, 4.0), np.zeros(SHAPE, np.float32), valid)
    assert (picture[:, :20] == 0.5).all()


def test_what_stands_nearer_stays_out_and_what_moves_nearer_does_not() -> None:
    grey, inverse_depth = np.zeros(SHAPE, dtype=np.float32), np.full(SHAPE, 0.1, dtype=np.float32)
    grey[:, 20:], inverse_depth[:, 20:] = 1.0, 0.5
    valid, motion_vectors = np.ones(SHAPE, dtype=np.bool_), ways_px(10.0, 0.0)
    assert (blurred(grey, motion_vectors, inverse_depth, valid)[:-1, 18] > 0.2).all()
    motion_vectors[:, :, 20:] = 0.0
    assert (blurred(grey, motion_vectors, inverse_depth, valid)[:, :20] == 0.0).all()

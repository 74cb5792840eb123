from __future__ import annotations

from itertools import pairwise

import numba
import numpy as np
import pytest

from bench.synthesis.imaging.faces import LEVELS, SIZE, TextureAtlas, atlas_at, texture_atlas


@numba.njit(error_model="numpy")
def fill(
    u: np.ndarray, v: np.ndarray, level: np.ndarray, image: np.ndarray, layout: np.ndarray, found: np.ndarray
) -> None:
    for k in range(len(u)):
        found[k] = atlas_at(u[k], v[k], level[k], image, layout)


def sample(atlas: TextureAtlas, u: np.ndarray, v: np.ndarray, level: np.ndarray) -> np.ndarray:
    """The texture at places (N,), in periods, smoothed to levels."""
    found = np.empty(len(u), dtype=np.float32)
    fill(u, v, level, atlas.image, atlas.layout, found)
    return found


def test_levels_lie_on_each_other() -> None:
    # A shift between levels would make surfaces creep as the camera comes nearer, and flow would see it.
    atlas = texture_atlas(3)
    for level in range(4):
        texels = SIZE >> level
        v, u = np.meshgrid(*2 * [((np.arange(200) + 0.5) / texels).astype(np.float32)], indexing="ij")
        fine, coarse = (
            sample(atlas, u.ravel(), v.ravel(), np.full(u.size, k, np.float32)).reshape(u.shape)
            for k in (level, level + 1)
        )
        slopes = np.stack([part.ravel() for part in np.gradient(fine)], axis=1)
        shift_texels, *_ = np.linalg.lstsq(slopes, (coarse - fine).ravel(), rcond=None)
        assert np.abs(shift_texels).max() < 0.05


def test_texture_has_no_seam() -> None:
    atlas = texture_atlas(3)
    u = np.array([-1e-5, 1e-5, 1 - 1e-5, 2 + 1e-5], dtype=np.float32)
    v = np.full_like(u, 0.3)
    for level in range(LEVELS - 1):
        values = sample(atlas, u, v, np.full_like(u, level))
        assert np.ptp(values) < 0.05


def test_texture_turns_smooth_with_distance() -> None:
    atlas = texture_atlas(3)
    u, v = np.random.default_rng(0).random((2, 10_000), dtype=np.float32)
    spreads = [sample(atlas, u, v, np.full_like(u, level)).std() for level in range(LEVELS)]
    assert spreads[0] == pytest.approx(1.0, abs=0.15)
    assert all(b < a for a, b in pairwise(spreads))

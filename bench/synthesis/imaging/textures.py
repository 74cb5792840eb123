"""One seamless noise texture in all its mip levels.

Each octave of the noise has the same strength, so that a surface has something to track at every distance; the
level is chosen by the size of the pixel on the surface, so that far surfaces become smooth instead of flickering.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.machine_code import inlined
from bench.synthesis.imaging.kernels import bilinear

SIZE = 1024  # texels along one period of the texture
LEVELS = 9  # 1024 down to 4 texels
BORDER = 2  # texels repeated around each level, so that sampling wraps
OCTAVES = (512, 256, 128, 64, 32, 16, 8)  # lattice points along one period
HIGHEST, TOP = np.float32(LEVELS - 1.001), np.float32(BORDER - 0.5)
THIRD, TWO_THIRDS = np.float32(1 / 3), np.float32(2 / 3)
COARSE_FADE = 0.25  # asphalt and plaster are grainy rather than blotched


@dataclass(frozen=True, slots=True, eq=False)
class TextureAtlas:
    """All mip levels beside each other in one image.

    Attributes:
        image: float32, mean 0, standard deviation 1 at the finest level.
        layout: (LEVELS, 2) float32: column of each level's first texel, and its texels along one period; all levels
            start in row `BORDER`.
    """

    image: NDArray[np.float32]
    layout: NDArray[np.float32]


@inlined
def quick_log2(value: np.float32) -> np.float32:
    """Logarithm of a positive number to base 2, within a hundredth: enough to choose a level."""
    bits = np.float32(value).view(np.int32)
    mantissa = np.int32((bits & 0x7FFFFF) | 0x3F800000).view(np.float32)
    return np.float32(np.int32((bits >> 23) - 128)) + (np.float32(2.0) - mantissa * THIRD) * mantissa - TWO_THIRDS


@inlined
def atlas_at(
    u: np.float32, v: np.float32, level: np.float32, image: NDArray[np.float32], layout: NDArray[np.float32]
) -> np.float32:
    """The texture at one point: between four texels of each of two levels."""
    u -= np.floor(u)
    v -= np.floor(v)
    level = min(max(level, np.float32(0.0)), HIGHEST)
    whole = np.int32(level)
    share, lower = level - np.float32(whole), np.uintp(whole)
    fine = _texel(u, v, lower, image, layout)
    return fine + share * (_texel(u, v, lower + np.uintp(1), image, layout) - fine)


@inlined
def _texel(
    u: np.float32, v: np.float32, level: np.uintp, image: NDArray[np.float32], layout: NDArray[np.float32]
) -> np.float32:
    column = u * layout[level, 1] + layout[level, 0]
    row = v * layout[level, 1] + TOP
    return bilinear(row, column, image)


@cache
def texture_atlas(seed: int) -> TextureAtlas:
    """The atlas of a seed: the same for every recording of a scenario."""
    level = _noise(np.random.default_rng(seed))
    widths = [(SIZE >> k) + 2 * BORDER for k in range(LEVELS)]
    image = np.zeros((SIZE + 2 * BORDER, sum(widths)), dtype=np.float32)
    lefts = np.concatenate([[0], np.cumsum(widths)[:-1]])
    for left in lefts:
        wrapped = np.pad(level, BORDER, mode="wrap")
        image[: wrapped.shape[0], left : left + wrapped.shape[1]] = wrapped
        level = level.reshape(level.shape[0] // 2, 2, level.shape[1] // 2, 2).mean(axis=(1, 3))
    # Texel k covers [k, k + 1) of its level: its centre lies half a texel in.
    layout = np.stack([lefts + BORDER - 0.5, SIZE / 2.0 ** np.arange(LEVELS)], axis=1).astype(np.float32)
    return TextureAtlas(image, layout)


def _noise(rng: np.random.Generator) -> NDArray[np.float32]:
    total = np.zeros((SIZE, SIZE), dtype=np.float32)
    for points in OCTAVES:
        lattice = np.pad(rng.standard_normal((points, points), dtype=np.float32), 4, mode="wrap")
        factor = SIZE // points
        fine = cv2.resize(lattice, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        octave = fine[4 * factor : -4 * factor, 4 * factor : -4 * factor]
        total += octave / octave.std(dtype=np.float64) * (points / OCTAVES[0]) ** COARSE_FADE
    return np.asarray(total / total.std(dtype=np.float64), dtype=np.float32)

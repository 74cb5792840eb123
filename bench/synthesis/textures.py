"""One seamless noise texture in all its mip levels, sampled for whole images at once.

Each octave of the noise has the same strength, so that a surface has something to track at every distance; the
level is chosen by the size of the pixel on the surface, so that far surfaces turn smooth instead of flickering.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

SIZE = 1024  # texels along one period of the texture
LEVELS = 9  # 1024 down to 4 texels
BORDER = 2  # texels repeated around each level, so that sampling wraps
OCTAVES = (512, 256, 128, 64, 32, 16, 8)  # lattice points along one period
COARSE_FADE = 0.25  # asphalt and plaster are grainy rather than blotched


@dataclass(frozen=True, slots=True, eq=False)
class TextureAtlas:
    """All mip levels beside each other in one image.

    Attributes:
        image: float32, mean 0, standard deviation 1 at the finest level.
        left: (LEVELS,) float32, column of each level's first texel; all levels start in row `BORDER`.
        scale: (LEVELS,) float32, texels of each level along one period.
    """

    image: NDArray[np.float32]
    left: NDArray[np.float32]
    scale: NDArray[np.float32]

    def sample(self, u: NDArray[np.float32], v: NDArray[np.float32], level: NDArray[np.float32]) -> NDArray[np.float32]:
        """The texture at places, smoothed to a level.

        Args:
            u: (H, W) float32, in periods of the texture.
            v: (H, W) float32.
            level: (H, W) float32, log2 of the wanted smoothness in texels; kept within the levels there are.

        Returns:
            (H, W) float32.
        """
        u = u - np.floor(u)
        v = v - np.floor(v)
        level = np.clip(level, 0.0, LEVELS - 1.001)
        lower = level.astype(np.intp)
        fine = self._at(u, v, lower)
        coarse = self._at(u, v, lower + 1)
        return np.asarray(fine + (level - lower.astype(np.float32)) * (coarse - fine))

    def _at(self, u: NDArray[np.float32], v: NDArray[np.float32], level: NDArray[np.intp]) -> NDArray[np.float32]:
        scale = self.scale[level]
        columns = u * scale + self.left[level]
        rows = v * scale + np.float32(BORDER - 0.5)
        return np.asarray(cv2.remap(self.image, columns, rows, cv2.INTER_LINEAR), dtype=np.float32)


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
    return TextureAtlas(
        image, (lefts + BORDER - 0.5).astype(np.float32), (SIZE / 2.0 ** np.arange(LEVELS)).astype(np.float32)
    )


def _noise(rng: np.random.Generator) -> NDArray[np.float32]:
    total = np.zeros((SIZE, SIZE), dtype=np.float32)
    for points in OCTAVES:
        lattice = np.pad(rng.standard_normal((points, points), dtype=np.float32), 4, mode="wrap")
        factor = SIZE // points
        fine = cv2.resize(lattice, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        octave = fine[4 * factor : -4 * factor, 4 * factor : -4 * factor]
        total += octave / octave.std() * (points / OCTAVES[0]) ** COARSE_FADE
    return np.asarray(total / total.std(), dtype=np.float32)

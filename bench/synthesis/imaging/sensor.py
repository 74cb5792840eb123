"""From light to grey values: vignetting, noise, whole numbers, and JPEG."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import looped
from bench.synthesis.imaging.lens import Lens
from bench.synthesis.scenario import SensorSpec

NONE, WHITE = np.float32(0.0), np.float32(255.0)


class Sensor:
    """The sensor behind a lens.

    Args:
        spec: what it does to the light.
        lens: before it.
        gain: of the recording; noise grows with it.
    """

    def __init__(self, spec: SensorSpec, lens: Lens, *, gain: float) -> None:
        gain = gain if spec.gain is None else spec.gain
        angles = np.arccos(np.clip(lens.off_axis_cos, -1.0, 1.0)) / max(lens.widest_rad, 1e-6)
        self._light = np.where(lens.valid, spec.edge_light ** (angles * angles), 0.0).astype(np.float32)
        self._read_variance = np.float32((spec.read_noise_grey * gain) ** 2)
        # N electrons vary by sqrt(N), and WHITE stands for full_well / gain of them.
        shot_variance = 0.0 if spec.full_well_electrons is None else 255.0 * gain / spec.full_well_electrons
        self._shot_variance = np.float32(shot_variance)

    def expose(self, grey: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        """What is read out, (H, W).

        Args:
            grey: (H, W), 1 is white.
            rng: the noise.
        """
        noise = rng.standard_normal(grey.shape, dtype=np.float32)
        pixels = np.empty(grey.shape, dtype=np.uint8)
        _expose(grey, self._light, noise, self._read_variance, self._shot_variance, pixels)
        return pixels


@looped
def _expose(
    grey: NDArray[np.float32],
    light: NDArray[np.float32],
    noise: NDArray[np.float32],
    read_variance: np.float32,
    shot_variance: np.float32,
    pixels: NDArray[np.uint8],
) -> None:
    height, width = grey.shape
    for v in range(height):
        for u in range(width):
            signal = min(WHITE * grey[v, u] * light[v, u], WHITE + WHITE)
            value = signal + noise[v, u] * np.sqrt(read_variance + shot_variance * signal)
            seen = min(max(np.rint(value), NONE), WHITE)
            pixels[v, u] = np.uint8(np.int32(seen if light[v, u] > NONE else NONE))

"""The sky, and what a polished surface mirrors of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import inlined
from bench.synthesis.imaging.textures import atlas_at

CLOUD_PERIOD = 6.0  # heights of the cloud layer until the texture repeats
CLOUD_LEVEL = 4.5  # of the texture: clouds are soft
LAYER_LIFT = 0.15  # the layer bends down with the earth instead of running into the horizon
HOUSES = 0.30  # brightness of what stands around, of the sky above the horizon
ROAD = 0.45  # the same of the road, which faces the sky


class Sky(NamedTuple):
    """Brightness of the sky, infinitely far away: it turns with the camera and never moves.

    Attributes:
        horizon: 1 is white.
        zenith: at the top.
        cloud: standard deviation of the clouds.
        glow: brightness that the sun's surroundings add.
        sun: (3,) float64, unit vector to the sun, world.
    """

    horizon: float
    zenith: float
    cloud: float
    glow: float
    sun: NDArray[np.float64]


@inlined
def sky_grey(
    x: float, y: float, z: float, pixel_rad: float, sky: Sky, atlas: NDArray[np.float32], layout: NDArray[np.float32]
) -> float:
    """Brightness in a direction of unit length, world axes."""
    up = min(max(z, 0.0), 1.0)
    clear = 1.0 - up
    grey = sky.zenith + (sky.horizon - sky.zenith) * clear * clear * clear
    if sky.cloud > 0 and z > -0.05:
        spread = 1.0 / (CLOUD_PERIOD * (up + LAYER_LIFT))
        level = max(CLOUD_LEVEL, np.log2(max(pixel_rad * spread / (up + LAYER_LIFT), 1e-6) * 1024.0))
        faded = min(1.0, (z + 0.05) * 8.0)
        grey *= 1.0 + sky.cloud * faded * atlas_at(x * spread, y * spread, level, atlas, layout)
    if sky.glow > 0:
        near = max(x * sky.sun[0] + y * sky.sun[1] + z * sky.sun[2], 0.0)
        near = near * near
        near = near * near
        near = near * near
        grey += sky.glow * (0.35 * near + 0.65 * near**16)
    return float(grey)


@inlined
def mirrored_grey(
    x: float, y: float, z: float, sky: Sky, atlas: NDArray[np.float32], layout: NDArray[np.float32]
) -> float:
    """Brightness that comes from a direction: sky, a row of houses along the horizon, or the road."""
    if z < 0.5:
        azimuth = np.arctan2(y, x)
        roofs = 0.22 + 0.08 * np.sin(3.0 * azimuth + 1.0) + 0.06 * np.sin(8.0 * azimuth + 2.5)
        roofs += 0.03 * np.sin(21.0 * azimuth)
        if z < -0.03:
            return float(ROAD * sky.horizon)
        if z < roofs:
            return float(HOUSES * sky.horizon * (1.0 + 0.3 * np.sin(13.0 * azimuth + 0.5)))
    return sky_grey(x, y, z, 0.01, sky, atlas, layout)

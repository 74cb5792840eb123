"""The sky, and what a polished surface mirrors of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import inlined
from bench.synthesis.imaging.textures import SIZE, atlas_at, quick_log2

ZERO, ONE, TWO, LEAST = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(1e-6)
CLOUD_PERIOD = np.float32(6.0)  # heights of the cloud layer until the texture repeats
CLOUD_LEVEL = np.float32(4.5)  # of the texture: clouds are soft
TEXELS = np.float32(SIZE)
LAYER_LIFT = np.float32(0.15)  # the layer bends down with the earth instead of running into the horizon
LOWEST_CLOUD, CLOUD_FADE = np.float32(-0.05), np.float32(8.0)  # clouds fade in above this height
WIDE_GLOW, CLOSE_GLOW = np.float32(0.35), np.float32(0.65)
HOUSES = np.float32(0.30)  # brightness of what stands around, of the sky above the horizon
ROAD = np.float32(0.45)  # the same of the road, which faces the sky
MIRROR_RAD = np.float32(0.01)  # how sharp a mirror image of the sky is
# Height of the roofs that are mirrored: waves around the horizon, each an amount of cosine and of sine.
ROOFS, HIGHEST_ROOF, LOWEST_SKY = np.float32(0.22), np.float32(0.40), np.float32(-0.03)
ROOF_3 = (np.float32(0.08 * np.sin(1.0)), np.float32(0.08 * np.cos(1.0)))
ROOF_8 = (np.float32(0.06 * np.sin(2.5)), np.float32(0.06 * np.cos(2.5)))
ROOF_21 = np.float32(0.03)
FRONT_13 = (np.float32(0.3 * np.sin(0.5)), np.float32(0.3 * np.cos(0.5)))  # brightness of the fronts


class Sky(NamedTuple):
    """Brightness of the sky, infinitely far away: it rotates with the camera and never moves.

    Attributes:
        horizon: 1 is white.
        zenith: at the top.
        cloud: standard deviation of the clouds.
        glow: brightness that the sun's surroundings add.
        sun: (3,) float32, unit vector to the sun, world.
    """

    horizon: np.float32
    zenith: np.float32
    cloud: np.float32
    glow: np.float32
    sun: NDArray[np.float32]


@inlined
def sky_grey(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    pixel_rad: np.float32,
    sky: Sky,
    atlas: NDArray[np.float32],
    layout: NDArray[np.float32],
) -> np.float32:
    """Brightness in a direction of unit length, world axes."""
    up = min(max(z, ZERO), ONE)
    clear = ONE - up
    grey = sky.zenith + (sky.horizon - sky.zenith) * clear * clear * clear
    if sky.cloud > ZERO and z > LOWEST_CLOUD:
        spread = ONE / (CLOUD_PERIOD * (up + LAYER_LIFT))
        level = max(CLOUD_LEVEL, quick_log2(max(pixel_rad * spread / (up + LAYER_LIFT), LEAST) * TEXELS))
        faded = min(ONE, (z - LOWEST_CLOUD) * CLOUD_FADE)
        grey *= ONE + sky.cloud * faded * atlas_at(x * spread, y * spread, level, atlas, layout)
    if sky.glow > ZERO:
        near = max(x * sky.sun[0] + y * sky.sun[1] + z * sky.sun[2], ZERO)
        near = near * near
        near = near * near
        near = near * near
        close = near * near
        close = close * close
        close = close * close
        close = close * close
        grey += sky.glow * (WIDE_GLOW * near + CLOSE_GLOW * close)
    return np.float32(grey)


@inlined
def mirrored_grey(
    x: np.float32, y: np.float32, z: np.float32, sky: Sky, atlas: NDArray[np.float32], layout: NDArray[np.float32]
) -> np.float32:
    """Brightness that comes from a direction: sky, a row of houses along the horizon, or the road."""
    if z < LOWEST_SKY:
        return np.float32(ROAD * sky.horizon)
    if z < HIGHEST_ROOF:
        # Cosine and sine of the azimuth and of its multiples, as powers of a complex number.
        scale = ONE / np.sqrt(max(x * x + y * y, LEAST))
        c1, s1 = x * scale, y * scale
        c2, s2 = c1 * c1 - s1 * s1, TWO * c1 * s1
        c4, s4 = c2 * c2 - s2 * s2, TWO * c2 * s2
        c8, s8 = c4 * c4 - s4 * s4, TWO * c4 * s4
        c5, s5 = c4 * c1 - s4 * s1, c4 * s1 + s4 * c1
        c13, s13 = c8 * c5 - s8 * s5, c8 * s5 + s8 * c5
        c3, s3 = c2 * c1 - s2 * s1, c2 * s1 + s2 * c1
        roofs = ROOFS + ROOF_3[0] * c3 + ROOF_3[1] * s3 + ROOF_8[0] * c8 + ROOF_8[1] * s8
        roofs += ROOF_21 * (c13 * s8 + s13 * c8)
        if z < roofs:
            return np.float32(HOUSES * sky.horizon * (ONE + FRONT_13[0] * c13 + FRONT_13[1] * s13))
    return np.float32(sky_grey(x, y, z, MIRROR_RAD, sky, atlas, layout))

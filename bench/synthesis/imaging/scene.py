"""Everything that gives what is seen its grey values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.lamps import Lamps
from bench.synthesis.imaging.shadow_maps import HeightMap
from bench.synthesis.imaging.sky import Sky


class Scene(NamedTuple):
    """Everything that gives a point its grey value.

    Attributes:
        rows: (T, 16) float32, see `faces`.
        turn: (3, 3) float32, world from camera.
        origin_m: (3,) float32, the camera in the world.
        sun: (3,) float32, unit vector.
        sun_light: see `Lighting`.
        sky_light: see `Lighting`.
        near: shadows of the sun close to the camera.
        far: the same, coarser and further.
        cover: heights around every place, smoothed.
        sky: brightness of the sky.
        lamps: by night.
        night: whether lamps are lit.
        atlas: the texture.
        layout: of the texture's levels.
    """

    rows: NDArray[np.float32]
    turn: NDArray[np.float32]
    origin_m: NDArray[np.float32]
    sun: NDArray[np.float32]
    sun_light: np.float32
    sky_light: np.float32
    near: HeightMap
    far: HeightMap
    cover: HeightMap
    sky: Sky
    lamps: Lamps
    night: bool
    atlas: NDArray[np.float32]
    layout: NDArray[np.float32]

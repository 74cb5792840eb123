"""Where the sun does not reach, and where the sky reaches less."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.shadow_maps import HeightMap, ShadowSquare
from bench.synthesis.lighting import Lighting

# The sun is half a degree wide: the shadow of a roof rack, 2 m up, is blurred over 2 cm, and a pixel at 5 m is 3 cm.
NEAR_TEXEL_M, NEAR_CELLS = 0.03, 1800  # 54 m
FAR_TEXEL_M, FAR_CELLS = 0.20, 1200  # 240 m
COVER_TEXEL_M, COVER_CELLS = 0.10, 900  # 90 m
COVER_BLUR, CEILING_M = 9, 2.0  # cells that surroundings are averaged over; how high they count
LOWEST_SLOPE = 0.05  # sine of the lowest elevation that maps follow


class Shadows:
    """The shadows of a recording.

    Args:
        corners_m: (T, 3, 3), m, the static world.
        light: the sun.
    """

    def __init__(self, corners_m: NDArray[np.float64], light: Lighting) -> None:
        slope = light.towards_sun[:2] / max(float(light.towards_sun[2]), LOWEST_SLOPE)
        none = corners_m[:0]
        self._sunny = light.sun_light > 0
        cast = corners_m if light.sun_light > 0 else none
        cells = (NEAR_CELLS, FAR_CELLS) if light.sun_light > 0 else (4, 4)
        self._near = ShadowSquare(cast, slope=slope, texel_m=NEAR_TEXEL_M, cells=cells[0])
        self._far = ShadowSquare(cast, slope=slope, texel_m=FAR_TEXEL_M, cells=cells[1])
        self._cover = ShadowSquare(
            corners_m, slope=np.zeros(2), texel_m=COVER_TEXEL_M, cells=COVER_CELLS, blur_cells=COVER_BLUR,
            ceiling_m=CEILING_M,
        )  # fmt: skip

    @contextmanager
    def around(
        self, place_m: NDArray[np.float64], bodies_m: Sequence[NDArray[np.float64]]
    ) -> Iterator[tuple[HeightMap, HeightMap, HeightMap]]:
        """The maps around a place, with the bodies on them as long as the block lasts."""
        with ExitStack() as stack:
            maps = [square.around(place_m) for square in (self._near, self._far, self._cover)]
            # What moves further away than the near map reaches throws no shadow that could be seen.
            for square in (self._near, self._cover) if self._sunny else (self._cover,):
                stack.callback(square.without_bodies, square.with_bodies(list(bodies_m)))
            yield maps[0], maps[1], maps[2]

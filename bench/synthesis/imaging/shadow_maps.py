"""Height up to which the light of a far source is blocked above every position on the ground.

A point (x, y, z) is moved along the light to the ground, (x, y) - z slope; points with the same position there lie on
one ray. A map keeps the highest z of any surface on each ray: a point below it lies in shadow. On level ground this
needs no bias that depends on the elevation of the sun.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled, inlined
from bench.synthesis.imaging.faces import bilinear, share_below
from bench.synthesis.scene import Lighting

ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
NOTHING_M = np.float32(-1e3)  # height where there is no surface


class HeightMap(NamedTuple):
    """Heights on a square of ground.

    Attributes:
        heights_m: (N, N) float32, rows along y.
        left_m: x of the square's edge.
        near_m: y of the square's edge.
        per_m: cells in a metre.
        slope: (2,) float32, shift of x and y on the ground for each metre of height.
    """

    heights_m: NDArray[np.float32]
    left_m: np.float32
    near_m: np.float32
    per_m: np.float32
    slope: NDArray[np.float32]


def _height_map(
    heights_m: NDArray[np.float32], left_m: float, near_m: float, texel_m: float, slope: NDArray[np.float64]
) -> HeightMap:
    per_m = np.float32(1.0 / texel_m)
    return HeightMap(heights_m, np.float32(left_m), np.float32(near_m), per_m, slope.astype(np.float32))


class ShadowSquare:
    """A height map that follows the camera in steps, and holds the moving bodies for one image at a time.

    Args:
        corners_m: (T, 3, 3), m, the static world.
        slope: (2,), see `HeightMap`; 0 looks straight down.
        texel_m: size of a cell.
        cells: along a side.
        blur_cells: side of the window that heights are averaged over; 1 for none.
        ceiling_m: heights above the camera's ground are cut here; there is one at least.
    """

    def __init__(
        self,
        corners_m: NDArray[np.float64],
        *,
        slope: NDArray[np.float64],
        texel_m: float,
        cells: int,
        blur_cells: int = 1,
        ceiling_m: float = np.inf,
    ) -> None:
        self._corners, self._slope, self._texel_m, self._cells = corners_m, slope, texel_m, cells
        self._blur, self._ceiling_m = blur_cells, np.float32(ceiling_m)
        self._step_m = texel_m * (cells // 4)
        self._step: tuple[int, int] | None = None
        self._raw = np.empty((0, 0), dtype=np.float32)
        self._map = _height_map(self._raw, 0.0, 0.0, texel_m, slope)

    def around(self, position_m: NDArray[np.float64]) -> HeightMap:
        """The static world around a position, (3,) m; the same for the same position, whatever came before."""
        step = (int(np.floor(position_m[0] / self._step_m + 0.5)), int(np.floor(position_m[1] / self._step_m + 0.5)))
        if step != self._step:
            half_m = self._cells * self._texel_m / 2
            left_m, near_m = (float(k * self._step_m - half_m) for k in step)
            self._raw = np.full((self._cells, self._cells), NOTHING_M)
            self._map = _height_map(self._raw, left_m, near_m, self._texel_m, self._slope)
            draw_heights(self._corners, self._map)
            self._map = self._map._replace(heights_m=self._smooth(self._raw))
            self._step = step
        return self._map

    def with_bodies(self, corners_m: list[NDArray[np.float64]]) -> list[tuple[slice, slice, NDArray[np.float32]]]:
        """Put bodies onto the map; returns what `without_bodies` needs."""
        covered = []
        for corners in corners_m:
            if not len(corners):
                continue
            ground_m = corners[..., :2] - corners[..., 2:] * self._map.slope - (self._map.left_m, self._map.near_m)
            cells = ground_m.reshape(-1, 2) * self._map.per_m
            low, high = np.floor(cells.min(axis=0)).astype(int), np.ceil(cells.max(axis=0)).astype(int)
            low = np.clip(low - self._blur, 0, self._cells)
            high = np.clip(high + self._blur, 0, self._cells)
            if (low >= high).any():
                continue
            rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
            covered.append((rows, columns, self._map.heights_m[rows, columns].copy()))
            patch = (self._raw if self._blur > 1 else self._map.heights_m)[rows, columns].copy()
            left_m, near_m = self._map.left_m + low[0] * self._texel_m, self._map.near_m + low[1] * self._texel_m
            draw_heights(
                corners, self._map._replace(heights_m=patch, left_m=np.float32(left_m), near_m=np.float32(near_m))
            )
            heights = self._map.heights_m[rows, columns]
            np.maximum(heights, self._smooth(patch), out=heights)
        return covered

    def without_bodies(self, covered: list[tuple[slice, slice, NDArray[np.float32]]]) -> None:
        """Take the bodies off again."""
        for rows, columns, heights in reversed(covered):
            self._map.heights_m[rows, columns] = heights

    def _smooth(self, heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
        if self._blur == 1:
            return heights_m
        window = (self._blur, self._blur)
        return np.asarray(cv2.blur(np.minimum(heights_m, self._ceiling_m), window), dtype=np.float32)


@compiled
def draw_heights(corners: NDArray[np.float64], ground: HeightMap) -> None:
    """Raise a map to all surfaces that lie above it.

    Args:
        corners: (T, 3, 3), m.
        ground: changed.
    """
    heights = ground.heights_m
    rows, columns = heights.shape
    per_m = ground.per_m
    for t in range(len(corners)):
        z0, z1, z2 = corners[t, 0, 2], corners[t, 1, 2], corners[t, 2, 2]
        x0 = (corners[t, 0, 0] - z0 * ground.slope[0] - ground.left_m) * per_m - 0.5
        x1 = (corners[t, 1, 0] - z1 * ground.slope[0] - ground.left_m) * per_m - 0.5
        x2 = (corners[t, 2, 0] - z2 * ground.slope[0] - ground.left_m) * per_m - 0.5
        y0 = (corners[t, 0, 1] - z0 * ground.slope[1] - ground.near_m) * per_m - 0.5
        y1 = (corners[t, 1, 1] - z1 * ground.slope[1] - ground.near_m) * per_m - 0.5
        y2 = (corners[t, 2, 1] - z2 * ground.slope[1] - ground.near_m) * per_m - 0.5
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0.0:
            continue
        first_u, last_u = max(np.ceil(min(x0, x1, x2)), 0.0), min(np.floor(max(x0, x1, x2)), columns - 1.0)
        first_v, last_v = max(np.ceil(min(y0, y1, y2)), 0.0), min(np.floor(max(y0, y1, y2)), rows - 1.0)
        if first_u > last_u or first_v > last_v:
            continue
        # Weights of the second and third corner, and with them the height, change by the same from cell to cell.
        per_area = 1.0 / area
        j_step, k_step = (y2 - y0) * per_area, -(y1 - y0) * per_area
        left, count = int(first_u), int(last_u) - int(first_u) + 1
        for v in range(int(first_v), int(last_v) + 1):
            j0 = ((first_u - x0) * (y2 - y0) - (x2 - x0) * (v - y0)) * per_area
            k0 = ((x1 - x0) * (v - y0) - (first_u - x0) * (y1 - y0)) * per_area
            # The weights stay within 0 and 1 for a stretch of cells: the row is cut to it.
            low, high = 0.0, count - 1.0
            for start, step in ((j0, j_step), (k0, k_step), (1.0 - j0 - k0, -j_step - k_step)):
                if step > 0.0:
                    low = max(low, np.ceil(-start / step))
                elif step < 0.0:
                    high = min(high, np.floor(-start / step))
                elif start < 0.0:
                    high = -1.0
            for n in range(int(low), int(high) + 1):
                height = np.float32(z0 + (j0 + n * j_step) * (z1 - z0) + (k0 + n * k_step) * (z2 - z0))
                heights[v, left + n] = max(heights[v, left + n], height)


@inlined
def lit_share(x: np.float32, y: np.float32, z: np.float32, bias: np.float32, ground: HeightMap) -> np.float32:
    """Share of the four cells around a point that do not shade it; -1 beyond the map."""
    column = (x - z * ground.slope[0] - ground.left_m) * ground.per_m - HALF
    row = (y - z * ground.slope[1] - ground.near_m) * ground.per_m - HALF
    last = np.float32(ground.heights_m.shape[0] - 1)
    if not (ZERO <= column < last and ZERO <= row < last):
        return -ONE
    return share_below(row, column, z + bias, ground.heights_m)


@inlined
def height_at(x: np.float32, y: np.float32, ground: HeightMap) -> np.float32:
    """Height between the cells of a map that looks straight down; far below everything beyond the map."""
    column, row = (x - ground.left_m) * ground.per_m - HALF, (y - ground.near_m) * ground.per_m - HALF
    last = np.float32(ground.heights_m.shape[0] - 1)
    if not (ZERO <= column < last and ZERO <= row < last):
        return NOTHING_M
    return bilinear(row, column, ground.heights_m)


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
        self._sunny = light.kind.sun_light > 0
        cast = corners_m if light.kind.sun_light > 0 else none
        cells = (NEAR_CELLS, FAR_CELLS) if light.kind.sun_light > 0 else (4, 4)
        self._near = ShadowSquare(cast, slope=slope, texel_m=NEAR_TEXEL_M, cells=cells[0])
        self._far = ShadowSquare(cast, slope=slope, texel_m=FAR_TEXEL_M, cells=cells[1])
        self._cover = ShadowSquare(
            corners_m, slope=np.zeros(2), texel_m=COVER_TEXEL_M, cells=COVER_CELLS, blur_cells=COVER_BLUR,
            ceiling_m=CEILING_M,
        )  # fmt: skip

    @contextmanager
    def around(
        self, position_m: NDArray[np.float64], bodies_m: Sequence[NDArray[np.float64]]
    ) -> Iterator[tuple[HeightMap, HeightMap, HeightMap]]:
        """The maps around a step, with the bodies on them as long as the block lasts."""
        with ExitStack() as stack:
            maps = [square.around(position_m) for square in (self._near, self._far, self._cover)]
            # What moves further away than the near map reaches throws no shadow that could be seen.
            for square in (self._near, self._cover) if self._sunny else (self._cover,):
                stack.callback(square.without_bodies, square.with_bodies(list(bodies_m)))
            yield maps[0], maps[1], maps[2]

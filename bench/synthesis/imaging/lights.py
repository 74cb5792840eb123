"""Lights: the sun and its shadows, the sky and what a polished surface mirrors of it; by night lamps and headlights.

Shadows are maps of the height up to which the light of a far source is blocked above every position on the ground. A
point (x, y, z) is moved along the light to the ground, (x, y) - z slope; points with the same position there lie on one
ray. A map keeps the highest z of any surface on each ray: a point below it lies in shadow. On level ground this needs
no bias that depends on the elevation of the sun.

Brightness: white paper at 15 lux is white in the picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.pinhole import PinholeCamera
from bench.geometry import RigidTransform
from bench.machine_code import compiled, inlined
from bench.synthesis.ego import AHEAD_FROM_CAMERA
from bench.synthesis.imaging.faces import GLOW, SIZE, Faces, TextureAtlas, atlas_at, bilinear, quick_log2, share_below
from bench.synthesis.imaging.visibility import Lens, find_visible, lens_of, untiled
from bench.synthesis.scene import Lighting

ZERO, HALF, ONE, TWO = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(2.0)
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


LEAST = np.float32(1e-6)  # beside what a direction is divided by
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
    x: np.float32, y: np.float32, z: np.float32, pixel_rad: np.float32, sky: Sky, atlas: TextureAtlas
) -> np.float32:
    """Brightness in a direction of unit length, world axes."""
    up = min(max(z, ZERO), ONE)
    clear = ONE - up
    grey = sky.zenith + (sky.horizon - sky.zenith) * clear * clear * clear
    if sky.cloud > ZERO and z > LOWEST_CLOUD:
        spread = ONE / (CLOUD_PERIOD * (up + LAYER_LIFT))
        level = max(CLOUD_LEVEL, quick_log2(max(pixel_rad * spread / (up + LAYER_LIFT), LEAST) * TEXELS))
        faded = min(ONE, (z - LOWEST_CLOUD) * CLOUD_FADE)
        grey *= ONE + sky.cloud * faded * atlas_at(x * spread, y * spread, level, atlas)
    if sky.glow > ZERO:
        near = max(x * sky.sun[0] + y * sky.sun[1] + z * sky.sun[2], ZERO)
        for _ in range(3):
            near *= near
        close = near * near
        for _ in range(3):
            close *= close
        grey += sky.glow * (WIDE_GLOW * near + CLOSE_GLOW * close)
    return np.float32(grey)


@inlined
def mirrored_grey(x: np.float32, y: np.float32, z: np.float32, sky: Sky, atlas: TextureAtlas) -> np.float32:
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
    return np.float32(sky_grey(x, y, z, MIRROR_RAD, sky, atlas))


WHITE_LUX = 15.0
LAMP_GLOW = 0.5  # faces that glow as much are street lamps
LAMPS_NEAR, LAMP_REACH_M, LAMP_SIZE_M = 8, 45.0, 1.0
HIGHEST_M = 2.5  # lower ones are those of cars
GLOW_BY_NIGHT = np.float32(100.0)  # exposure against day: a lit window, 1/250 of paper by day, is well seen
HEADLIGHTS_M = ((3.55, 0.62, 0.66), (3.55, -0.62, 0.66))  # vehicle frame
BEAM_WIDTH, BEAM_HEIGHT = 512, 192  # px, of the picture that each headlight has of what it lights
BEAM_FOCAL = np.float32(180.0)
MIDDLE_COLUMN, MIDDLE_ROW = np.float32((BEAM_WIDTH - 1) / 2), np.float32((BEAM_HEIGHT - 1) / 2)
SHADOWS_REACH_M = 40.0  # shadows of what is further away are too faint to be seen


class Lamps(NamedTuple):
    """All lamps that reach one image.

    Attributes:
        street_m: (L, 3) float32, world.
        lamp_from_world: (2, 3, 3) float32, rotations of the headlights; z is its axis, y down.
        positions_m: (2, 3) float32, world.
        inverse_depth: (2, H, W) float32, 1 / m, what each headlight meets first.
        headlights: how many there are.
    """

    street_m: NDArray[np.float32]
    lamp_from_world: NDArray[np.float32]
    positions_m: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]
    headlights: int


NO_LAMPS = Lamps(
    street_m=np.zeros((0, 3), dtype=np.float32),
    lamp_from_world=np.zeros((2, 3, 3), dtype=np.float32),
    positions_m=np.zeros((2, 3), dtype=np.float32),
    inverse_depth=np.zeros((2, 1, 1), dtype=np.float32),
    headlights=0,
)


def lamp_faces(world: Faces) -> NDArray[np.bool_]:
    """Mask of the faces of street lamps, (T,): they glow, high above the road."""
    return np.asarray((world.rows[:, GLOW] >= LAMP_GLOW) & (world.corners_m[:, :, 2].min(axis=1) > HIGHEST_M))


def street_lamps_m(world: Faces) -> NDArray[np.float64]:
    """Positions of the street lamps, (L, 3) m: middles of the groups of their faces."""
    middles = world.corners_m[lamp_faces(world)].mean(axis=1)
    lamps = []
    while len(middles):
        group = np.linalg.norm(middles - middles[0], axis=1) < LAMP_SIZE_M
        lamps.append(middles[group].mean(axis=0))
        middles = middles[~group]
    return np.array(lamps).reshape(-1, 3)


@cache
def _beam_lens() -> Lens:
    """The lens through which a headlight sees what it lights."""
    camera = PinholeCamera(
        width=BEAM_WIDTH,
        height=BEAM_HEIGHT,
        focal=(float(BEAM_FOCAL), float(BEAM_FOCAL)),
        principal_point=((BEAM_WIDTH - 1) / 2, (BEAM_HEIGHT - 1) / 2),
    )
    return lens_of(camera)


def lamps_of(
    corners_m: NDArray[np.float64], street_m: NDArray[np.float64], world_from_vehicle: RigidTransform
) -> Lamps:
    """The street lamps nearby, and the headlights with what they meet.

    Args:
        corners_m: (T, 3, 3), m, world: everything but the ego vehicle.
        street_m: see `street_lamps_m`.
        world_from_vehicle: the ego vehicle.
    """
    rotation = np.ascontiguousarray((world_from_vehicle.rotation @ AHEAD_FROM_CAMERA).T)
    positions_m = world_from_vehicle.apply(np.array(HEADLIGHTS_M))
    views = [
        find_visible(corners_m, _beam_lens(), camera_from_world=rotation, origin_m=position_m, reach_m=SHADOWS_REACH_M)
        for position_m in positions_m
    ]
    inverse_depth = np.stack([untiled(view.inverse_depth, (BEAM_HEIGHT, BEAM_WIDTH)) for view in views])
    away_m = np.linalg.norm(street_m - world_from_vehicle.translation_m, axis=1)
    order = np.argsort(away_m, kind="stable")[:LAMPS_NEAR]
    near_m = street_m[order[away_m[order] < LAMP_REACH_M]]
    return Lamps(
        np.ascontiguousarray(near_m, dtype=np.float32), np.stack([rotation, rotation]).astype(np.float32),
        positions_m.astype(np.float32), inverse_depth, len(positions_m),
    )  # fmt: skip

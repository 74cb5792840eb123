"""Light by night: street lamps, and the host's headlights with their beam and the shadows that they throw.

Brightness: white paper at 15 lux is white in the picture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.cameras import PinholeCamera
from bench.geometry import RigidTransform
from bench.synthesis.imaging.compiled import inlined
from bench.synthesis.imaging.faces import GLOW, Faces
from bench.synthesis.imaging.lens import lens_of
from bench.synthesis.imaging.visibility import draw, find_planes

WHITE_LUX = 15.0
STREET_LAMP_CD = 1200.0  # 6 m above the road: 33 lux below it, 10 on average, a residential street
LAMP_GLOW = 0.5  # faces that glow as much are street lamps
LAMPS_NEAR, LAMP_REACH_M, LAMP_SIZE_M = 8, 45.0, 1.0
HIGHEST_M = 2.5  # lower ones are those of cars
GLOW_BY_NIGHT = 100.0  # exposure against day: a lit window, 1/250 of paper by day, is well seen
# Low beam after ECE R112: 20,000 cd just below the cut-off a hundredth below the horizon, a tenth of that 6 degrees
# further down, so that the near road does not outshine the far one; to the sides it fades within 20 degrees.
HEADLIGHT_CD, CUT_OFF, DOWN_FADE, SIDE_SIGMA = 20_000.0, 0.01, 0.05, 0.35
FOOT = 0.0008  # share of the beam that falls right before the bumper
ABOVE = 0.012  # share of the beam that strays above the cut-off
HEADLIGHTS_M = ((3.55, 0.62, 0.66), (3.55, -0.62, 0.66))  # vehicle frame
BEAM_WIDTH, BEAM_HEIGHT, BEAM_FOCAL = 512, 192, 180.0  # px, of the picture that each headlight has of what it lights
SHADE_BIAS = 1.02  # of the distance; nearer things are the face itself
AHEAD_FROM_LAMP = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class Lamps(NamedTuple):
    """All lamps that reach one image.

    Attributes:
        street_m: (L, 3) float64, world.
        turns: (2, 3, 3) float64, headlight from world; z is its axis, y down.
        places_m: (2, 3) float64, world.
        nearness: (2, H, W) float32, 1 / m, what each headlight meets first.
        headlights: how many there are.
    """

    street_m: NDArray[np.float64]
    turns: NDArray[np.float64]
    places_m: NDArray[np.float64]
    nearness: NDArray[np.float32]
    headlights: int


NO_LAMPS = Lamps(np.zeros((0, 3)), np.zeros((2, 3, 3)), np.zeros((2, 3)), np.zeros((2, 1, 1), dtype=np.float32), 0)


def lamp_faces(world: Faces) -> NDArray[np.bool_]:
    """Which faces are those of street lamps, (T,): they glow, high above the road."""
    return np.asarray((world.rows[:, GLOW] >= LAMP_GLOW) & (world.corners_m[:, :, 2].min(axis=1) > HIGHEST_M))


def street_lamps_m(world: Faces) -> NDArray[np.float64]:
    """Places of the street lamps, (L, 3) m: middles of the groups of their faces."""
    middles = world.corners_m[lamp_faces(world)].mean(axis=1)
    lamps = []
    while len(middles):
        group = np.linalg.norm(middles - middles[0], axis=1) < LAMP_SIZE_M
        lamps.append(middles[group].mean(axis=0))
        middles = middles[~group]
    return np.array(lamps).reshape(-1, 3)


class Headlights:
    """The beams of the host."""

    def __init__(self) -> None:
        camera = PinholeCamera(
            width=BEAM_WIDTH,
            height=BEAM_HEIGHT,
            focal=(BEAM_FOCAL, BEAM_FOCAL),
            principal_point=((BEAM_WIDTH - 1) / 2, (BEAM_HEIGHT - 1) / 2),
        )
        self._lens = lens_of(camera)

    def lamps(
        self, corners_m: NDArray[np.float64], street_m: NDArray[np.float64], world_from_vehicle: RigidTransform
    ) -> Lamps:
        """What the lamps light.

        Args:
            corners_m: (T, 3, 3), m, world: everything but the host.
            street_m: see `street_lamps_m`.
            world_from_vehicle: the host.
        """
        lens, planes = self._lens, np.zeros((len(corners_m), 9), dtype=np.float32)
        boxes = np.zeros((len(corners_m), 4), dtype=np.int16)
        nearness = np.zeros((len(HEADLIGHTS_M), *lens.valid.shape), dtype=np.float32)
        triangles = np.zeros(lens.valid.shape, dtype=np.int32)
        shape = lens.valid.shape[0], lens.valid.shape[1]
        turn = np.ascontiguousarray((world_from_vehicle.rotation @ AHEAD_FROM_LAMP).T)
        places_m = world_from_vehicle.apply(np.array(HEADLIGHTS_M))
        for place_m, near in zip(places_m, nearness, strict=True):
            find_planes(corners_m, turn, place_m, lens.chart, lens.px_per_rad, lens.widest_rad, shape, planes, boxes)
            farthest = np.zeros(lens.tiles.shape[:2], dtype=np.float32)
            draw(planes, boxes, lens.rays, lens.regions, lens.blocks, lens.tiles, near, triangles, farthest)
        away_m = np.linalg.norm(street_m - world_from_vehicle.translation_m, axis=1)
        order = np.argsort(away_m, kind="stable")[:LAMPS_NEAR]
        near_m = street_m[order[away_m[order] < LAMP_REACH_M]]
        return Lamps(np.ascontiguousarray(near_m), np.stack([turn, turn]), places_m, nearness, len(places_m))


@inlined
def lamp_light(x: float, y: float, z: float, nx: float, ny: float, nz: float, lamps: Lamps) -> float:
    """Brightness of white paper at a point with a normal, world."""
    lux = 0.0
    for k in range(len(lamps.street_m)):
        dx, dy, dz = lamps.street_m[k, 0] - x, lamps.street_m[k, 1] - y, lamps.street_m[k, 2] - z
        along = dx * nx + dy * ny + dz * nz
        if along > 0 and dz > 0:
            square = dx * dx + dy * dy + dz * dz
            lux += STREET_LAMP_CD * along * dz / (square * square)  # its light fades with the cosine from straight down
    for k in range(lamps.headlights):
        dx, dy, dz = x - lamps.places_m[k, 0], y - lamps.places_m[k, 1], z - lamps.places_m[k, 2]
        along = -(dx * nx + dy * ny + dz * nz)
        ahead = lamps.turns[k, 2, 0] * dx + lamps.turns[k, 2, 1] * dy + lamps.turns[k, 2, 2] * dz
        if along <= 0 or ahead <= 0.05:
            continue
        aside = (lamps.turns[k, 0, 0] * dx + lamps.turns[k, 0, 1] * dy + lamps.turns[k, 0, 2] * dz) / ahead
        down = (lamps.turns[k, 1, 0] * dx + lamps.turns[k, 1, 1] * dy + lamps.turns[k, 1, 2] * dz) / ahead
        square = dx * dx + dy * dy + dz * dz
        side = aside / SIDE_SIGMA
        beam = HEADLIGHT_CD * np.exp(-0.5 * side * side)
        # On the right the cut-off rises, to light the pavement.
        below = down - CUT_OFF + 0.27 * min(max(aside, 0.0), 0.12)
        if below >= 0:
            beam *= max(np.exp(-below / DOWN_FADE), FOOT)
        else:
            beam *= max(ABOVE, 1.0 + below / 0.008)
        distance = np.sqrt(square)
        beam *= _lit(k, aside, down, distance, lamps.nearness)
        lux += beam * along / (square * distance)
    return lux / WHITE_LUX


@inlined
def _lit(k: int, aside: float, down: float, distance_m: float, nearness: NDArray[np.float32]) -> float:
    """Share of four rays of a headlight that come as far as a point."""
    column, row = BEAM_FOCAL * aside + (BEAM_WIDTH - 1) / 2, BEAM_FOCAL * down + (BEAM_HEIGHT - 1) / 2
    if not (0 <= column < BEAM_WIDTH - 1 and 0 <= row < BEAM_HEIGHT - 1):
        return 1.0
    i, j = int(row), int(column)
    a, b = row - i, column - j
    least = SHADE_BIAS / distance_m
    lit = (1 - a) * (1 - b) if nearness[k, i, j] <= least else 0.0
    lit += (1 - a) * b if nearness[k, i, j + 1] <= least else 0.0
    lit += a * (1 - b) if nearness[k, i + 1, j] <= least else 0.0
    lit += a * b if nearness[k, i + 1, j + 1] <= least else 0.0
    return lit

"""Lamps by night: those of the street, and the headlights of the ego vehicle with the shadows that they throw.

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
from bench.synthesis.imaging.lens import (
    BEAM,
    BEAM_ALONG,
    BEAM_ASIDE,
    BEAM_DOWN,
    BEAM_SQUARE,
    SPOT_LIGHT,
    SPOT_TOWARDS_X,
    SPOT_TOWARDS_Y,
    SPOT_TOWARDS_Z,
    SPOT_X,
    SPOT_Y,
    SPOT_Z,
    lens_of,
    untiled,
)
from bench.synthesis.imaging.visibility import look

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
AHEAD_FROM_LAMP = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class Lamps(NamedTuple):
    """All lamps that reach one image.

    Attributes:
        street_m: (L, 3) float32, world.
        turns: (2, 3, 3) float32, headlight from world; z is its axis, y down.
        places_m: (2, 3) float32, world.
        nearness: (2, H, W) float32, 1 / m, what each headlight meets first.
        headlights: how many there are.
    """

    street_m: NDArray[np.float32]
    turns: NDArray[np.float32]
    places_m: NDArray[np.float32]
    nearness: NDArray[np.float32]
    headlights: int


NO_LAMPS = Lamps(
    street_m=np.zeros((0, 3), dtype=np.float32),
    turns=np.zeros((2, 3, 3), dtype=np.float32),
    places_m=np.zeros((2, 3), dtype=np.float32),
    nearness=np.zeros((2, 1, 1), dtype=np.float32),
    headlights=0,
)


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
            focal=(float(BEAM_FOCAL), float(BEAM_FOCAL)),
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
        turn = np.ascontiguousarray((world_from_vehicle.rotation @ AHEAD_FROM_LAMP).T)
        places_m = world_from_vehicle.apply(np.array(HEADLIGHTS_M))
        views = [
            look(corners_m, self._lens, camera_from_world=turn, origin_m=place, reach_m=SHADOWS_REACH_M)
            for place in places_m
        ]
        nearness = np.stack([untiled(view.nearness, (BEAM_HEIGHT, BEAM_WIDTH)) for view in views])
        away_m = np.linalg.norm(street_m - world_from_vehicle.translation_m, axis=1)
        order = np.argsort(away_m, kind="stable")[:LAMPS_NEAR]
        near_m = street_m[order[away_m[order] < LAMP_REACH_M]]
        return Lamps(
            np.ascontiguousarray(near_m, dtype=np.float32), np.stack([turn, turn]).astype(np.float32),
            places_m.astype(np.float32), nearness, len(places_m),
        )  # fmt: skip


ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
SIXTH, SIXTY_FOURTH = np.float32(1 / 6), np.float32(1 / 64)
# cd; 6 m above the road: 33 lux below it, 10 on average, a residential street
STREET_LAMP = np.float32(1200.0 / WHITE_LUX)
# Low beam after ECE R112: 20,000 cd just below the cut-off a hundredth below the horizon, a tenth of that 6 degrees
# further down, so that the near road does not outshine the far one; to the sides it fades within 20 degrees.
HEADLIGHT, CUT_OFF = np.float32(20_000.0 / WHITE_LUX), np.float32(0.01)
DOWN_RATE, SIDE_RATE = np.float32(1 / 0.05), np.float32(0.5 / 0.35**2)
RISE, RISES_UNTIL, SHARPNESS = np.float32(0.27), np.float32(0.12), np.float32(1 / 0.008)
FOOT = np.float32(0.0008)  # share of the beam that falls right before the bumper
ABOVE = np.float32(0.012)  # share of the beam that strays above the cut-off
FAINTEST = np.float32(20.0)  # exponent of what counts as no light
LEAST_AHEAD_M = np.float32(0.05)
SHADE_BIAS = np.float32(1.02)  # of the distance; nearer things are the face itself
AT_ONCE = 8  # spots that the compiler takes at once


@inlined
def light_spots(count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    """Find the brightness of white paper at spots of one tile.

    Args:
        count: how many spots there are.
        lamps: that light them.
        lanes: see `lanes`: place and normal, world, of each spot; those of light are filled.
    """
    whole = -(-count // AT_ONCE) * AT_ONCE  # values beyond the last spot are computed, but not looked at
    for n in range(whole):
        lanes[SPOT_LIGHT + n] = ZERO
    for k in range(len(lamps.street_m)):
        _add_street_lamp(k, whole, lamps, lanes)
    for k in range(lamps.headlights):
        _aim_headlight(k, whole, lamps, lanes)
        for n in range(count):
            along, square = lanes[BEAM_ALONG + n], lanes[BEAM_SQUARE + n]
            if along > ZERO:
                distance_m = np.sqrt(square)
                lit = _lit(k, lanes[BEAM_ASIDE + n], lanes[BEAM_DOWN + n], distance_m, lamps.nearness)
                lanes[SPOT_LIGHT + n] += lanes[BEAM + n] * lit * along / (square * distance_m)


@inlined
def _add_street_lamp(k: int, count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    x, y, z = lamps.street_m[k, 0], lamps.street_m[k, 1], lamps.street_m[k, 2]
    for n in range(count):
        dx, dy, dz = x - lanes[SPOT_X + n], y - lanes[SPOT_Y + n], z - lanes[SPOT_Z + n]
        along = dx * lanes[SPOT_TOWARDS_X + n] + dy * lanes[SPOT_TOWARDS_Y + n] + dz * lanes[SPOT_TOWARDS_Z + n]
        square = dx * dx + dy * dy + dz * dz
        # Its light fades with the cosine from straight down.
        lanes[SPOT_LIGHT + n] += STREET_LAMP * max(along, ZERO) * max(dz, ZERO) / (square * square)


@inlined
def _aim_headlight(k: int, count: int, lamps: Lamps, lanes: NDArray[np.float32]) -> None:
    """Where in a headlight's beam each spot lies, and how bright the beam is there; `BEAM_ALONG` is 0 behind it."""
    turns, places_m = lamps.turns, lamps.places_m
    xx, xy, xz = turns[k, 0, 0], turns[k, 0, 1], turns[k, 0, 2]
    yx, yy, yz = turns[k, 1, 0], turns[k, 1, 1], turns[k, 1, 2]
    zx, zy, zz = turns[k, 2, 0], turns[k, 2, 1], turns[k, 2, 2]
    x, y, z = places_m[k, 0], places_m[k, 1], places_m[k, 2]
    for n in range(count):
        dx, dy, dz = lanes[SPOT_X + n] - x, lanes[SPOT_Y + n] - y, lanes[SPOT_Z + n] - z
        along = -(dx * lanes[SPOT_TOWARDS_X + n] + dy * lanes[SPOT_TOWARDS_Y + n] + dz * lanes[SPOT_TOWARDS_Z + n])
        ahead = zx * dx + zy * dy + zz * dz
        per_m = ONE / ahead
        aside, down = (xx * dx + xy * dy + xz * dz) * per_m, (yx * dx + yy * dy + yz * dz) * per_m
        # On the right the cut-off rises, to light the pavement.
        below = down - CUT_OFF + RISE * min(max(aside, ZERO), RISES_UNTIL)
        beam = HEADLIGHT * quick_exp(-min(aside * aside * SIDE_RATE, FAINTEST))
        lower = max(quick_exp(-min(below * DOWN_RATE, FAINTEST)), FOOT)
        upper = max(ABOVE, ONE + below * SHARPNESS)
        lanes[BEAM + n] = beam * (lower if below >= ZERO else upper)
        lanes[BEAM_ASIDE + n], lanes[BEAM_DOWN + n] = aside, down
        lanes[BEAM_ALONG + n] = along if ahead > LEAST_AHEAD_M else ZERO
        lanes[BEAM_SQUARE + n] = dx * dx + dy * dy + dz * dz


@inlined
def quick_exp(power: np.float32) -> np.float32:
    """Exponential of a number between -FAINTEST and 0, within a hundredth of its value.

    Source:
        exp(x) = exp(x / 64) ** 64, with a Taylor series of third order inside.
    """
    part = power * SIXTY_FOURTH
    value = ONE + part * (ONE + part * (HALF + part * SIXTH))
    value *= value
    value *= value
    value *= value
    value *= value
    value *= value
    return value * value


@inlined
def _lit(
    k: int, aside: np.float32, down: np.float32, distance_m: np.float32, nearness: NDArray[np.float32]
) -> np.float32:
    """Share of four rays of a headlight that come as far as a point."""
    column, row = BEAM_FOCAL * aside + MIDDLE_COLUMN, BEAM_FOCAL * down + MIDDLE_ROW
    if not (ZERO <= column < MIDDLE_COLUMN + MIDDLE_COLUMN and ZERO <= row < MIDDLE_ROW + MIDDLE_ROW):
        return ONE
    whole_row, whole_column = np.int32(row), np.int32(column)
    a, b = row - np.float32(whole_row), column - np.float32(whole_column)
    i, j = np.uintp(whole_row), np.uintp(whole_column)
    next_i, next_j = i + np.uintp(1), j + np.uintp(1)
    least = SHADE_BIAS / distance_m
    upper = (ONE - b if nearness[k, i, j] <= least else ZERO) + (b if nearness[k, i, next_j] <= least else ZERO)
    lower = ONE - b if nearness[k, next_i, j] <= least else ZERO
    lower += b if nearness[k, next_i, next_j] <= least else ZERO
    return upper + a * (lower - upper)

"""Lights: the sky and what a polished surface mirrors of it; by night the lamps of the street, and the headlights.

Brightness: white paper at 15 lux is white in the picture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.cameras import PinholeCamera
from bench.geometry import RigidTransform
from bench.machine_code import inlined
from bench.synthesis.imaging.faces import GLOW, SIZE, Faces, atlas_at, quick_log2
from bench.synthesis.imaging.lens import lens_of, untiled
from bench.synthesis.imaging.visibility import find_visible

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


class Headlights:
    """The beams of the ego vehicle."""

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
        """Irradiance by the lamps.

        Args:
            corners_m: (T, 3, 3), m, world: everything but the ego vehicle.
            street_m: see `street_lamps_m`.
            world_from_vehicle: the ego vehicle.
        """
        rotation = np.ascontiguousarray((world_from_vehicle.rotation @ AHEAD_FROM_LAMP).T)
        positions_m = world_from_vehicle.apply(np.array(HEADLIGHTS_M))
        views = [
            find_visible(
                corners_m, self._lens, camera_from_world=rotation, origin_m=position_m, reach_m=SHADOWS_REACH_M
            )
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

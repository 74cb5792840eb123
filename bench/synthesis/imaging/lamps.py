"""Lamps by night: those of the street, and the headlights of the ego vehicle with the shadows that they throw.

Brightness: white paper at 15 lux is white in the picture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.cameras import PinholeCamera
from bench.geometry import RigidTransform
from bench.synthesis.imaging.faces import GLOW, Faces
from bench.synthesis.imaging.lens import lens_of, untiled
from bench.synthesis.imaging.visibility import find_visible

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

"""Wheels of vehicles: a tyre, a dark rim and bright spokes that show how it turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.joints import Joint, wheel
from bench.synthesis.bodies.loft import loft
from bench.synthesis.bodies.looks import ALLOY, PLASTIC, RUBBER
from bench.synthesis.mesh import Mesh, convex, tube

SIDES = 20
PROFILE = ((0.0, 0.90), (0.12, 1.0), (0.88, 1.0), (1.0, 0.90))  # share of the width, share of the radius


def vehicle_wheels(
    axles_x_m: Sequence[float], outer_y_m: float, radius_m: float, *, width_m: float, spokes: int
) -> tuple[list[Part], list[Joint]]:
    """All wheels of a vehicle; those of an axle turn together.

    Args:
        axles_x_m: where the axles are.
        outer_y_m: the wheels' outer faces, from the middle.
        radius_m: of the tyres.
        width_m: of the tyres.
        spokes: of a wheel.
    """
    parts: list[Part] = []
    joints = [wheel(f"axle_{number}", x, radius_m) for number, x in enumerate(axles_x_m)]
    for joint, x in zip(joints, axles_x_m, strict=True):
        for sign in (-1.0, 1.0):
            meshes = _wheel(x, sign * outer_y_m, -sign * width_m, radius_m, spokes)
            parts += [(mesh, joint.name) for mesh in meshes]
    return parts, joints


def _wheel(x: float, face_y: float, inwards: float, radius: float, spokes: int) -> list[Mesh]:
    turns = np.arange(SIDES) * (2 * np.pi / SIDES)
    around = np.stack([np.sin(turns), np.zeros(SIDES), np.cos(turns)], axis=1)
    hub = np.array([x, face_y, radius])
    inside = np.array([0.0, inwards, 0.0])
    tyre = loft([hub + share * inside + size * radius * around for share, size in PROFILE], RUBBER)
    outwards = -np.sign(inwards) * np.array([0.0, 1.0, 0.0])
    rim = tube(hub + 0.1 * inside, hub + 0.004 * outwards, 0.66 * radius, PLASTIC, sides=14)
    cap = tube(hub, hub + 0.018 * outwards, 0.15 * radius, ALLOY, sides=6)
    return [
        tyre,
        rim,
        cap,
        *(_spoke(hub, outwards, 0.62 * radius, 2 * np.pi * k / spokes, spokes) for k in range(spokes)),
    ]


def _spoke(hub: np.ndarray, outwards: np.ndarray, length: float, turn: float, spokes: int) -> Mesh:
    along = np.array([np.sin(turn), 0.0, np.cos(turn)])
    across = np.array([np.cos(turn), 0.0, -np.sin(turn)])
    half = length * 0.55 / spokes
    ends = ((0.0, half), (1.0, 1.7 * half))
    return convex(
        [hub + share * length * along + sign * wide * across + out * outwards
         for share, wide in ends for sign in (-1, 1) for out in (0.0, 0.014)],
        ALLOY,
    )  # fmt: skip

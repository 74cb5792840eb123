"""Wheels of vehicles: a tyre, a dark rim and bright spokes that show how it turns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.synthesis.bodies.body import Part
from bench.synthesis.bodies.joints import Joint, wheel
from bench.synthesis.bodies.loft import loft
from bench.synthesis.bodies.looks import ALLOY, PLASTIC, RUBBER
from bench.synthesis.mesh import Mesh, joined, prism, tube

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
            hub = RigidTransform(np.eye(3), np.array([x, sign * outer_y_m, radius_m]))
            parts.append((_wheel(radius_m, width_m, spokes, sign).moved(hub), joint.name))
    return parts, joints


@cache
def _wheel(radius_m: float, width_m: float, spokes: int, sign: float) -> Mesh:
    """A wheel of the left (1) or right (-1) side; the middle of its outer face is at the origin."""
    around = _circle(SIDES)
    out = np.array([0.0, sign, 0.0])
    tyre = loft([size * radius_m * around - share * width_m * out for share, size in PROFILE], RUBBER)
    rim = tube(-0.1 * width_m * out, 0.004 * out, 0.66 * radius_m, PLASTIC, sides=14)
    cap = tube(0.0 * out, 0.018 * out, 0.15 * radius_m, ALLOY, sides=6)
    return joined([tyre, rim, cap, _spokes(0.62 * radius_m, spokes, out)])


def _spokes(length_m: float, count: int, out: NDArray[np.float64]) -> Mesh:
    """Flat bars from the hub outwards, twice as wide at the rim."""
    half_m = length_m * 0.55 / count * out[1]
    along, across = _circle(count)[:, None], _circle(count, turn_rad=np.pi / 2)[:, None]
    share, wide = np.array([[0.0, -1.0], [1.0, -1.7], [1.0, 1.7], [0.0, 1.0]]).T[:, :, None]
    face = share * length_m * along + wide * half_m * across
    return prism(face, face + 0.014 * out, ALLOY)


def _circle(count: int, *, turn_rad: float = 0.0) -> NDArray[np.float64]:
    """(count, 3) directions around the axle, the first one up but for a turn forward."""
    turns = np.arange(count) * (2 * np.pi / count) + turn_rad
    return np.stack([np.sin(turns), np.zeros(count), np.cos(turns)], axis=1)

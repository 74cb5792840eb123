"""Poses between poses.

Between two poses a vehicle is taken to move with constant twist: the rotation follows the slerp and the
position the arc that belongs to it, so a car on a circle stays on the circle. Without rotation this is the
straight line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.geometry.sphere import cross, dot

SMALL_ANGLE_RAD = 1e-8


def twist_between(
    rotations_from: Rotation,
    positions_from_m: NDArray[np.float64],
    rotations_to: Rotation,
    positions_to_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The constant twist that leads from one pose to the other, one row each.

    Args:
        rotations_from: N rotations, world from body.
        positions_from_m: (N, 3) float64, m.
        rotations_to: N rotations, world from body.
        positions_to_m: (N, 3) float64, m.

    Returns:
        turn_rad: (N, 3) float64, rotation vector of the whole step, body axes.
        path_m: (N, 3) float64, path of the body in its own axes over the whole step, m.
    """
    turn_rad = (rotations_from.inv() * rotations_to).as_rotvec()
    return turn_rad, _inverse_jacobian(turn_rad, rotations_from.inv().apply(positions_to_m - positions_from_m))


def advance_twist(
    turn_rad: NDArray[np.float64], path_m: NDArray[np.float64], fraction: NDArray[np.float64]
) -> tuple[Rotation, NDArray[np.float64]]:
    """Move along a constant twist.

    Args:
        turn_rad: (N, 3) float64, rotation vector of the whole step, body axes.
        path_m: (N, 3) float64, path of the body in its own axes over the whole step, m.
        fraction: (N,) float64, part of the step; outside [0, 1] it extrapolates.

    Returns:
        rotations: N rotations of the part of the step.
        advances_m: (N, 3) float64, m, in the axes at the start of the step.
    """
    part_rad, part_m = turn_rad * fraction[..., None], path_m * fraction[..., None]
    angle = np.sqrt(dot(part_rad, part_rad))
    small = angle < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)[..., None]
    second = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)[..., None]
    once = cross(part_rad, part_m)
    return Rotation.from_rotvec(part_rad), part_m + first * once + second * cross(part_rad, once)


def _inverse_jacobian(turn_rad: NDArray[np.float64], advance_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Path in body axes whose constant twist ends at `advance_m`: the inverse of SO(3)'s left Jacobian."""
    angle = np.sqrt(dot(turn_rad, turn_rad))
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)[..., None]
    once = cross(turn_rad, advance_m)
    return np.asarray(advance_m - 0.5 * once + factor * cross(turn_rad, once))

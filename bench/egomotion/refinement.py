"""Least squares on rays that leaves out what does not agree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.geometry import angle_between, cross, dot, normalise

ROUNDS = 15
NO_MORE_RAD = 1e-7


def fit_rotation(
    rays_previous: NDArray[np.float64], rays_current: NDArray[np.float64], *, tolerance_rad: float
) -> NDArray[np.float64]:
    """The rotation that brings previous rays nearest to current ones.

    Weighted least squares, repeated with Cauchy's weights, whose scale is the median of what is left, but not less
    than half the tolerance.

    Returns:
        (3, 3) float64, current_from_previous.

    Source:
        Kabsch 1976.
    """
    weights = np.ones(len(rays_current))
    rotation = np.eye(3)
    for _ in range(ROUNDS):
        left, _, right = np.linalg.svd((weights[:, None] * rays_current).T @ rays_previous)
        new = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        moved_rad = float(np.linalg.norm(new - rotation))
        rotation = new
        if moved_rad < NO_MORE_RAD:
            break
        angles_rad = angle_between(rays_previous @ rotation.T, rays_current)
        scale_rad = max(float(np.median(angles_rad)), tolerance_rad / 2)
        weights = 1.0 / (1.0 + (angles_rad / scale_rad) ** 2)
    return rotation


def refine_pose(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    rotation: NDArray[np.float64],
    direction: NDArray[np.float64],
    *,
    tolerance_rad: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss-Newton on the sine of the angle to the epipolar plane, over the five unknowns of rotation and direction.

    Tukey's weights leave out what lies beyond the tolerance; its first rounds are three times as wide.

    Returns:
        rotation (3, 3) and direction (3,), a unit vector, current_from_previous.
    """
    for number in range(ROUNDS):
        cut_rad = tolerance_rad * (3.0 if number < ROUNDS // 3 else 1.0)
        turned = rays_previous @ rotation.T
        plane = cross(turned, rays_current)
        length = np.linalg.norm(cross(np.broadcast_to(direction, turned.shape), turned), axis=1)
        scale = 1.0 / np.maximum(length, 1e-3)  # next to the epipole there is no plane
        off = (plane @ direction) * scale
        weights = np.maximum(1.0 - (off / cut_rad) ** 2, 0.0) ** 2
        # s = t.(q x p') changes by dw.((t.q) p' - (q.p') t) when q turns by dw, and by dt.(q x p') when t moves.
        by_turn = (turned @ direction)[:, None] * rays_current - dot(turned, rays_current)[:, None] * direction
        across = _tangents(direction)
        slopes = np.hstack([by_turn, plane @ across.T]) * scale[:, None]
        weighted = slopes * weights[:, None]
        step = np.linalg.lstsq(weighted.T @ slopes, -weighted.T @ off, rcond=1e-12)[0]
        rotation = Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        direction = normalise(direction + step[3:] @ across)
        if np.abs(step).max() < NO_MORE_RAD and number > ROUNDS // 3:
            break
    return rotation, direction


def _tangents(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors across a direction: (2, 3)."""
    axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = normalise(cross(direction, axis))
    return np.stack([first, cross(direction, first)])

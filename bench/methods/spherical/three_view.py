"""The three-view constraint, for points tracked over three images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform, cross, dot, normalise


def three_view_deviation(
    rays_first: NDArray[np.float64],
    rays_second: NDArray[np.float64],
    rays_third: NDArray[np.float64],
    *,
    second_from_first: RigidTransform,
    third_from_second: RigidTransform,
    min_angle_rad: float = 1e-4,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Compare the point that two pairs of views see with the one that the outer pair sees.

    All vectors are turned into the third camera's frame and projected on the epipolar plane of the first pair. There
    the angles at which the point sees each baseline must add up: theta + theta' = theta_tot.

    Args:
        rays_first: (..., 3) float64, unit rays, first camera frame; NaN where not valid.
        rays_second: (..., 3) float64, unit rays, second camera frame.
        rays_third: (..., 3) float64, unit rays, third camera frame.
        second_from_first: camera motion of the first pair, metric.
        third_from_second: camera motion of the second pair, metric.
        min_angle_rad: pairs that see the point under a smaller angle, or next to the epipole, say nothing.

    Returns:
        deviation: (...) float64, xi_3v = sin|theta + theta' - theta_tot|; 0 where not defined. It is blind to objects
            that move parallel to the host at constant speed.
        defined: (...) bool.

    Source:
        Mariotti and Eising, section III-F, with phi' = pi - omega', which the print leaves undefined, and
        t_tot = t' + R' t in the third frame.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        turn = third_from_second.rotation
        t_first, t_second = turn @ second_from_first.translation_m, third_from_second.translation_m
        first = (third_from_second @ second_from_first).rotate(rays_first)
        second, third = third_from_second.rotate(rays_second), rays_third
        normal = normalise(cross(first, t_first))

        first, second, third = (_onto(rays, normal) for rays in (first, second, third))
        base_first, base_second, base_total = (
            _onto(np.broadcast_to(t, first.shape), normal) for t in (t_first, t_second, t_first + t_second)
        )
        omega_first, omega_second = _angle(base_first, first, normal), _angle(base_second, second, normal)
        theta_first = omega_first - _angle(base_first, second, normal)
        theta_second = omega_second - _angle(base_second, third, normal)

        # C''P_i by the law of sines, with sin(phi') = sin(pi - omega') = sin(omega').
        reach = _length(base_second) * np.sin(omega_second) / np.sin(theta_second)
        rho_total = _angle(base_total, third, normal)
        across, along = np.sin(rho_total) * _length(base_total), reach - np.cos(rho_total) * _length(base_total)
        theta_total = np.arctan2(across, along)
        deviation = np.abs(np.sin(theta_first + theta_second - theta_total))
        defined = (
            np.isfinite(deviation)
            & (np.abs(theta_second) > min_angle_rad)
            & (np.abs(np.sin(omega_second)) > min_angle_rad)
            & (np.abs(np.sin(omega_first)) > min_angle_rad)
        )
    deviation[~defined] = 0.0
    return deviation, defined


def _onto(vectors: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors - dot(vectors, normal)[..., None] * normal)


def _angle(start: NDArray[np.float64], end: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle from `start` to `end` about `normal`, with its sign: a ray may pass the baseline while turning."""
    return np.asarray(np.arctan2(dot(normal, cross(start, end)), dot(start, end)))


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(dot(vectors, vectors))

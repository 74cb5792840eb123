"""The paper's constraints, each as a deviation of rays from what a static world allows.

Two views of a moving camera: epipolar, positive depth, positive height, anti-parallel. Two views of a stationary
camera: flow on the unit sphere. Three views: agreement of the two pairs with the outer one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.geometry import RigidTransform, RoadPlane, cross, dot, normalise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """Distance of each point from anything a static world could show; (...) float64, >= 0.

    Attributes:
        epipolar: xi_e, distance to the epipolar plane.
        positive_depth: xi_d, rays that meet behind the camera.
        positive_height: xi_h, rays that meet below the road.
        anti_parallel: xi_p, rays that meet above the road, nearer than it by more than the threshold.
        defined: (...) bool; False where a ray is not valid or next to the epipole; all deviations are 0 there.
    """

    epipolar: NDArray[np.float64]
    positive_depth: NDArray[np.float64]
    positive_height: NDArray[np.float64]
    anti_parallel: NDArray[np.float64]
    defined: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Variants:
    """Departures from the paper, all off by default.

    Attributes:
        geodesic: measure xi_e as the angle arcsin(n'.p') instead of its sine (the paper's own note; 2e-4 relative
            difference at 2 degrees).
        full_cheirality: count p' beyond e' as negative depth too, `n'.(p'_P x e') < 0`: rays that meet behind the
            camera because the point has passed the focus of contraction.
        ungated_height: drop `n'.p_n < 0` from positive height, which then also sees objects at the ego vehicle's own
            speed, at the price of counting the same motion twice with positive depth.
    """

    geodesic: bool = False
    full_cheirality: bool = False
    ungated_height: bool = False


PAPER = Variants()


def deviations(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    *,
    current_from_previous: RigidTransform,
    road: RoadPlane,
    path_share: NDArray[np.float64] | float = 1.0,
    lambda_height: float = 0.001,
    lambda_anti_parallel: float = 0.001,
    min_epipole_sine: float = 0.01,
    variants: Variants = PAPER,
) -> Deviations:
    """Measure the deviations of point correspondences from a static world.

    Args:
        rays_previous: (..., 3) float64, unit rays p of the previous camera frame; NaN where not valid.
        rays_current: (..., 3) float64, unit rays p' of the current camera frame; NaN where not valid.
        current_from_previous: motion of the camera, metric for positive height and anti-parallel; epipolar and positive
            depth do not depend on its scale.
        road: the road below the current camera.
        path_share: (...) float64, by how much longer than the translation the camera's path is between the rows that
            saw the point (`bench.methods.two_views`); 1 where all rows are exposed at once.
        lambda_height: threshold of positive height, subtracted.
        lambda_anti_parallel: threshold of anti-parallel, subtracted.
        min_epipole_sine: alpha_min, the sine of the angle between q and the epipole below which the epipolar plane
            is not defined.
        variants: departures from the paper.

    Returns:
        The deviations, one per correspondence.

    Raises:
        ShapeError: rays of different shapes, or a camera that did not move (use `static_camera_deviation`).

    Source:
        Mariotti and Eising, equations 1, 2, 8 to 16, with these corrections: q = R p stands for p throughout; p'_P
        (equation 8) and p'_r (equation 12) are normalised; p'_r uses the rotated ray; the conditions on n'.p of
        equations 15 and 16 mean n'.v; equation 16 is xi_p and both thresholds clamp at 0.
    """
    rays_previous, rays_current = np.asarray(rays_previous, float), np.asarray(rays_current, float)
    if rays_previous.shape != rays_current.shape or rays_current.shape[-1:] != (3,):
        raise ShapeError(f"rays: expected two arrays (..., 3), got {rays_previous.shape} and {rays_current.shape}")
    if not np.any(current_from_previous.translation_m):
        raise ShapeError("deviations: the camera did not move and has no epipole; use static_camera_deviation")
    p, t = rays_current, current_from_previous.translation_m
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q, epipole = current_from_previous.rotate(rays_previous), normalise(t)  # q for p, p for p', and e'
        c = cross(q, epipole)
        sine = np.sqrt(dot(c, c))
        defined = (sine >= min_epipole_sine) & np.isfinite(p[..., 0])  # NaN rays compare as False
        n = c / sine[..., None]  # eq. 1

        n_dot_p = dot(n, p)
        epipolar = np.abs(np.arcsin(np.clip(n_dot_p, -1, 1)) if variants.geodesic else n_dot_p)  # eq. 2

        p_in_plane = normalise(p - n_dot_p[..., None] * n)  # p'_P, eq. 8
        p_n = cross(p_in_plane, q)  # eq. 9; it lies along n
        n_dot_pn = dot(n, p_n)
        behind = n_dot_pn > 0
        if variants.full_cheirality:
            behind |= dot(n, cross(p_in_plane, epipole)) < 0
        positive_depth = np.where(behind, np.abs(n_dot_pn), 0.0)  # eq. 10

        below = (dot(q, road.down) > 0) & (dot(p, road.down) > 0)
        path_m = np.multiply.outer(path_share, t)  # t, as long as it is for this point
        p_on_road = normalise(road.distance_m(q)[..., None] * q + path_m)  # p'_r, eq. 12, 13; NaN above the horizon
        v = cross(p_in_plane, p_on_road)  # eq. 14; it lies along n
        n_dot_v = dot(n, v)
        towards = below & (n_dot_pn < 0)
        nearer = below if variants.ungated_height else towards
        positive_height = np.where(nearer & (n_dot_v > 0), np.maximum(n_dot_v - lambda_height, 0.0), 0.0)  # eq. 15
        anti_parallel = np.where(
            towards & (n_dot_v < 0), np.maximum(-n_dot_v - lambda_anti_parallel, 0.0), 0.0
        )  # eq. 16

    for deviation in (epipolar, positive_depth, positive_height, anti_parallel):
        deviation[~defined] = 0.0
    return Deviations(
        epipolar=epipolar,
        positive_depth=positive_depth,
        positive_height=positive_height,
        anti_parallel=anti_parallel,
        defined=defined,
    )


def static_camera_deviation(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    *,
    current_from_previous: RigidTransform,
    road: RoadPlane,
    lambda_static_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Flow on the unit sphere, without creep on the road.

    Below the horizon both rays are put on the road plane, and the deviation is 0 where they land closer together than
    `lambda_static_m`: wheel ticks register a start only after the first centimetres.

    Args:
        rays_previous: (..., 3) float64, unit rays p of the previous camera frame; NaN where not valid.
        rays_current: (..., 3) float64, unit rays p' of the current camera frame; NaN where not valid.
        current_from_previous: its rotation is applied; its translation counts as none.
        road: the road below the camera.
        lambda_static_m: lambda_s, m.

    Returns:
        deviation: (...) float64, |p' x q|, 0 where not defined.
        defined: (...) bool.

    Source:
        Mariotti and Eising, section III-G, equations 17 to 19.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        q = current_from_previous.rotate(rays_previous)
        c = cross(rays_current, q)
        deviation = np.sqrt(dot(c, c))
        defined = np.isfinite(deviation)
        reach_previous, reach_current = road.distance_m(q), road.distance_m(rays_current)
        below = np.isfinite(reach_previous) & np.isfinite(reach_current)
        step = reach_current[..., None] * rays_current - reach_previous[..., None] * q  # d = P' - P, eq. 18
        crept = below & (dot(step, step) < lambda_static_m**2)
    deviation[crept | ~defined] = 0.0
    return deviation, defined


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

    All vectors are rotated into the third camera's frame and projected on the epipolar plane of the first pair. There
    the angles at which the point sees each baseline must add up: theta + theta' = theta_tot.

    Args:
        rays_first: (..., 3) float64, unit rays, first camera frame; NaN where not valid.
        rays_second: (..., 3) float64, unit rays, second camera frame.
        rays_third: (..., 3) float64, unit rays, third camera frame.
        second_from_first: camera motion of the first pair, metric.
        third_from_second: camera motion of the second pair, metric.
        min_angle_rad: pairs that see the point under a smaller angle, or next to the epipole, are not defined.

    Returns:
        deviation: (...) float64, xi_3v = sin|theta + theta' - theta_tot|; 0 where not defined. It is blind to objects
            that move parallel to the ego vehicle at constant speed.
        defined: (...) bool.

    Source:
        Mariotti and Eising, section III-F, with phi' = pi - omega', which the print leaves undefined, and
        t_tot = t' + R' t in the third frame.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        t_first = third_from_second.rotation @ second_from_first.translation_m
        t_second = third_from_second.translation_m
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
    """Angle from `start` to `end` about `normal`, with its sign: under rotation a ray may pass the baseline."""
    return np.asarray(np.arctan2(dot(normal, cross(start, end)), dot(start, end)))


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(dot(vectors, vectors))

"""The four two-view deviations: epipolar, positive depth, positive height, anti-parallel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.geometry import RigidTransform, RoadPlane, cross, dot, normalise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """How far each point is from anything a static world could show; (...) float64, >= 0.

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
        ungated_height: drop `n'.p_n < 0` from positive height, which then also sees objects at the host's own speed,
            at the price of counting the same motion twice with positive depth.
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
        p_on_road = normalise(road.distance_m(q)[..., None] * q + t)  # p'_r, eq. 12 and 13; NaN above the horizon
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

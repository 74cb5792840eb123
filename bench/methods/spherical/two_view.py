"""The four two-view deviations: epipolar, positive depth, positive height, anti-parallel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.geometry import RigidTransform, RoadPlane, cross, dot


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
    t = current_from_previous.translation_m
    length_m = float(np.linalg.norm(t))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q, along = current_from_previous.rotate(rays_previous), t / length_m
        c = cross(q, along)
        sine = np.sqrt(dot(c, c))
        defined = (sine >= min_epipole_sine) & np.isfinite(rays_current[..., 0])  # NaN rays compare as False

        off_plane = dot(c, rays_current) / sine  # n'.p' with n = c / |c|, eq. 1
        epipolar = np.abs(np.arcsin(np.clip(off_plane, -1, 1))) if variants.geodesic else np.abs(off_plane)  # eq. 2

        # What n = q x t / |q x t| says of p'_P (eq. 8) opens into scalar products, in half of the time:
        # n'.(p' x q) = ((p'.q)(q.t) - p'.t) / |q x t| and n'.(p' x t) = (p'.q - (q.t)(p'.t)) / |q x t| for a t of
        # length 1. The part of p' along n adds nothing to either.
        p_q, q_t, p_t = dot(rays_current, q), dot(q, along), dot(rays_current, along)
        scale = 1.0 / (sine * np.sqrt(1.0 - off_plane * off_plane))
        turn = (p_q * q_t - p_t) * scale  # n'.p_n, eq. 9: p'_P x q lies along n', so |p_n| is its absolute value
        past = (p_q - q_t * p_t) * scale  # n'.(p'_P x t)
        behind = turn > 0
        if variants.full_cheirality:
            behind |= past < 0
        positive_depth = np.where(behind, np.abs(turn), 0.0)  # eq. 10

        below = (dot(q, road.down) > 0) & (dot(rays_current, road.down) > 0)
        s = road.distance_m(q)  # eq. 13
        reach_m = np.sqrt(s * s + length_m * (2.0 * s * q_t + length_m))  # |s q + t|
        side = (s * turn + length_m * past) / reach_m  # n'.v with p'_r = (s q + t) / |s q + t|, eq. 12 and 14
        towards = below & (turn < 0)
        nearer = below if variants.ungated_height else towards
        positive_height = np.where(nearer & (side > 0), np.maximum(side - lambda_height, 0.0), 0.0)  # eq. 15
        anti_parallel = np.where(towards & (side < 0), np.maximum(-side - lambda_anti_parallel, 0.0), 0.0)  # eq. 16

    for deviation in (epipolar, positive_depth, positive_height, anti_parallel):
        deviation[~defined] = 0.0
    return Deviations(
        epipolar=epipolar,
        positive_depth=positive_depth,
        positive_height=positive_height,
        anti_parallel=anti_parallel,
        defined=defined,
    )

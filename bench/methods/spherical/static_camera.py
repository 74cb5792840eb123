"""The degenerate case of a camera that stands still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform, RoadPlane, cross, dot


def static_camera_deviation(
    rays_previous: NDArray[np.float64],
    rays_current: NDArray[np.float64],
    *,
    current_from_previous: RigidTransform,
    road: RoadPlane,
    lambda_static_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Flow on the unit sphere, with creep on the road taken out.

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

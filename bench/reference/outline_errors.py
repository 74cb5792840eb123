"""Uncertainty of the outline of an object's returns, as a standard deviation near each of them.

- **beam spacing**: the outline lies anywhere between the outermost return and the next beam, which missed, uniform over
  one step between columns or rows: step / sqrt(12), along that step. Lidars have rows close together near the horizon
  and far apart below. It differs by direction, so its part moves the ends of the patches (`patches.end_spread`). Where
  the returns form no rows, each of N stands for an N-th of the region: s = sqrt(area / N).
- **range noise** moves a return along the lidar's ray, which the camera sees from the side: noise x sin(parallax).
- **calibration** between lidar and camera: an angle, and a displacement over the distance.
- **time** between return and exposure: the object's own motion is compensated, that of its limbs is not. A limb swings
  along the direction of travel, as a sine (rms = peak / sqrt(2)), the faster the farther from its joint: feet move, the
  head does not. The camera sees the part of it that lies across its ray.
  Without times of points the relative motion during a revolution is not compensated either: uniform over one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.geometry import cross, dot
from bench.records.reference import Limb, OutlineErrors
from bench.times import SECOND_NS

SINE_RMS = 2.0**-0.5  # of a peak speed, over a stride


def limb_motion_m(
    limbs: Sequence[Limb], heights: NDArray[np.float64], *, speed_mps: float, times_ns: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return how far points moved with limbs: (N,) float64, m, standard deviation along the direction of travel.

    Args:
        limbs: of the object; the fastest at each return's height counts.
        heights: (N,) float64, of each return above the object's bottom, over the object's height.
        speed_mps: of the object.
        times_ns: (N,) int64, of each return, since the exposure.
    """
    shares = [limb.speed * (limb.joint - heights) / (limb.joint - limb.end) for limb in limbs]
    reached = [np.where(heights >= limb.end, share, 0.0) for limb, share in zip(limbs, shares, strict=True)]
    fastest = np.maximum.reduce([np.zeros_like(heights), *reached])
    return np.asarray(fastest * SINE_RMS * speed_mps * np.abs(times_ns) / SECOND_NS)


def outline_error_m(
    points_camera: NDArray[np.float64],
    *,
    sensor_camera: NDArray[np.float64],
    variance_m2: NDArray[np.float64],
    errors: OutlineErrors,
) -> NDArray[np.float64]:
    """Uncertainty of an object's outline near each of its returns, for all causes but the spacing of the beams.

    Args:
        points_camera: (N, 3) float64, m, these returns at exposure.
        sensor_camera: (3,) float64, m, where the lidar was.
        variance_m2: (N,) float64, square of the standard deviation of the unknown part of each return's motion, as
            the camera sees it.
        errors: of the protocol.

    Returns:
        (N,) float64, m, standard deviation across the camera's ray.
    """
    beams = points_camera - sensor_camera
    distance2_m2, aside = dot(points_camera, points_camera), cross(points_camera, beams)
    parallax2 = np.nan_to_num(dot(aside, aside) / (distance2_m2 * dot(beams, beams)))  # squared sine
    variance_m2 = variance_m2 + errors.range_noise_m**2 * parallax2 + errors.position_m**2
    return np.asarray(np.sqrt(errors.angle_rad**2 * distance2_m2 + variance_m2))

"""Where the lidar sees the road, against where the calibration says that it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RING_M = (2.5, 14.0)  # around the vehicle's origin
CELL_M = 1.0
LEAST_CELLS = 15
CELL_POINTS = 2
FIRST_SLAB_M, SLAB_M = 0.6, 0.12  # half a slab around the plane, at first and at last; kerbs lie beyond
ROUNDS = 6
LEAST_SHARE = 0.3  # of the cells


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenRoad:
    """The road of one sweep.

    Attributes:
        height_m: of the road below the vehicle's origin, vehicle frame.
        tilt_rad: to the vehicle's xy plane.
    """

    height_m: float
    tilt_rad: float


def seen_road(points_vehicle: NDArray[np.float64]) -> SeenRoad | None:
    """Fit a plane to the lowest points of cells around the vehicle.

    Args:
        points_vehicle: (N, 3) float64, m, vehicle frame.

    Returns:
        None where too little of the road is seen.
    """
    away_m = np.hypot(points_vehicle[:, 0], points_vehicle[:, 1])
    near = points_vehicle[(away_m > RING_M[0]) & (away_m < RING_M[1])]
    if len(near) < LEAST_CELLS:
        return None
    cell = np.floor(near[:, :2] / CELL_M).astype(np.int64)
    _, number, count = np.unique(cell[:, 0] * 100_000 + cell[:, 1], return_inverse=True, return_counts=True)
    lowest = near[np.lexsort((near[:, 2], number))][np.concatenate([[0], np.cumsum(count)[:-1]])]
    lowest = lowest[count >= CELL_POINTS]
    if len(lowest) < LEAST_CELLS:
        return None
    heights = np.sort(lowest[:, 2])
    held = np.searchsorted(heights, heights + FIRST_SLAB_M) - np.arange(len(heights))
    plane = np.array([0.0, 0.0, float(heights[np.argmax(held)]) + FIRST_SLAB_M / 2])
    design = np.column_stack([lowest[:, :2], np.ones(len(lowest))])
    for slab_m in np.linspace(FIRST_SLAB_M, SLAB_M, ROUNDS):
        rows = np.abs(lowest[:, 2] - design @ plane) < slab_m
        if rows.sum() < max(LEAST_CELLS, LEAST_SHARE * len(lowest)):
            return None
        plane = np.linalg.lstsq(design[rows], lowest[rows, 2], rcond=None)[0]
    return SeenRoad(height_m=float(plane[2]), tilt_rad=float(np.arctan(np.hypot(plane[0], plane[1]))))

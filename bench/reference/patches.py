"""The piece of surface that each lidar return stands for.

A hull of points ends at the outermost returns, which lie half a beam spacing inside the true outline on average, and
bridges whatever gaps its tightness allows. But a beam answers for the solid angle half-way to its neighbours. The union
of these patches estimates the silhouette without that bias and at the sensor's own resolution: legs stay apart, and a
wheel stays open where the lidar saw through it.

Rows and columns are found from the directions of the returns, so these have to be seen from where the beams start: a
data set that gives its points in other axes has to tell `Recording.lidar_from_beams`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.reference.neighbours import BRIDGED_STEPS, Grid

STEEPEST = np.tan(np.radians(80))  # a neighbour further behind than on a surface this oblique is another surface


def surface_patches(
    points_beams: NDArray[np.floating],
    points_world: NDArray[np.float64],
    *,
    world_from_beams: NDArray[np.float64],
    grid: Grid,
) -> NDArray[np.float64]:
    """Corners of the patch of each return.

    Towards a neighbour the patch reaches along the surface to the neighbour itself, so that patches overlap and leave
    no slits when seen from the camera's place. Where there is none it ends half-way to where the next beam would be.

    Args:
        points_beams: (N, 3), m, the beams' own axes at each point's own time.
        points_world: (N, 3) float64, m, the same points at exposure.
        world_from_beams: (3, 3) float64, turns the beams' axes into those of `points_world`.
        grid: neighbours of the same points.

    Returns:
        (N, 4, 3) float64, m, world frame: left above, right above, right below, left below.
    """
    points = points_beams.astype(np.float64)
    flat_m = np.hypot(points[:, 0], points[:, 1])
    ranges_m = np.hypot(flat_m, points[:, 2])
    wide_m, tall_m = flat_m * grid.column_step_rad, ranges_m * grid.row_step_rad
    leftwards, upwards = _square_to_beam(points, flat_m, ranges_m)
    aside, upright = (
        (leftwards * wide_m[:, None]) @ world_from_beams.T,
        (upwards * tall_m[:, None]) @ world_from_beams.T,
    )
    reach = {}
    for name, step, step_m in (
        ("left", aside, wide_m),
        ("right", -aside, wide_m),
        ("up", upright, tall_m),
        ("down", -upright, tall_m),
    ):
        neighbour = getattr(grid, name)
        linked = (neighbour >= 0) & (np.abs(ranges_m[neighbour] - ranges_m) <= STEEPEST * BRIDGED_STEPS * step_m)
        reach[name] = np.where(linked[:, None], points_world[neighbour] - points_world, step / 2)
    corners = (("up", "left"), ("up", "right"), ("down", "right"), ("down", "left"))
    return np.stack([points_world + reach[tall] + reach[wide] for tall, wide in corners], axis=1)


def reach_bounds(
    patches_world: NDArray[np.float64],
    *,
    at_lowest_beam: NDArray[np.bool_],
    at_highest_beam: NDArray[np.bool_],
    bottom_m: float,
    top_m: float,
    clearance_m: float,
) -> NDArray[np.float64]:
    """Give back what the clearance and the lidar's vertical field cut off, as far as the annotated shape goes.

    Patches that end within the clearance above the ground stand on it: shoes and tyres. Below the lowest beam and above
    the highest the lidar is blind, there the column goes on to the end of the annotated shape. Nothing else is added:
    under a bumper the lidar saw the road.

    Args:
        patches_world: (N, 4, 3) float64, m, as from `surface_patches`.
        at_lowest_beam: (N,) bool, returns of the lowest beam.
        at_highest_beam: (N,) bool, returns of the highest beam.
        bottom_m: height of the annotated shape's lowest point, world frame.
        top_m: of its highest.
        clearance_m: returns lower than this above the bottom were taken for the ground's.

    Returns:
        (N, 4, 3) float64, m.
    """
    heights = patches_world[:, :, 2].copy()
    lower, upper = heights[:, 2:], heights[:, :2]
    grounded = at_lowest_beam[:, None] | (lower < bottom_m + clearance_m)
    heights[:, 2:] = np.where(grounded, np.minimum(lower, bottom_m), lower)
    heights[:, :2] = np.where(at_highest_beam[:, None], np.maximum(upper, top_m), upper)
    return np.concatenate([patches_world[:, :, :2], heights[:, :, None]], axis=2)


def _square_to_beam(
    points: NDArray[np.float64], flat_m: NDArray[np.float64], ranges_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors to the left of each beam and up from it, (N, 3) each; NaN on the lidar's axis."""
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine, sine = points[:, 0] / flat_m, points[:, 1] / flat_m
        lift, slope = points[:, 2] / ranges_m, flat_m / ranges_m
    left = np.column_stack([-sine, cosine, np.zeros(len(points))])
    return left, np.column_stack([-lift * cosine, -lift * sine, slope])

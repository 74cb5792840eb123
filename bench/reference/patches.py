"""The piece of surface that each lidar return stands for, and the polygon of their union in the image.

A hull of points ends at the outermost returns, which lie half a beam spacing inside the true outline on average, and
bridges whatever gaps its tightness allows. But a beam answers for the solid angle half-way to its neighbours. The union
of these patches estimates the silhouette without that bias and at the sensor's own resolution: legs stay apart, and a
wheel stays open where the lidar saw through it.

Which returns are neighbours on the lidar's grid of rows and columns is found from their directions alone, so that it
works for data without rings or times and for any number of beams. The directions have to be those from the sensor: a
data set that gives its points in other axes has to state `Recording.lidar_from_beams`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import Polygon

from bench.reference.polygons import Raster, trace_polygon

CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))  # up and left of the middle of a patch
QUERIES = 256  # returns of a cluster, evenly chosen, that tell the step between columns
NEIGHBOURS = 8  # enough to meet the next column even where rows lie four times closer than columns
BRIDGED_STEPS = 2.5  # one missing return between two is a dropout, two are a gap in the object
SAME_ROW = 0.35  # of the step between columns: returns closer in elevation lie in one row
LOCAL = 100  # returns that tell the usual angle between rows at their elevation
DEEPEST_STEPS = BRIDGED_STEPS * np.tan(np.radians(80))  # as on a surface this oblique; further behind is another one
CERTAIN_STEPS = (BRIDGED_STEPS**2 - 1) ** 0.5  # a link as long as that over a missing return
SLIT = np.ones((3, 3), dtype=np.uint8)  # closes what is a pixel wide: finer than a beam
MARGIN_PX = 4  # beyond the image, so that its border does not cut the outline
ROW_KEY = 8.0  # larger than any difference of elevations, which makes (column, elevation) one sortable number


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Neighbours of each return, and how far apart the lidar's samples are.

    Attributes:
        left, right, up, down: (N,) intp, row of the neighbour; -1 where there is none within 2.5 steps.
        column_step_rad: between columns, one for the cluster.
        row_step_rad: (N,) float64, between rows at each return; the cluster's median where it has no neighbour.
    """

    left: NDArray[np.intp]
    right: NDArray[np.intp]
    up: NDArray[np.intp]
    down: NDArray[np.intp]
    column_step_rad: float
    row_step_rad: NDArray[np.float64]


def find_grid(points_sensor: NDArray[np.floating]) -> Grid | None:
    """Find the neighbours of each return.

    Args:
        points_sensor: (N, 3), m, sensor frame at each point's own time.

    Returns:
        The grid; None where no two returns lie beside each other in a row, so that the step between columns is unknown.
    """
    if len(points_sensor) < 2:
        return None
    azimuth, elevation = _directions(points_sensor, middle=points_sensor.astype(np.float64).mean(axis=0))
    column_step = _column_step(azimuth, elevation)
    if column_step <= 0:
        return None
    up, down, middle = _above_and_below(azimuth, elevation, column_step)
    lifts = [np.where(to >= 0, np.abs(elevation[to] - elevation), np.nan) for to in (up, down)]
    row_step = np.fmin(*lifts)
    return Grid(
        left=_beside(azimuth, elevation, column_step, 1, middle / 2),
        right=_beside(azimuth, elevation, column_step, -1, middle / 2),
        up=up,
        down=down,
        column_step_rad=column_step,
        row_step_rad=np.where(np.isfinite(row_step), np.minimum(row_step, 1.5 * middle), middle),
    )


def _directions(
    points_sensor: NDArray[np.floating], *, middle: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth about a middle direction, so that no cluster is cut in two behind the sensor, and elevation; rad."""
    x, y, z = points_sensor.astype(np.float64).T
    azimuth = np.arctan2(y, x) - np.arctan2(middle[1], middle[0])
    return (azimuth + np.pi) % (2 * np.pi) - np.pi, np.arctan2(z, np.hypot(x, y))


def _column_step(azimuth: NDArray[np.float64], elevation: NDArray[np.float64]) -> float:
    """Median angle to the next return of the same row, on one side so that noise does not make it too small."""
    directions = np.column_stack([azimuth * np.cos(elevation), elevation])
    tree = cKDTree(directions, balanced_tree=False, compact_nodes=False)
    asked = np.arange(0, len(directions), max(1, len(directions) // QUERIES))
    _, nearest = tree.query(directions[asked], k=min(NEIGHBOURS + 1, len(directions)))
    steps = azimuth[nearest] - azimuth[asked][:, None]
    lifts = np.abs(elevation[nearest] - elevation[asked][:, None])
    found = np.where((steps > 0) & (lifts < steps / 2), steps, np.inf).min(axis=1)
    found = found[np.isfinite(found)]
    return float(np.median(found)) if found.size else 0.0


def _above_and_below(
    azimuth: NDArray[np.float64], elevation: NDArray[np.float64], column_step: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Neighbours in the same column, and the usual angle between rows at each return."""
    column = np.floor(azimuth / (1.5 * column_step)) * ROW_KEY  # wide enough to hold a return of every row
    order = np.argsort(column + elevation, kind="stable")
    keys = (column + elevation)[order]
    found, lifts = [], []
    for position in (
        np.searchsorted(keys, column + elevation + SAME_ROW * column_step),
        np.searchsorted(keys, column + elevation - SAME_ROW * column_step) - 1,
    ):
        other = order[np.clip(position, 0, len(order) - 1)]
        lift = np.abs(elevation[other] - elevation)
        same_column = (column[other] == column) & (lift >= SAME_ROW * column_step)
        found.append(other)
        lifts.append(np.where(same_column, lift, np.inf))
    usual = _usual_by_elevation(elevation, np.minimum(*lifts), otherwise=column_step)
    up, down = (np.where(lift <= BRIDGED_STEPS * usual, other, -1) for other, lift in zip(found, lifts, strict=True))
    return up, down, usual


def _usual_by_elevation(
    elevation: NDArray[np.float64], lifts: NDArray[np.float64], *, otherwise: float
) -> NDArray[np.float64]:
    """Median angle between rows around each return's elevation: lidars have rows close together near the horizon and
    several times further apart below."""
    order = np.argsort(elevation, kind="stable")
    parts = np.array_split(order, max(1, len(order) // LOCAL))
    usual = np.full(len(elevation), otherwise)
    whole = lifts[np.isfinite(lifts)]
    for part in parts:
        near = lifts[part][np.isfinite(lifts[part])]
        if near.size or whole.size:
            usual[part] = np.median(near if near.size else whole)
    return usual


def _beside(
    azimuth: NDArray[np.float64],
    elevation: NDArray[np.float64],
    column_step: float,
    side: int,
    most_lift: NDArray[np.float64],
) -> NDArray[np.intp]:
    """The return of nearest elevation in the next column, else in the one after it; `side` 1 is left, -1 right."""
    key = np.floor(azimuth / column_step) * ROW_KEY + elevation
    order = np.argsort(key, kind="stable")
    found = np.full(len(azimuth), -1, dtype=np.intp)
    for columns in (2, 1):
        least = most_lift
        position = np.searchsorted(key[order], key + side * columns * ROW_KEY)
        for shift in (-1, 0):
            other = order[np.clip(position + shift, 0, len(order) - 1)]
            step, lift = (azimuth[other] - azimuth) * side, np.abs(elevation[other] - elevation)
            better = (step > column_step / 4) & (step <= BRIDGED_STEPS * column_step) & (lift < least)
            found, least = np.where(better, other, found), np.where(better, lift, least)
    return found


def surface_patches(
    points_sensor: NDArray[np.floating],
    points_world: NDArray[np.float64],
    *,
    world_from_sensor: NDArray[np.float64],
    grid: Grid,
    deepest_steps: float = DEEPEST_STEPS,
) -> NDArray[np.float64]:
    """Corners of the patch of each return.

    Towards a neighbour the patch reaches along the surface to the neighbour itself, so that patches overlap and leave
    no slits when seen from the camera. Where there is none it ends half-way to where the next beam would be.

    Args:
        points_sensor: (N, 3), m, sensor frame at each point's own time.
        points_world: (N, 3) float64, m, the same points at exposure.
        world_from_sensor: (3, 3) float64, from sensor axes to those of `points_world`.
        grid: neighbours of the same points.
        deepest_steps: neighbours that lie further apart in range than so many beam spacings are not linked.

    Returns:
        (N, 4, 3) float64, m, world frame: left above, right above, right below, left below.
    """
    points = points_sensor.astype(np.float64)
    flat_m = np.hypot(points[:, 0], points[:, 1])
    ranges_m = np.hypot(flat_m, points[:, 2])
    wide_m, tall_m = flat_m * grid.column_step_rad, ranges_m * grid.row_step_rad
    leftwards, upwards = _square_to_beam(points, flat_m, ranges_m)
    aside, upright = (
        (leftwards * wide_m[:, None]) @ world_from_sensor.T,
        (upwards * tall_m[:, None]) @ world_from_sensor.T,
    )
    reach = {}
    for name, step, step_m in (
        ("left", aside, wide_m),
        ("right", -aside, wide_m),
        ("up", upright, tall_m),
        ("down", -upright, tall_m),
    ):
        neighbour = getattr(grid, name)
        linked = (neighbour >= 0) & (np.abs(ranges_m[neighbour] - ranges_m) <= deepest_steps * step_m)
        reach[name] = np.where(linked[:, None], points_world[neighbour] - points_world, step / 2)
    corners = (("up", "left"), ("up", "right"), ("down", "right"), ("down", "left"))
    return np.stack([points_world + reach[tall] + reach[wide] for tall, wide in corners], axis=1)


def gap_patches(
    points_sensor: NDArray[np.floating],
    points_world: NDArray[np.float64],
    others_sensor: NDArray[np.floating],
    *,
    world_from_sensor: NDArray[np.float64],
    grid: Grid,
) -> NDArray[np.float64]:
    """Where beams went past an object: each that met something behind stands for the gap half-way to its neighbours.

    Args:
        points_sensor: (N, 3), m, the object's returns, sensor frame at each point's own time.
        points_world: (N, 3) float64, m, the same points at exposure.
        others_sensor: (M, 3), m, other returns of the sweep in the same directions, sensor frame.
        world_from_sensor: (3, 3) float64, from sensor axes to those of `points_world`.
        grid: neighbours of the object's returns.

    Returns:
        (K, 4, 3) float64, m, world frame, as far away as the object's nearest return; corners as of `surface_patches`.
    """
    both = np.concatenate([points_sensor, others_sensor]).astype(np.float64)
    azimuth, elevation = _directions(both, middle=points_sensor.mean(axis=0))
    directions = np.column_stack([azimuth * np.cos(elevation), elevation])
    own, other = directions[: len(points_sensor)], directions[len(points_sensor) :]
    reach_rad = BRIDGED_STEPS * max(grid.column_step_rad, float(grid.row_step_rad.max()))
    distance_rad, nearest = cKDTree(own, balanced_tree=False, compact_nodes=False).query(
        other, distance_upper_bound=reach_rad
    )
    found = np.isfinite(distance_rad)
    nearest, rays = np.asarray(nearest)[found], both[len(points_sensor) :][found]
    ranges_m = np.linalg.norm(both[nearest], axis=1)
    beyond_m = np.linalg.norm(rays, axis=1) - ranges_m
    behind = beyond_m > DEEPEST_STEPS * ranges_m * grid.column_step_rad
    nearest, ranges_m = nearest[behind], ranges_m[behind]
    middles = rays[behind] * (ranges_m / np.linalg.norm(rays[behind], axis=1))[:, None]
    flat_m = np.hypot(middles[:, 0], middles[:, 1])
    leftwards, upwards = _square_to_beam(middles, flat_m, ranges_m)
    aside = leftwards * (flat_m * grid.column_step_rad / 2)[:, None]
    upright = upwards * (ranges_m * grid.row_step_rad[nearest] / 2)[:, None]
    offsets = np.stack([middles - both[nearest] + up * upright + left * aside for up, left in CORNERS], axis=1)
    return np.asarray(points_world[nearest][:, None] + offsets @ world_from_sensor.T)


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


def patch_polygon(
    patches_px: NDArray[np.float64],
    *,
    width: int,
    height: int,
    solid: bool = False,
) -> Polygon | None:
    """The polygon of all pixels whose centre lies in a patch.

    Separate parts (the head over a parked car and the feet under it) are linked by a thin bridge.

    Args:
        patches_px: (N, 4, 2) float64, px, corners of each patch in order, finite.
        width: of the image, px.
        height: of the image, px.
        solid: close holes, for bodies that cannot be looked through, whose windows and dark paint send nothing back;
            else they stay open.

    Returns:
        The polygon, which may reach a few pixels beyond the image; None where no pixel is covered.
    """
    if not len(patches_px):
        return None
    return trace_polygon(*_closed_pixels(patches_px, width=width, height=height), solid=solid)


def patch_raster(patches_px: NDArray[np.float64], *, width: int, height: int) -> Raster:
    """The pixels of an image whose centre lies in a patch; arguments as of `patch_polygon`."""
    if not len(patches_px):
        return Raster((slice(0, 0), slice(0, 0)), np.zeros((0, 0), dtype=bool))
    covered, corner = _closed_pixels(patches_px, width=width, height=height)
    (u, v), size = corner.tolist(), np.array([width, height])
    left, top = np.clip(corner, 0, size).tolist()
    right, bottom = np.clip(corner + covered.shape[::-1], 0, size).tolist()
    return Raster((slice(top, bottom), slice(left, right)), covered[top - v : bottom - v, left - u : right - u])


def _closed_pixels(
    patches_px: NDArray[np.float64], *, width: int, height: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """As `patch_pixels`, slits closed."""
    covered, corner = patch_pixels(patches_px, width=width, height=height)
    return cv2.morphologyEx(np.pad(covered, 1).view(np.uint8), cv2.MORPH_CLOSE, SLIT) > 0, corner - 1


def patch_pixels(
    patches_px: NDArray[np.float64], *, width: int, height: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Pixels whose centre lies in any of many convex patches, in one pass over all edges.

    Every edge adds one to the pixels right of it where it runs down and subtracts one where it runs up; with all
    patches oriented the same way, what is not zero lies inside of one.

    Args:
        patches_px: (N, 4, 2) float64, px, N >= 1.
        width: of the image, px.
        height: of the image, px.

    Returns:
        covered: (rows, columns) bool, of a window.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    beyond = np.array([width, height]) + MARGIN_PX
    u, v = patches_px[:, :, 0], patches_px[:, :, 1]
    low = np.clip(np.floor([u.min(), v.min()]), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil([u.max(), v.max()]) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    start_u, start_v = (u - low[0]).ravel(), (v - low[1]).ravel()
    end_u, end_v = ((np.roll(side, -1, axis=1) - first).ravel() for side, first in ((u, low[0]), (v, low[1])))
    orientation = np.sign((u[:, 2] - u[:, 0]) * (v[:, 3] - v[:, 1]) - (v[:, 2] - v[:, 0]) * (u[:, 3] - u[:, 1]))
    first = np.clip(np.ceil(np.minimum(start_v, end_v)), 0, rows).astype(np.int64)
    count = np.clip(np.ceil(np.maximum(start_v, end_v)), 0, rows).astype(np.int64) - first
    edge = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    share = (row - start_v[edge]) / (end_v[edge] - start_v[edge])
    crossing_u = start_u[edge] + share * (end_u[edge] - start_u[edge])
    column = np.clip(np.ceil(crossing_u), 0, columns).astype(np.int64)
    sign = np.where(end_v > start_v, 1.0, -1.0) * np.repeat(orientation, 4)
    changes = np.bincount(row * (columns + 1) + column, weights=sign[edge], minlength=rows * (columns + 1))
    depth = np.cumsum(changes.reshape(rows, columns + 1), axis=1)[:, :columns]
    return np.abs(depth) > 0.5, low

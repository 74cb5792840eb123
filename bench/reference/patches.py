"""The piece of surface that each lidar return stands for, and the pixels of their union.

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

QUERIES = 64  # returns of a cluster, evenly chosen, that tell the step between columns
NEIGHBOURS = 8  # enough to meet the next column even where rows lie four times closer than columns
BRIDGED_STEPS = 2.5  # one missing return between two is a dropout, two are a gap in the object
ADJACENT_STEPS = 1.5  # between these two no return is missing
SAME_ROW = 0.35  # of the step between columns: returns closer in elevation lie in one row
LOCAL = 100  # returns that tell the usual angle between rows at their elevation
DEEPEST_STEPS = BRIDGED_STEPS * np.tan(np.radians(80))  # as on a surface this oblique; further behind is another one
SLIT = np.ones((3, 3), dtype=np.uint8)  # closes what is a pixel wide: finer than a beam
MARGIN_PX = 4  # beyond the image, so that its border does not cut the outline
ROW_KEY = 8.0  # larger than any difference of elevations, which makes (column, elevation) one sortable number
CERTAIN_STEPS = (BRIDGED_STEPS**2 - 1) ** 0.5  # a link as long as that over a missing return
LEFT, RIGHT, UP, DOWN = range(4)
CORNERS = ((UP, LEFT), (UP, RIGHT), (DOWN, RIGHT), (DOWN, LEFT))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Neighbours of each return, and how far apart the lidar's samples are.

    Attributes:
        neighbours: (4, N) intp, row of the neighbour to the left, to the right, above and below; -1 where there is none
            within 2.5 steps.
        steps: (4, N) float64, how many steps away it is.
        column_step_rad: between columns, one for the cluster.
        row_step_rad: (N,) float64, between rows at each return; the cluster's median where it has no neighbour.
    """

    neighbours: NDArray[np.intp]
    steps: NDArray[np.float64]
    column_step_rad: float
    row_step_rad: NDArray[np.float64]

    def step_m(self, points_sensor: NDArray[np.floating]) -> NDArray[np.float64]:
        """How far the next column and the next row are away at each return, (2, N) float64, m, square to the beam."""
        x, y, z = points_sensor.astype(np.float64).T
        flat_m = np.hypot(x, y)
        return np.array([flat_m * self.column_step_rad, np.hypot(flat_m, z) * self.row_step_rad])


def find_grid(points_sensor: NDArray[np.floating]) -> Grid | None:
    """Find the neighbours of each return.

    Args:
        points_sensor: (N, 3), m, sensor frame at each point's own time.

    Returns:
        The grid; None where no two returns lie beside each other in a row, so that the step between columns is unknown.
    """
    if len(points_sensor) < 2:
        return None
    azimuth, elevation = _directions(points_sensor)
    column_step = _column_step(azimuth, elevation)
    if column_step <= 0:
        return None
    above_below, lifts, usual = _above_and_below(azimuth, elevation, column_step)
    beside, turns = _beside(azimuth, elevation, column_step, usual / 2)
    nearest = np.where(above_below >= 0, lifts, np.inf).min(axis=0)
    row_step = np.where(np.isfinite(nearest), np.minimum(nearest, 1.5 * usual), usual)
    return Grid(
        neighbours=np.concatenate([beside, above_below]),
        steps=np.concatenate([turns / column_step, lifts / usual]),
        column_step_rad=column_step,
        row_step_rad=row_step,
    )


def _directions(points_sensor: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Azimuth about the middle direction, so that no cluster is cut in two behind the sensor, and elevation; rad."""
    x, y, z = points_sensor.astype(np.float64).T
    middle = np.arctan2(y.mean(), x.mean())
    cosine, sine = np.cos(middle), np.sin(middle)
    return np.arctan2(y * cosine - x * sine, x * cosine + y * sine), np.arctan2(z, np.hypot(x, y))


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
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Neighbours in the same column, (2, N), the angles to them, and the usual angle between rows at each return."""
    column = np.floor(azimuth / (1.5 * column_step)) * ROW_KEY  # wide enough to hold a return of every row
    keys = column + elevation
    order = np.argsort(keys, kind="stable")
    keys, column, elevation = keys[order], column[order], elevation[order]
    least = SAME_ROW * column_step
    places = np.array([np.searchsorted(keys, keys + least), np.searchsorted(keys, keys - least) - 1])
    others = np.clip(places, 0, len(order) - 1)
    lifts = np.abs(elevation[others] - elevation)
    lifts[(column[others] != column) | (lifts < least)] = np.inf
    usual = _usual_by_elevation(elevation, lifts.min(axis=0), otherwise=column_step)
    others = np.where(lifts <= BRIDGED_STEPS * usual, order[others], -1)
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    return others[:, back], lifts[:, back], usual[back]


def _usual_by_elevation(
    elevation: NDArray[np.float64], lifts: NDArray[np.float64], *, otherwise: float
) -> NDArray[np.float64]:
    """Median angle between rows around each return's elevation: lidars have rows close together near the horizon and
    several times further apart below. Infinite `lifts` are unknown."""
    order = np.argsort(elevation, kind="stable")
    parts = -(-len(order) // LOCAL)
    of_part = np.full(parts * LOCAL, np.inf)
    of_part[: len(order)] = lifts[order]
    of_part = np.sort(of_part.reshape(parts, LOCAL), axis=1)
    known = np.isfinite(of_part).sum(axis=1)
    medians = of_part[np.arange(parts), np.maximum(known - 1, 0) // 2]
    if not known.all():
        whole = lifts[np.isfinite(lifts)]
        medians[known == 0] = np.median(whole) if whole.size else otherwise
    usual = np.empty(len(order))
    usual[order] = np.repeat(medians, LOCAL)[: len(order)]
    return usual


def _beside(
    azimuth: NDArray[np.float64],
    elevation: NDArray[np.float64],
    column_step: float,
    most_lift: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """To the left and to the right, (2, N), the return of nearest elevation in the next column, else in the one after
    it, and the angles to them."""
    keys = np.floor(azimuth / column_step) * ROW_KEY + elevation
    order = np.argsort(keys, kind="stable")
    keys, azimuth, elevation, most_lift = keys[order], azimuth[order], elevation[order], most_lift[order]
    found, turns = np.full((2, len(order)), -1, dtype=np.intp), np.full((2, len(order)), np.inf)
    back = np.empty_like(order)
    back[order] = np.arange(len(order))
    for number, side in enumerate((1, -1)):
        asked = np.arange(len(order))
        for columns in (1, 2):
            here_u, here_v, least = azimuth[asked], elevation[asked], most_lift[asked]
            position = np.searchsorted(keys, keys[asked] + side * columns * ROW_KEY)
            for other in (np.maximum(position - 1, 0), np.minimum(position, len(order) - 1)):
                turn, lift = (azimuth[other] - here_u) * side, np.abs(elevation[other] - here_v)
                better = (turn > column_step / 4) & (turn <= BRIDGED_STEPS * column_step) & (lift < least)
                nearer = asked[better]
                found[number, nearer], turns[number, nearer] = order[other[better]], turn[better]
                least = np.where(better, lift, least)
            asked = np.flatnonzero(found[number] < 0)
    return found[:, back], turns[:, back]


def surface_patches(
    points_sensor: NDArray[np.floating],
    points_world: NDArray[np.float64],
    *,
    world_from_sensor: NDArray[np.float64],
    grid: Grid,
    ends: NDArray[np.float64] | float = 0.5,
    certain: bool = False,
) -> NDArray[np.float64]:
    """Corners of the patch of each return.

    Towards a neighbour the patch reaches along the surface to the neighbour itself, so that patches overlap and leave
    no slits when seen from the camera. Where there is none it ends on the way to where the next beam would be.

    Args:
        points_sensor: (N, 3), m, sensor frame at each point's own time.
        points_world: (N, 3) float64, m, the same points at exposure.
        world_from_sensor: (3, 3) float64, from sensor axes to those of `points_world`.
        grid: neighbours of the same points.
        ends: how far that is, in steps between columns and between rows, (2, N) or one number; half-way is most likely.
        certain: only between neighbours of which no return is missing and which are as near as over one missing return,
            else they may be two surfaces; and not beyond a return without such a neighbour on its other side, since of
            a thing as thin as a beam nobody knows how thin it is.

    Returns:
        (4, N, 3) float64, m, world frame: left above, right above, right below, left below.
    """
    x, y, z = points_sensor.astype(np.float64).T
    flat_m = np.hypot(x, y)
    ranges_m = np.hypot(flat_m, z)
    most_steps, deepest = (ADJACENT_STEPS, CERTAIN_STEPS) if certain else (BRIDGED_STEPS, DEEPEST_STEPS)
    linked = (grid.neighbours >= 0) & (grid.steps <= most_steps)
    linked &= np.abs(ranges_m[grid.neighbours] - ranges_m) <= deepest * grid.step_m(points_sensor).repeat(2, axis=0)
    world = np.ascontiguousarray(points_world.T)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN on the lidar's axis
        slope = z / flat_m
    # Square to the beam.
    across, up = np.broadcast_to(ends, (2, len(x)))
    aside = world_from_sensor @ np.array([-y, x, np.zeros_like(x)]) * (grid.column_step_rad * across)
    upright = world_from_sensor @ np.array([-x * slope, -y * slope, flat_m]) * (grid.row_step_rad * up)
    reach = np.stack([aside, -aside, upright, -upright], axis=1)
    if certain:
        reach *= linked[[RIGHT, LEFT, DOWN, UP]]
    np.copyto(reach, world[:, grid.neighbours] - world[:, None], where=linked)
    corners = np.stack([reach[:, tall] + reach[:, wide] for tall, wide in CORNERS], axis=1)
    corners += world[:, None]
    return np.moveaxis(corners, 0, -1)


def certain_and_possible_ends(
    step_m: NDArray[np.float64], error_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a patch without a neighbour ends at least and at most, by one standard deviation.

    The outline lies anywhere between the outermost return and the next beam, which missed: uniform over a step, half a
    step on average, with a standard deviation of step / sqrt(12). Together with an error that has other causes it is
    sqrt(error^2 + step^2 / 12); what of this exceeds the error moves the end, along the beams' own rows and columns.

    Args:
        step_m: (2, N) float64, m, to the next column and row.
        error_m: (N,) float64, m, standard deviation of the outline for all other causes, in every direction.

    Returns:
        (2, N) float64 each, in steps, for `surface_patches`: within 0.5 - 0.29 and 0.5 + 0.29.
    """
    spread = (np.sqrt(error_m**2 + step_m**2 / 12) - error_m) / step_m
    return 0.5 - spread, 0.5 + spread


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
        patches_world: (4, N, 3) float64, m, as from `surface_patches`.
        at_lowest_beam: (N,) bool, returns of the lowest beam.
        at_highest_beam: (N,) bool, returns of the highest beam.
        bottom_m: height of the annotated shape's lowest point, world frame.
        top_m: of its highest.
        clearance_m: returns lower than this above the bottom were taken for the ground's.

    Returns:
        (4, N, 3) float64, m.
    """
    reached = patches_world.copy(order="K")
    upper, lower = reached[:2, :, 2], reached[2:, :, 2]
    grounded = at_lowest_beam | (lower < bottom_m + clearance_m)
    np.minimum(lower, bottom_m, out=lower, where=grounded)
    np.maximum(upper, top_m, out=upper, where=np.broadcast_to(at_highest_beam, upper.shape))
    return reached


def patch_pixels(
    patches_px: NDArray[np.float64], *, width: int, height: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Pixels whose centre lies in any of many convex patches, in one pass over all edges.

    Every edge adds one to the pixels right of it where it runs down and subtracts one where it runs up; with all
    patches oriented the same way, what is not zero lies inside of one.

    Args:
        patches_px: (4, N, 2) float64, px, corners in order, finite.
        width: of the image, px.
        height: of the image, px.

    Returns:
        covered: (rows, columns) bool, of a window that may reach a few pixels beyond the image.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    if not patches_px.shape[1]:
        return np.zeros((0, 0), dtype=bool), np.zeros(2, dtype=np.int64)
    beyond = np.array([width, height]) + MARGIN_PX
    u, v = patches_px[..., 0], patches_px[..., 1]
    low = np.clip(np.floor([u.min(), v.min()]), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil([u.max(), v.max()]) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    orientation = np.sign((u[2] - u[0]) * (v[3] - v[1]) - (v[2] - v[0]) * (u[3] - u[1]))
    start_u, start_v = u - low[0], v - low[1]
    end_u, end_v = start_u[[1, 2, 3, 0]], start_v[[1, 2, 3, 0]]
    signs = (np.where(end_v > start_v, orientation, -orientation)).ravel()
    start_u, start_v, end_u, end_v = (side.ravel() for side in (start_u, start_v, end_u, end_v))
    first = np.clip(np.ceil(np.minimum(start_v, end_v)), 0, rows).astype(np.int64)
    count = np.clip(np.ceil(np.maximum(start_v, end_v)), 0, rows).astype(np.int64) - first
    edge = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    fall = end_v - start_v
    slope = np.divide(end_u - start_u, fall, out=np.zeros_like(fall), where=fall != 0)  # a level edge meets no row
    crossing_u = (start_u - start_v * slope)[edge] + row * slope[edge]
    column = np.clip(np.ceil(crossing_u), 0, columns).astype(np.int64)
    changes = np.bincount(row * (columns + 1) + column, weights=signs[edge], minlength=rows * (columns + 1))
    depth = np.cumsum(changes.reshape(rows, columns + 1), axis=1)[:, :columns]
    return np.abs(depth) > 0.5, low


def surface_pixels(
    patches_px: NDArray[np.float64], *, width: int, height: int, solid: bool = False, certain: bool = False
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """As `patch_pixels`, slits closed.

    Args:
        patches_px: (4, N, 2) float64, px, corners in order, finite.
        width: of the image, px.
        height: of the image, px.
        solid: close holes, for bodies that cannot be looked through, whose windows and dark paint send nothing back;
            else they stay open.
        certain: leave slits open as well.
    """
    covered, corner = patch_pixels(patches_px, width=width, height=height)
    if certain:
        return covered, corner
    closed = cv2.morphologyEx(np.pad(covered, 1).view(np.uint8), cv2.MORPH_CLOSE, SLIT)
    if solid:
        outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(closed, outlines, -1, 1, cv2.FILLED)
    return closed > 0, corner - 1

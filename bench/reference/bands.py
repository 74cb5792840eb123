"""The unknown band around a region: what is an object's for certain, and what may be.

The root of the squares of all causes is u, the standard deviation of the outline near each return; see `scanned`. The
**core** is the region less u, the **band** what lies within u of the outline on either side. What else is not certain
belongs to the band:

- where returns are missing between two, or so far apart in range that they may be two surfaces (a leg and a wheel), and
  beside what is as thin as a beam (spokes): air may lie there. Vehicles are solid and have none of these.
- what of the annotated shape lies below the lowest beam or above the highest: a lidar on the roof looks over what is
  beside the vehicle.
- what of the annotated shape lies behind its own returns: the lidar sees the back of who passes, the camera the front.
- what of a vehicle's shape lies in directions that returned nothing: black paint, glass, wet or tilted metal. Such a
  direction tells nothing: neither that the body is there nor that the beam went past it, which only a return from
  behind the body tells.

In the band a detection is neither right nor wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, ray_grid
from bench.geometry import Floats, cross, dot, normalise
from bench.reference.grid import BRIDGED_STEPS, FARTHEST_M, Beam, Grid
from bench.reference.patches import draw_closed
from bench.reference.raster import Raster
from bench.reference.regions import Region
from bench.reference.scanned import ScannedObject, Surface
from bench.reference.silhouette import Prism, silhouette
from bench.reference.sweeps import turned

OUTLINE_STEP_M = 0.25  # the height of a cone that falls by 24 degrees, 1.5 m from its axis, is right to 3 mm
MOST_CELLS = 2000  # to a side: returns twice in nearly one direction would make steps of nothing
REACH_STEPS = BRIDGED_STEPS / 2  # of a return to each side: one missing between two leaves no gap
SIDES = np.array([[-0.5, -0.5, 0.5, 0.5], [-0.5, 0.5, -0.5, 0.5]])  # of a cell, in steps
# Of the part of a cell's cone between two distances: rows are its corners, the four of the nearer end first.
FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]


def with_band(region: Region, scanned: ScannedObject) -> Region:
    """The region of a scanned object, divided into what is certain and what is possible."""
    inside, points_camera = scanned.inside, scanned.points_camera[scanned.inside]
    returns_px = np.rint(scanned.pixels[inside]).astype(np.intp)
    px_per_radian = pixels_per_radian(scanned.exposure.camera.model)[returns_px[:, 1], returns_px[:, 0]]
    half_width_px = scanned.error_m[inside] * (px_per_radian / np.sqrt(dot(points_camera, points_camera)))
    if scanned.grid is None:
        spacing2_px = region.polygon_px / max(len(returns_px), 1)
        half_width_px = np.sqrt(half_width_px**2 + spacing2_px / 12)
    unseen, hidden = beyond_all_beams(scanned), (behind_its_returns(scanned), silent(scanned))
    return uncertain_region(
        region, scanned.exposure.valid, scanned.surface, (returns_px, half_width_px), unseen=unseen, hidden=hidden
    )


def uncertain_region(
    region: Region,
    valid: NDArray[np.bool_],
    surface: Surface,
    widths: tuple[NDArray[np.intp], Floats],
    *,
    unseen: Raster | None = None,
    hidden: Sequence[Raster | None] = (),
) -> Region:
    """The core of a region, and what may be the object's beside it.

    Args:
        region: without a band.
        valid: (H, W) bool, the region V. Its border is no outline: the object goes on behind it.
        surface: what its patches are at least, at most and for certain; None in it stands for the whole region.
        widths: pixels of the object's returns, (N, 2) intp, (u, v), and what else is uncertain at each of them, (N,)
            float64, px; the nearest tells by how much the least shrinks and the most grows.
        unseen: what of the annotated shape no beam reaches: possible, not certain; None for nothing.
        hidden: what of it the object's own surface hides from the lidar, and where nothing came back: possible.

    Returns:
        The core is the whole region where nothing of it is certain.
    """
    whole, (returns_px, half_width_px) = Raster(region.window, region.core), widths
    least, most = surface.least or whole, surface.most or whole
    rasters = [raster for raster in (whole, least, most, surface.certain, unseen, *hidden) if raster is not None]
    margin, shape = int(half_width_px.max(initial=0.0)) + 2, np.array(valid.shape)
    first = np.min([[axis.start for axis in raster.window] for raster in rasters], axis=0) - margin
    last = np.max([[axis.stop for axis in raster.window] for raster in rasters], axis=0) + margin
    (top, left), (bottom, right) = np.clip(first, 0, shape).tolist(), np.clip(last, 0, shape).tolist()
    window = slice(top, bottom), slice(left, right)

    def in_window(raster: Raster) -> NDArray[np.bool_]:
        image = np.zeros(valid.shape, dtype=bool)
        image[raster.window] = raster.covered
        return image[window]

    covered, inside, drawn_in = in_window(whole), valid[window], in_window(least)
    width_px = _of_the_nearest(half_width_px, returns_px - (left, top), covered.shape)
    core = drawn_in & (_distance_px(drawn_in | ~inside) - 0.5 > width_px)  # the outline runs between two pixels
    possible = inside & (_distance_px(~(in_window(most) | covered)) - 0.5 <= width_px)
    if surface.certain is not None:
        core &= in_window(surface.certain)
    if unseen is not None:
        core &= ~in_window(unseen)
    for raster in (unseen, *hidden):
        if raster is not None:
            possible |= inside & in_window(raster)
    return replace(region, window=window, core=core if core.any() else covered, possible=possible)


def _of_the_nearest(values: Floats, pixels: NDArray[np.intp], shape: tuple[int, ...]) -> Floats:
    """(rows, columns), root mean square of the values at the nearest pixel that has any; 0 where none has."""
    within = ((pixels >= 0) & (pixels < shape[::-1])).all(axis=1)
    if not within.any():
        return np.zeros(shape)
    u, v = pixels[within].T
    empty = np.ones(shape, dtype=np.uint8)
    empty[v, u] = 0
    _, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    which = nearest[v, u]
    mean = np.bincount(which, weights=values[within] ** 2) / np.maximum(np.bincount(which), 1)
    return np.asarray(np.sqrt(mean)[nearest])


def _distance_px(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Distance of each pixel of a mask to the nearest pixel outside of it; 0 outside."""
    return np.asarray(cv2.distanceTransform(mask.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


@lru_cache(maxsize=16)
def pixels_per_radian(camera: CameraModel) -> Floats:
    """Return how large a radian appears at each pixel, (H, W) float64, px/rad, mean of all directions.

    At the border of the lens and beyond, where neighbours are missing, the median of all others.
    """
    rays = ray_grid(camera).rays_camera
    right, down = (np.asarray(np.gradient(rays, axis=axis)) for axis in (1, 0))
    areas = cross(right, down)  # length: the solid angle of a pixel
    scale = dot(areas, areas) ** -0.25
    return np.asarray(np.where(np.isfinite(scale), scale, np.nanmedian(scale)))


def beyond_all_beams(scanned: ScannedObject) -> Raster | None:
    """Part of the annotated shape below the lowest beam or above the highest; None where there is none."""
    camera_from_sensor = scanned.exposure.camera_from_world @ scanned.world_from_sensor
    bodies = [
        scanned.exposure.seen(camera_from_sensor.apply(body))
        for corners in scanned.world_from_sensor.inverse().apply(scanned.parts_world)
        for beam, end_m in zip(scanned.sweep.envelope, (corners[:, 2].min(), corners[:, 2].max()), strict=True)
        if len(body := beyond_beam(corners, beam, end_m=end_m))
    ]
    return silhouette(bodies, scanned.exposure.camera.model) if bodies else None


def beyond_beam(corners: Floats, beam: Beam, *, end_m: float) -> Floats:
    """Part of an upright convex body between a beam's cone and the body's bottom or top.

    The cone is curved: along a side it is followed in steps of at most `OUTLINE_STEP_M`.

    Args:
        corners: (K, 3) float64, m, of the body, sensor frame.
        beam: the lowest or the highest.
        end_m: m, height of the body's bottom for the lowest beam, of its top for the highest.

    Returns:
        (J, 3) float64, m, points whose convex hull is the part; none where the beam reaches the end everywhere.
    """
    ground = shapely.convex_hull(shapely.multipoints(corners[:, :2]))
    outline_m = shapely.get_coordinates(shapely.segmentize(ground, OUTLINE_STEP_M))
    heights_m = beam.heights_m(np.hypot(*outline_m.T)).clip(corners[:, 2].min(), corners[:, 2].max())
    missed = heights_m != end_m
    end = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(outline_m[missed])))
    cut = np.column_stack([outline_m[missed], heights_m[missed]])
    return np.concatenate([cut, np.column_stack([end, np.full(len(end), end_m)])])


def behind_its_returns(scanned: ScannedObject) -> Raster | None:
    """Part of the annotated shape that lies behind its own returns: there the lidar sees nothing, and a camera may.

    Its pixels are those that the middle lines of patches with a free side, across and upright, sweep on their way
    along the beam to the end of the shape: behind the outline, and behind an edge beside a farther surface, as that of
    a lorry's floor, whose underside a low camera sees. None where no such patch or no shape is known.
    """
    shape = Prism.around(scanned.parts_world)
    if scanned.grid is None or shape is None:
        return None
    outermost = ~scanned.grid.linked.all(axis=0)
    beams = normalise(scanned.world_from_sensor.rotate(scanned.points_from_beams[outermost]))
    _, leave_m = shape.ways_m(scanned.cluster.points_world[outermost], beams)
    ways = beams * leave_m.clip(0.0)[:, None]
    corners = scanned.patches.corners.compress(outermost, axis=2)
    if not corners.size:
        return None
    following = np.roll(corners, -1, axis=1)  # above, right, below, left: from corner to corner
    above, right, below, left = np.moveaxis((corners + following) / 2, 1, 0)
    lines = np.concatenate([np.stack([left, right], axis=1), np.stack([above, below], axis=1)], axis=2)
    swept = np.concatenate([lines, lines[:, ::-1] + np.tile(ways.T, 2)[:, None]], axis=1)
    return draw_closed(swept, scanned.exposure)


def silent(scanned: ScannedObject) -> Raster | None:
    """Part of the annotated shape in directions without a return from it or from behind it.

    The shape is looked at in cells of one step between columns and rows, from the lowest beam to the highest. A return
    answers for the cells whose middle lies within 1.25 steps, unless it is another's in front of the shape. What of the
    shape lies in the cone of a cell that nothing answers is silent.

    Returns:
        None for what is not solid, has no shape, or whose returns form no rows.
    """
    grid = scanned.grid
    if not scanned.solid or grid is None:
        return None
    shape = Prism.around(scanned.parts_world, clearance_m=scanned.settings.ground_clearance_m)
    if shape is None:
        return None
    beams = _Beams(scanned)
    step = np.array([[grid.column_step_rad], [float(np.median(grid.row_step_rad))]])
    first, last = beams.extent(scanned.parts_world.reshape(-1, 3))
    step = np.maximum(step, (last - first) / MOST_CELLS)
    cells = first + (np.argwhere(~_answered(beams, shape, grid, first, last, step)).T + 0.5) * step
    enter_m, leave_m = shape.ways_m(*beams.starts_and_rays(cells))
    met = (enter_m < leave_m) & (leave_m > 0.0)
    if not met.any():
        return None
    corners = cells[:, met, None] + SIDES[:, None] * step[:, :, None]
    starts, rays = (vectors.reshape(-1, 4, 3) for vectors in beams.starts_and_rays(corners.reshape(2, -1)))
    ends = [starts + rays * way_m[met, None, None] for way_m in (enter_m.clip(0.0), leave_m)]
    faces = np.concatenate(ends, axis=1)[:, FACES].reshape(-1, 4, 3).T
    return draw_closed(np.ascontiguousarray(faces), scanned.exposure)


class _Beams:
    """Beams of a sweep, as moved with an object until the exposure; directions are azimuth, to the left of the middle
    of the object's returns, and elevation, (2, K) float64, rad, from where a beam starts."""

    def __init__(self, scanned: ScannedObject) -> None:
        self.sweep, self._rows = scanned.sweep, scanned.cluster.rows
        self._world_from_sensor = scanned.world_from_sensor
        points_sensor = self.sweep.points_sensor(self._rows)
        x, y, _ = points_sensor.mean(axis=0).tolist()
        self._middle_rad = float(np.arctan2(y, x))
        azimuths, self.elevations = self._directions(scanned.points_from_beams)
        order = np.argsort(azimuths, kind="stable")
        self._azimuths = azimuths[order]
        self._moved = (scanned.cluster.points_world - self._world_from_sensor.apply(points_sensor))[order]

    def _directions(self, points_from_beams: Floats) -> Floats:
        x, y, z = points_from_beams.T
        return np.stack([turned(np.arctan2(y, x), self._middle_rad), np.arctan2(z, np.hypot(x, y))])

    def starts_and_rays(self, directions: Floats) -> tuple[Floats, Floats]:
        """Starts, (K, 3) float64, m, and unit rays, world frame at exposure: as the object's return of the nearest
        azimuth."""
        azimuths, elevations = directions[0] + self._middle_rad, directions[1]
        flat = np.cos(elevations)
        rays = np.column_stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)])
        starts = np.zeros_like(rays)
        starts[:, 2] = self.sweep.envelope.starts_m(rays * FARTHEST_M)
        between = (self._azimuths[1:] + self._azimuths[:-1]) / 2
        moved = self._moved[np.searchsorted(between, directions[0])]
        return self._world_from_sensor.apply(starts) + moved, self._world_from_sensor.rotate(rays)

    def extent(self, corners_world: Floats) -> tuple[Floats, Floats]:
        """Least and largest direction, (2, 1), of corners of a shape at exposure that a beam may have."""
        lowest, highest = self.sweep.envelope
        corners = self._world_from_sensor.inverse().apply(corners_world - self._moved.mean(axis=0))
        directions = self._directions(corners - [0.0, 0.0, (lowest.offset_m + highest.offset_m) / 2])
        least, most = [[-np.pi], [np.arctan(lowest.slope)]], [[np.pi], [np.arctan(highest.slope)]]
        first, last = directions.min(axis=1, keepdims=True), directions.max(axis=1, keepdims=True)
        return np.maximum(first, least), np.minimum(last, most)

    def returns(self, first: Floats, last: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """All returns of the sweep between two directions, (2, 1): their directions, distances, (K,) float64, m, and
        whether they are the object's, (K,) bool."""
        rows = self.sweep.rows_in_sector(self._middle_rad, first[0, 0], last[0, 0])
        points, own = self.sweep.points_from_beams(rows), np.isin(rows, self._rows)
        directions = self._directions(points)
        between = (directions[1] >= first[1]) & (directions[1] <= last[1])
        ranges_m = np.sqrt((points[between] ** 2).sum(axis=1))
        return directions[:, between], ranges_m, own[between]


def _answered(beams: _Beams, shape: Prism, grid: Grid, first: Floats, last: Floats, step: Floats) -> NDArray[np.bool_]:
    """(columns, rows) bool, the cells between two directions, (2, 1) each, that a return answers."""
    shape_of_cells = np.ceil((last - first) / step).astype(np.intp).clip(0).ravel()
    beyond = np.array([[step[0, 0]], [grid.row_step_rad.max()]]) * REACH_STEPS
    returns, ranges_m, answers = beams.returns(first - beyond, last + beyond)
    others = np.flatnonzero(~answers)
    enter_m, leave_m = shape.ways_m(*beams.starts_and_rays(returns[:, others]))
    answers[others] = (enter_m >= leave_m) | (ranges_m[others] >= enter_m)
    returns, apart_rad = returns[:, answers], beams.sweep.envelope.starts_apart_m / ranges_m[answers]
    by_elevation = np.argsort(beams.elevations, kind="stable")
    row_steps = np.interp(returns[1], beams.elevations[by_elevation], grid.row_step_rad[by_elevation])
    reach = REACH_STEPS * np.stack([np.full(len(row_steps), step[0, 0]), row_steps])
    reach[1] += apart_rad / 2
    low, high = (
        np.ceil((returns + sign * reach - first) / step - 0.5).astype(np.intp).clip(0, shape_of_cells[:, None])
        for sign in (-1, 1)
    )
    changes = np.zeros(shape_of_cells + 1, dtype=np.int32)
    for (column, row), sign in (((low[0], low[1]), 1), ((high[0], low[1]), -1), ((low[0], high[1]), -1), (high, 1)):
        np.add.at(changes, (column, row), sign)
    return np.asarray(changes.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0)

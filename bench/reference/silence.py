"""Directions in which a lidar looked into a solid body's shape and nothing came back.

Black paint, glass, wet or tilted metal send nothing back. Such a direction tells nothing: neither that the body is
there nor that the beam went past it, which only a return from behind the body tells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.geometry.raster import Raster
from bench.reference.envelope import FARTHEST_M
from bench.reference.grid import BRIDGED_STEPS, Grid
from bench.reference.patches import draw, union, without_slits
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import Prism
from bench.reference.sweeps import PosedSweep

MOST_CELLS = 2000  # to a side: returns twice in nearly one direction would make steps of nothing
REACH_STEPS = BRIDGED_STEPS / 2  # of a return to each side: one missing between two leaves no gap
SIDES = np.array([[-0.5, -0.5, 0.5, 0.5], [-0.5, 0.5, -0.5, 0.5]])  # of a cell, in steps
# Of the part of a cell's cone between two distances: rows are its corners, the four of the nearer end first.
FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]


def silent(scanned: ScannedObject) -> Raster | None:
    """Part of the annotated shape in directions without a return from it or from behind it.

    The shape is looked at in cells of one step between columns and rows, from the lowest beam to the highest. A return
    answers for the cells whose middle lies within 1.25 steps, unless it is another's in front of the shape. What of the
    shape lies in the cone of a cell that nothing answers is silent.

    Returns:
        None for what is not solid, has no shape, or whose returns form no rows.
    """
    grid, placed = scanned.grid, scanned.placed
    if not scanned.solid or grid is None or placed is None:
        return None
    shape = Prism.around(scanned.parts_world, clearance_m=scanned.settings.ground_clearance_m)
    if shape is None:
        return None
    beams = _Beams(placed, scanned)
    step = np.array([[grid.column_step_rad], [float(np.median(grid.row_step_rad))]])
    first, last = beams.extent(scanned.parts_world.reshape(-1, 3))
    step = np.maximum(step, (last - first) / MOST_CELLS)
    answered = _answered(beams, shape, grid, first=first, last=last, step=step)
    cells = first + (np.argwhere(~answered).T + 0.5) * step
    enter_m, leave_m = shape.ways_m(*beams.starts_and_rays(cells))
    met = (enter_m < leave_m) & (leave_m > 0.0)
    if not met.any():
        return None
    corners = cells[:, met, None] + SIDES[:, None] * step[:, :, None]
    starts, rays = (vectors.reshape(-1, 4, 3) for vectors in beams.starts_and_rays(corners.reshape(2, -1)))
    ends = [starts + rays * way_m[met, None, None] for way_m in (enter_m.clip(0.0), leave_m)]
    faces = np.concatenate(ends, axis=1)[:, FACES].reshape(-1, 4, 3).T
    counts, corner = draw(np.ascontiguousarray(faces), scanned.exposure)
    return scanned.exposure.crop(without_slits(union(counts)), corner - 1)


class _Beams:
    """Beams of a sweep, as moved with an object until the exposure; directions are azimuth, to the left of the middle
    of the object's returns, and elevation, (2, K) float64, rad, from where a beam starts.

    Args:
        placed: the sweep.
        scanned: the object that it met.
    """

    def __init__(self, placed: PosedSweep, scanned: ScannedObject) -> None:
        rows, world_from_sensor = scanned.cluster.rows, scanned.world_from_sensor
        points_sensor = placed.points_sensor(rows)
        x, y, _ = points_sensor.mean(axis=0).tolist()
        self._middle_rad = float(np.arctan2(y, x))
        self._placed, self._rows, self._world_from_sensor = placed, rows, world_from_sensor
        self.starts_apart_m = placed.envelope.starts_apart_m
        moved, (azimuths, self.elevations) = (
            scanned.cluster.points_world - world_from_sensor.apply(points_sensor),
            self._directions(placed.points_from_beams(rows)),
        )
        order = np.argsort(azimuths, kind="stable")
        self._azimuths, self._moved = azimuths[order], moved[order]

    def _directions(self, points_from_beams: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points_from_beams.T
        azimuths = (np.arctan2(y, x) - self._middle_rad + np.pi) % (2 * np.pi) - np.pi
        return np.stack([azimuths, np.arctan2(z, np.hypot(x, y))])

    def starts_and_rays(self, directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Starts, (K, 3) float64, m, and unit rays, world frame at exposure: as the object's return of the nearest
        azimuth."""
        azimuths, elevations = directions[0] + self._middle_rad, directions[1]
        flat = np.cos(elevations)
        rays = np.column_stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)])
        starts = np.zeros_like(rays)
        starts[:, 2] = self._placed.envelope.starts_m(rays * FARTHEST_M)
        between = (self._azimuths[1:] + self._azimuths[:-1]) / 2
        moved = self._moved[np.searchsorted(between, directions[0])]
        return self._world_from_sensor.apply(starts) + moved, self._world_from_sensor.rotate(rays)

    def extent(self, corners_world: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and largest direction, (2, 1), of corners of a shape at exposure that a beam may have."""
        lowest, highest = self._placed.envelope
        corners = self._world_from_sensor.inverse().apply(corners_world - self._moved.mean(axis=0))
        directions = self._directions(corners - [0.0, 0.0, (lowest.offset_m + highest.offset_m) / 2])
        limits = np.array([[-np.pi, np.pi], np.arctan([lowest.slope, highest.slope])])
        return (
            np.maximum(directions.min(axis=1), limits[:, 0])[:, None],
            np.minimum(directions.max(axis=1), limits[:, 1])[:, None],
        )

    def returns(
        self, first: NDArray[np.float64], last: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """All returns of the sweep between two directions, (2, 1): their directions, distances, (K,) float64, m, and
        whether they are the object's, (K,) bool."""
        away = (self._placed.azimuths_rad - self._middle_rad + np.pi) % (2 * np.pi) - np.pi
        rows = np.flatnonzero((away >= first[0, 0]) & (away <= last[0, 0]))
        points, own = self._placed.points_from_beams(rows), np.isin(rows, self._rows)
        directions = self._directions(points)
        between = (directions[1] >= first[1]) & (directions[1] <= last[1])
        ranges_m = np.sqrt((points[between] ** 2).sum(axis=1))
        return directions[:, between], ranges_m, own[between]


def _answered(
    beams: _Beams,
    shape: Prism,
    grid: Grid,
    *,
    first: NDArray[np.float64],
    last: NDArray[np.float64],
    step: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """(columns, rows) bool, the cells between two directions that a return answers."""
    shape_of_cells = np.ceil((last - first) / step).astype(np.intp).clip(0).ravel()
    beyond = np.array([[step[0, 0]], [grid.row_step_rad.max()]]) * REACH_STEPS
    returns, ranges_m, answers = beams.returns(first - beyond, last + beyond)
    others = np.flatnonzero(~answers)
    enter_m, leave_m = shape.ways_m(*beams.starts_and_rays(returns[:, others]))
    answers[others] = (enter_m >= leave_m) | (ranges_m[others] >= enter_m)
    returns, apart_rad = returns[:, answers], beams.starts_apart_m / ranges_m[answers]
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

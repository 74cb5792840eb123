"""The road below a sweep, and the height of the ground around it.

Ego-motion from the bus knows no pitch, so the road of each sweep is a plane of its own, found among its returns.
Heights count from that plane; pavements and kerbs are in the grid of ground heights, made of neighbouring sweeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from bench.annotation.settings import ProposalSettings
from bench.geometry import RigidTransform

Floats = NDArray[np.float64]
FIT_RANGE_M, FIT_POINTS = 18.0, 6000  # returns that the plane is fitted to
FIT_SCALES_M = (0.2, 0.12, 0.08, 0.06, 0.05)  # residuals that count, round by round
FLAT = np.diag([1.0, 50.0, 50.0])  # prior of the plane: level, as the mounting says
MOST_OFFSET_M, MOST_SLOPE = 0.3, 0.06  # of a plane that is believed
BELOW_ROAD_M, ABOVE_ROAD_M = -0.25, 0.5  # ground lies between
GROUND_SPAN_M = (-0.2, 0.35)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Road:
    """The road as a plane of the world: `normal @ point == offset_m`.

    Attributes:
        normal: (3,) float64, unit vector, up.
        offset_m: m.
    """

    normal: Floats
    offset_m: float

    def heights(self, points_world: Floats) -> Floats:
        """(N,) float64, m above the road, of points (N, 3)."""
        return np.asarray(points_world @ self.normal - self.offset_m)

    @property
    def world_from_levelled(self) -> Floats:
        """(3, 4) float64: maps (x, y, height above the road, 1), x and y of the world, to the world frame, m."""
        x, y, z = self.normal
        return np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-x / z, -y / z, 1 / z, self.offset_m / z]])

    def world(self, points_levelled: Floats) -> Floats:
        """(N, 3) float64, world frame, m, of points (N, 3) whose third component is their height above the road."""
        matrix = self.world_from_levelled
        return np.asarray(points_levelled @ matrix[:, :3].T + matrix[:, 3])


def fit_road(points_vehicle: Floats, world_from_vehicle: RigidTransform, height_m: float) -> Road:
    """The plane through the road's returns, by weights that fall with the residual; level where none can be found.

    Args:
        points_vehicle: (N, 3) float64, m, all returns of a sweep, vehicle frame at the sweep's time.
        world_from_vehicle: pose at the time of the sweep.
        height_m: of the road in the vehicle frame, as the mounting tells.
    """
    away_m = np.hypot(points_vehicle[:, 0], points_vehicle[:, 1])
    low = np.abs(points_vehicle[:, 2] - height_m) < 0.15 + 0.025 * away_m
    points = points_vehicle[low & (away_m < FIT_RANGE_M)]
    points = points[:: max(len(points) // FIT_POINTS, 1)] - np.array([0.0, 0.0, height_m])
    plane = np.zeros(3)
    design = np.column_stack([np.ones(len(points)), points[:, :2]])
    for scale_m in FIT_SCALES_M:
        weights = np.maximum(1 - ((points[:, 2] - design @ plane) / (2 * scale_m)) ** 2, 0) ** 2
        weighted = design * weights[:, None]
        plane = np.linalg.solve(design.T @ weighted + FLAT, weighted.T @ points[:, 2])
    if abs(plane[0]) > MOST_OFFSET_M or np.hypot(plane[1], plane[2]) > MOST_SLOPE:
        plane = np.zeros(3)
    up = np.array([-plane[1], -plane[2], 1.0])
    length = float(np.linalg.norm(up))
    normal = world_from_vehicle.rotation @ (up / length)
    offset_m = float(normal @ world_from_vehicle.translation_m) + (plane[0] + height_m) / length
    return Road(normal=normal, offset_m=offset_m)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightGrid:
    """Heights above the road in cells of the world's x and y.

    Attributes:
        first: (2,) int64, number of the first cell along x and y, counted from the world's origin.
        heights_m: (A, B) float32, m; infinite where nothing is known.
        cell_m: width of a cell.
    """

    first: NDArray[np.int64]
    heights_m: NDArray[np.float32]
    cell_m: float

    def at(self, points: Floats) -> NDArray[np.float32]:
        """(N,) float32, m, at points (N, 2 or more), x and y; beyond the grid those of its border."""
        cells = np.floor(points[:, :2] / self.cell_m).astype(np.int64) - self.first
        columns, rows = np.clip(cells, 0, np.array(self.heights_m.shape) - 1).T
        return np.asarray(self.heights_m[columns, rows])


def lowest_heights(points_levelled: Floats, centre: Floats, settings: ProposalSettings) -> HeightGrid:
    """Lowest return of one sweep in each cell.

    Args:
        points_levelled: (N, 3) float64, m, none further than `range_m` from the centre.
        centre: (2,) float64, m, of the sweep.
        settings: of the proposals.
    """
    reach = int(np.ceil(settings.range_m / settings.cell_m)) + 2
    first = np.floor(centre[:2] / settings.cell_m).astype(np.int64) - reach
    low = np.full((2 * reach + 1, 2 * reach + 1), np.inf, dtype=np.float32)
    ground = points_levelled[(points_levelled[:, 2] > BELOW_ROAD_M) & (points_levelled[:, 2] < ABOVE_ROAD_M)]
    cells = np.clip(np.floor(ground[:, :2] / settings.cell_m).astype(np.int64) - first, 0, 2 * reach)
    np.minimum.at(low, (cells[:, 0], cells[:, 1]), ground[:, 2].astype(np.float32))
    return HeightGrid(first=first, heights_m=low, cell_m=settings.cell_m)


def ground_heights(target: HeightGrid, others: Sequence[HeightGrid]) -> HeightGrid:
    """Ground around a sweep: lowest returns of all sweeps, opened, so that objects do not count.

    Args:
        target: whose cells are asked for.
        others: of all sweeps that may tell, the target's own among them.
    """
    low, size = np.full_like(target.heights_m, np.inf), len(target.heights_m)
    for other in others:
        (a, b), (c, d) = other.first - target.first, target.first - other.first
        if max(abs(a), abs(b)) < size:
            seen = low[max(a, 0) : size + min(a, 0), max(b, 0) : size + min(b, 0)]
            np.minimum(seen, other.heights_m[max(c, 0) : size + min(c, 0), max(d, 0) : size + min(d, 0)], out=seen)
    low = ndimage.minimum_filter(low, 3)
    ground = ndimage.median_filter(np.where(np.isfinite(low), low, np.float32(0.0)), 3)
    return HeightGrid(first=target.first, heights_m=np.clip(ground, *GROUND_SPAN_M), cell_m=target.cell_m)

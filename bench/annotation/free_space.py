"""What a sweep tells of its surroundings: the road below, the height of the ground, and free space.

Ego-motion from the bus knows no pitch, so the road of each sweep is a plane of its own, found among its returns.
Heights count from that plane; pavements and kerbs are in the grid of ground heights, made of neighbouring sweeps.

A beam that later, or earlier, went through a place says that what stood there has moved. A sweep becomes a range image
in the sensor's own frame. Places are looked up in the images of other sweeps, seen from where the sensor was when its
beam had that direction; a revolution takes long enough for the vehicle to move a metre.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt, tau

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from bench.annotation.settings import ProposalSettings
from bench.geometry import RigidTransform
from bench.machine_code import compiled, inlined
from bench.reference.sweeps import PosedSweep

Floats = NDArray[np.float64]
FIT_RANGE_M, FIT_POINTS = 18.0, 6000  # returns that the plane is fitted to
FIT_SCALES_M = (0.2, 0.12, 0.08, 0.06, 0.05)  # residuals that count, round by round
FLAT = np.diag([1.0, 50.0, 50.0])  # prior of the plane: level, as the mounting says
MOST_OFFSET_M, MOST_SLOPE = 0.3, 0.06  # of a plane that is believed
BELOW_ROAD_M, ABOVE_ROAD_M = -0.25, 0.5  # ground lies between
GROUND_SPAN_M = (-0.2, 0.35)
BINS = 90  # of azimuth, each with its own pose of the sensor
LEAST_SEEN = 3  # of nine cells, for a direction to be looked at


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


def polar(points_sensor: Floats) -> tuple[Floats, Floats, Floats]:
    """Ranges, m, azimuths from -pi to pi, rad, and slopes, tangents of the elevations, (N,) each, of points (N, 3)."""
    x, y, z = np.ascontiguousarray(points_sensor.T)
    flat2 = x * x + y * y
    slopes = z / np.maximum(np.sqrt(flat2), 1e-9)
    return np.sqrt(flat2 + z * z), np.arctan2(y, x), slopes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeView:
    """A sweep as a witness.

    Attributes:
        ranges_m: (A, E) float32, azimuth from -pi and elevation from the lowest; the shortest range of a cell and its
            neighbours, NaN where too few of them have one.
        sensor_from_levelled: (BINS, 3, 4) float64, maps (x, y, height, 1) to the sensor frame when it looked there.
        middle: (3, 4) float64, the same at the middle of the sweep, which tells the bin.
    """

    ranges_m: NDArray[np.float32]
    sensor_from_levelled: Floats
    middle: Floats


def range_view(
    placed: PosedSweep,
    measured: tuple[Floats, Floats, Floats],
    usable: NDArray[np.bool_],
    road: Road,
    settings: ProposalSettings,
) -> RangeView:
    """Make a range image of a sweep.

    Args:
        placed: the sweep.
        measured: its points as `polar` gives them.
        usable: (N,) bool, False for returns of the own vehicle.
        road: of this sweep.
        settings: of the proposals.
    """
    range_m, azimuth_rad, slopes = measured
    azimuth, elevation = azimuth_rad + pi, np.arctan(slopes) - settings.lowest_rad
    shape = (
        round(tau / settings.azimuth_rad),
        round((settings.highest_rad - settings.lowest_rad) / settings.elevation_rad),
    )
    column = (azimuth * (shape[0] / tau)).astype(np.int64) % shape[0]
    row = np.floor(elevation / settings.elevation_rad).astype(np.int64)
    usable = usable & (row >= 0) & (row < shape[1])
    image = np.full(shape, np.inf, dtype=np.float32)
    np.minimum.at(image, (column[usable], row[usable]), range_m[usable].astype(np.float32))
    low = ndimage.minimum_filter(image, 3, mode=["wrap", "constant"], cval=np.inf)  # azimuth goes round
    seen = ndimage.uniform_filter(np.isfinite(image).astype(np.float32), 3, mode=["wrap", "constant"])
    low[seen < (LEAST_SEEN - 0.5) / 9] = np.nan
    chain, middle = _sensor_from_levelled(placed, (azimuth * (BINS / tau)).astype(np.int64) % BINS, road)
    return RangeView(ranges_m=low, sensor_from_levelled=chain, middle=middle)


def _sensor_from_levelled(placed: PosedSweep, bins: NDArray[np.int64], road: Road) -> tuple[Floats, Floats]:
    """Poses by azimuth, at the mean time of the points of each bin, and the one in the middle of the sweep."""
    after_ns = (placed.times_ns - placed.interpolation_ns[0]).astype(np.float64)
    counts = np.bincount(bins, minlength=BINS)
    known = np.flatnonzero(counts)
    times = np.interp(np.arange(BINS), known, np.bincount(bins, after_ns, BINS)[known] / counts[known])
    steps = (placed.interpolation_ns - placed.interpolation_ns[0]).astype(np.float64)
    nearest = np.clip(np.rint(np.interp(times, steps, np.arange(len(steps)))).astype(np.int64), 0, len(steps) - 1)
    sensor = placed.lidar_from_sensor
    world_from_sensor = placed.rotations @ sensor.rotation
    origins_m = placed.rotations @ sensor.translation_m + placed.positions_m
    chain = np.tile(road.world_from_levelled, (len(steps), 1, 1))
    chain[:, :, 3] -= origins_m
    chain = np.swapaxes(world_from_sensor, 1, 2) @ chain
    return np.ascontiguousarray(chain[nearest]), np.ascontiguousarray(chain[len(steps) // 2])


@inlined
def _angle(y: float, x: float) -> float:
    """Azimuth of (x, y) from -pi to pi, rad, to 1e-4, a fiftieth of a cell, in a third of the time of atan2."""
    across, along = abs(y), abs(x)
    slope = min(across, along) / max(max(across, along), 1e-30)
    square = slope * slope
    angle = ((-0.0464964749 * square + 0.15931422) * square - 0.327622764) * square * slope + slope
    if across > along:
        angle = 0.5 * pi - angle
    if x < 0.0:
        angle = pi - angle
    return -angle if y < 0.0 else angle


@compiled
def count_witness(
    points: Floats,
    ranges_m: NDArray[np.float32],
    middle: Floats,
    chain: Floats,
    lowest_rad: float,
    cells_per_rad: float,
    beyond_m: float,
    beyond_share: float,
    seen_through: NDArray[np.int32],
    met: NDArray[np.int32],
) -> None:
    """Add one sweep's testimony.

    Args:
        points: (N, 3) float64, m, x and y of the world and height above the road.
        ranges_m: of the other sweep's `RangeView`.
        middle: likewise.
        chain: its `sensor_from_levelled`.
        lowest_rad: as in the settings.
        cells_per_rad: in elevation.
        beyond_m: as in the settings.
        beyond_share: likewise.
        seen_through: (N,) int32, gets one more where its beams went further.
        met: (N,) int32, gets one more where they ended at the point.
    """
    bins, (columns, rows) = len(chain), ranges_m.shape
    for i in range(len(points)):
        x, y, h = points[i, 0], points[i, 1], points[i, 2]
        u = middle[0, 0] * x + middle[0, 1] * y + middle[0, 2] * h + middle[0, 3]
        v = middle[1, 0] * x + middle[1, 1] * y + middle[1, 2] * h + middle[1, 3]
        k = int((_angle(v, u) + pi) * (bins / (2 * pi))) % bins
        u = chain[k, 0, 0] * x + chain[k, 0, 1] * y + chain[k, 0, 2] * h + chain[k, 0, 3]
        v = chain[k, 1, 0] * x + chain[k, 1, 1] * y + chain[k, 1, 2] * h + chain[k, 1, 3]
        w = chain[k, 2, 0] * x + chain[k, 2, 1] * y + chain[k, 2, 2] * h + chain[k, 2, 3]
        range_m = sqrt(u * u + v * v + w * w)
        if range_m < 1e-6:
            continue
        column = int((_angle(v, u) + pi) * (columns / (2 * pi))) % columns
        height = (_angle(w, sqrt(u * u + v * v)) - lowest_rad) * cells_per_rad
        if height < 0.0 or height >= rows:
            continue
        seen_m, slack_m = ranges_m[column, int(height)], beyond_m + beyond_share * range_m
        if seen_m > range_m + slack_m:
            seen_through[i] += 1
        elif seen_m >= range_m - slack_m:
            met[i] += 1

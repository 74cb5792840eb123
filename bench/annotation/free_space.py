"""Free space as a witness: a beam that later, or earlier, went through a place says that what stood there has moved.

A sweep becomes a range image in the sensor's own frame. Places are looked up in the images of other sweeps, seen from
where the sensor was when its beam had that direction; a revolution takes long enough for the vehicle to move a metre.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.annotation.ground import Road
from bench.annotation.settings import ProposalSettings
from bench.machine_code import compiled, inlined
from bench.reference.sweeps import PosedSweep

Floats = NDArray[np.float64]
BINS = 90  # of azimuth, each with its own pose of the sensor
LEAST_SEEN = 3  # of nine cells, for a direction to be looked at


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polar:
    """The points of a sweep as the sensor measures them.

    Attributes:
        range_m: (N,) float64.
        azimuth_rad: (N,) float64, from -pi to pi.
        slopes: (N,) float64, tangents of the elevations.
    """

    range_m: Floats
    azimuth_rad: Floats
    slopes: Floats

    @classmethod
    def of(cls, points_sensor: Floats) -> Polar:
        """Of points, (N, 3), sensor frame, m."""
        x, y, z = np.ascontiguousarray(points_sensor.T)
        flat2 = x * x + y * y
        slopes = z / np.maximum(np.sqrt(flat2), 1e-9)
        return cls(range_m=np.sqrt(flat2 + z * z), azimuth_rad=np.arctan2(y, x), slopes=slopes)


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
    placed: PosedSweep, polar: Polar, usable: NDArray[np.bool_], road: Road, settings: ProposalSettings
) -> RangeView:
    """Make a range image of a sweep.

    Args:
        placed: the sweep.
        polar: its points.
        usable: (N,) bool, False for returns of the own vehicle.
        road: of this sweep.
        settings: of the proposals.
    """
    azimuth = polar.azimuth_rad + pi
    elevation = np.arctan(polar.slopes) - settings.lowest_rad
    shape = (
        round(tau / settings.azimuth_rad),
        round((settings.highest_rad - settings.lowest_rad) / settings.elevation_rad),
    )
    column = (azimuth * (shape[0] / tau)).astype(np.int64) % shape[0]
    row = np.floor(elevation / settings.elevation_rad).astype(np.int64)
    usable = usable & (row >= 0) & (row < shape[1])
    image = np.full(shape, np.inf, dtype=np.float32)
    np.minimum.at(image, (column[usable], row[usable]), polar.range_m[usable].astype(np.float32))
    low = _over_neighbours(np.minimum, image, np.float32(np.inf))
    seen = _over_neighbours(np.add, np.isfinite(image).astype(np.int8), np.int8(0))
    low[seen < LEAST_SEEN] = np.nan
    chain, middle = _sensor_from_levelled(placed, (azimuth * (BINS / tau)).astype(np.int64) % BINS, road)
    return RangeView(ranges_m=low, sensor_from_levelled=chain, middle=middle)


def _over_neighbours(combine: np.ufunc, image: NDArray[Any], outside: np.generic) -> NDArray[Any]:
    """Combine each cell with its eight neighbours; azimuth goes round."""
    padded = np.pad(image, ((1, 1), (0, 0)), mode="wrap")
    columns = combine(combine(padded[:-2], padded[1:-1]), padded[2:])
    padded = np.pad(columns, ((0, 0), (1, 1)), constant_values=outside)
    return np.asarray(combine(combine(padded[:, :-2], padded[:, 1:-1]), padded[:, 2:]))


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


def count_witness(
    points_levelled: Floats,
    view: RangeView,
    seen_through: NDArray[np.int32],
    met: NDArray[np.int32],
    settings: ProposalSettings,
) -> None:
    """Add one sweep's testimony.

    Args:
        points_levelled: (N, 3) float64, m.
        view: of the other sweep.
        seen_through: (N,) int32, gets one more where its beams went further.
        met: (N,) int32, gets one more where they ended at the point.
        settings: of the proposals.
    """
    _count(
        points_levelled, view.ranges_m, view.middle, view.sensor_from_levelled, settings.lowest_rad,
        1 / settings.elevation_rad, settings.beyond_m, settings.beyond_share, seen_through, met,
    )  # fmt: skip


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
def _count(
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

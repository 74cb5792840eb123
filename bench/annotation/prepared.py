"""Sweeps prepared: de-skewed, levelled, with ground and free space; each becomes a cloud of voxels with testimony."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bench.annotation import free_space
from bench.annotation.settings import ProposalSettings
from bench.geometry import RigidTransform
from bench.records.recording import Recording, SweepRef
from bench.reference.sweeps import pose_sweep
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
COLUMNS = 1440  # of azimuth, in which returns are looked for
LEAST_GAP_RAD = radians(30.0)  # between azimuths, of a lidar that does not look all around


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """Points above the ground in a sweep, one for each voxel.

    Attributes:
        number: of the sweep in the recording.
        timestamp_ns: of the sweep.
        points: (N, 3) float64, m, x and y of the world, height above the road.
        offset_s: (N,) float64, time of each point after the sweep's.
        seen_through: (N,) int32, sweeps whose beams went through the point.
        met: (N,) int32, sweeps whose beams ended there.
        cut_off: (N,) bool, at the edge of the lidar's sector, beyond which the object may go on.
        cut_above: (N,) bool, at the highest beam or where `top_m` ends the search, above which the object may go on.
        sensor_m: (2,) float64, position of the lidar, x and y of the world.
        ground: around the sweep.
        road: heights count from it.
    """

    number: int
    timestamp_ns: int
    points: Floats
    offset_s: Floats
    seen_through: NDArray[np.int32]
    met: NDArray[np.int32]
    cut_off: NDArray[np.bool_]
    cut_above: NDArray[np.bool_]
    sensor_m: Floats
    ground: free_space.HeightGrid
    road: free_space.Road

    @cached_property
    def tree(self) -> KDTree:
        """Finds points near others, in three dimensions."""
        return KDTree(self.points if len(self.points) else np.full((1, 3), 1e9))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Prepared:
    """A sweep before its neighbours are known; fields as in `Cloud`, for every return that may do.

    Attributes:
        slopes: (N,) float64, tangents of the elevations of the points, seen from where their beams start.
        highest_slope: of the highest beam that meets anything.
    """

    number: int
    timestamp_ns: int
    points: Floats
    offset_s: Floats
    cut_off: NDArray[np.bool_]
    slopes: Floats
    highest_slope: float
    sensor_m: Floats
    road: free_space.Road
    lowest: free_space.HeightGrid
    view: free_space.RangeView


def clouds(recording: Recording, settings: ProposalSettings) -> Iterator[Cloud]:
    """Every sweep that has ego-motion, in time; only those within the window are held.

    Args:
        recording: the drive.
        settings: of the proposals.
    """
    window_ns = round(settings.window_s * SECOND_NS)
    held: deque[_Prepared] = deque()
    waiting: deque[_Prepared] = deque()
    for number, ref in enumerate(recording.sweeps):
        prepared = _prepare(recording, number, ref, settings)
        while waiting and ref.timestamp_ns - waiting[0].timestamp_ns > window_ns:
            yield _judged(waiting.popleft(), held, settings)
        while held and held[0].timestamp_ns < (waiting[0].timestamp_ns if waiting else ref.timestamp_ns) - window_ns:
            held.popleft()
        if prepared is not None:
            held.append(prepared)
            waiting.append(prepared)
    for last in waiting:
        yield _judged(last, held, settings)


def _prepare(recording: Recording, number: int, ref: SweepRef, settings: ProposalSettings) -> _Prepared | None:
    """None without ego-motion, or without points."""
    placed = pose_sweep(ref.read(), recording.trajectory, recording.vehicle_from_lidar, recording.lidar_from_sensor)
    rotations, positions_m, valid = recording.trajectory.at(np.array([ref.timestamp_ns], dtype=np.int64))
    if placed is None or not valid[0]:
        return None
    world, measured = placed.points_world(), free_space.polar(placed.points_sensor())
    range_m, azimuth_rad, _ = measured
    world_from_vehicle = RigidTransform(rotations[0], positions_m[0])
    vehicle = world_from_vehicle.inverse().apply(world)
    road = free_space.fit_road(vehicle, world_from_vehicle, recording.ground_m)
    levelled = np.column_stack([world[:, :2], road.heights(world)])
    low, high = recording.vehicle_outline_m.min(axis=0), recording.vehicle_outline_m.max(axis=0)
    inside = (vehicle[:, :2] > low - settings.own_margin_m) & (vehicle[:, :2] < high + settings.own_margin_m)
    usable = ~(inside.all(axis=1) & (levelled[:, 2] < settings.own_top_m)) & (range_m > settings.nearest_m)
    near = usable & (range_m < settings.range_m) & (levelled[:, 2] < settings.top_m)
    flat_x, flat_y, lift = placed.points_from_beams(np.flatnonzero(near)).T
    origin = placed.rotations @ placed.lidar_from_sensor.translation_m + placed.positions_m
    sensor_m = origin[len(origin) // 2, :2]
    return _Prepared(
        number=number,
        timestamp_ns=ref.timestamp_ns,
        points=levelled[near],
        offset_s=(placed.times_ns[near] - ref.timestamp_ns) / SECOND_NS,
        cut_off=_at_sector_edge(azimuth_rad[near], settings.sector_edge_rad),
        slopes=lift / np.hypot(flat_x, flat_y),
        highest_slope=placed.envelope.highest.slope,
        sensor_m=sensor_m,
        road=road,
        lowest=free_space.lowest_heights(levelled[near], sensor_m, settings),
        view=free_space.range_view(placed, measured, usable, road, settings),
    )


def _judged(prepared: _Prepared, held: Sequence[_Prepared], settings: ProposalSettings) -> Cloud:
    """Take the ground away, and ask the neighbours."""
    ground = free_space.ground_heights(prepared.lowest, [other.lowest for other in held])
    above = prepared.points[:, 2] - ground.at(prepared.points) > settings.ground_m
    highest_rad = np.arctan(max(other.highest_slope for other in held))  # in one sweep it may be an object's own top
    at_top = prepared.slopes > np.tan(highest_rad - settings.beam_edge_rad)
    at_top |= prepared.points[:, 2] > settings.top_m - settings.voxel_m
    voxel, counts = _voxels(prepared.points[above], settings.voxel_m)

    def mean(values: NDArray[Any]) -> Floats:
        return np.asarray(np.bincount(voxel, values[above], len(counts)) / counts)

    points = np.stack([mean(axis) for axis in prepared.points.T], axis=1)
    seen_through, met = np.zeros(len(points), dtype=np.int32), np.zeros(len(points), dtype=np.int32)
    near_ns = settings.window_s * SECOND_NS
    others = [
        other for other in held
        if other is not prepared and abs(other.timestamp_ns - prepared.timestamp_ns) < near_ns
    ]  # fmt: skip
    for k in np.unique(np.linspace(0, len(others) - 1, min(settings.witnesses, len(others))).astype(int)):
        view = others[k].view
        free_space.count_witness(
            points, view.ranges_m, view.middle, view.sensor_from_levelled, settings.lowest_rad,
            1 / settings.elevation_rad, settings.beyond_m, settings.beyond_share, seen_through, met,
        )  # fmt: skip
    return Cloud(
        number=prepared.number,
        timestamp_ns=prepared.timestamp_ns,
        points=points,
        offset_s=mean(prepared.offset_s),
        seen_through=seen_through,
        met=met,
        cut_off=mean(prepared.cut_off) > 0,
        cut_above=mean(at_top) > 0,
        sensor_m=prepared.sensor_m,
        ground=ground,
        road=prepared.road,
    )


def _voxels(points: Floats, voxel_m: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(N,) intp, number of the voxel of each point, and (M,) intp, how many points each has."""
    if not len(points):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    cells = np.floor(points / voxel_m).astype(np.int64)
    cells -= cells.min(axis=0)
    _, height, depth = (cells.max(axis=0) + 1).tolist()
    _, voxel, counts = np.unique(
        (cells[:, 0] * height + cells[:, 1]) * depth + cells[:, 2], return_inverse=True, return_counts=True
    )
    return voxel, counts


def _at_sector_edge(azimuth_rad: Floats, within_rad: float) -> NDArray[np.bool_]:
    """(N,) bool, near the sides of a gap between the azimuths of a sweep that is no matter of chance."""
    azimuth = azimuth_rad % tau
    known = np.flatnonzero(np.bincount((azimuth * (COLUMNS / tau)).astype(np.int64) % COLUMNS, minlength=COLUMNS))
    gaps = np.diff(known, append=known[:1] + COLUMNS)
    if not len(known) or gaps.max() * tau / COLUMNS < LEAST_GAP_RAD:
        return np.zeros(len(azimuth), dtype=bool)
    first = known[(np.argmax(gaps) + 1) % len(known)] * tau / COLUMNS
    last = (known[np.argmax(gaps)] + 1) * tau / COLUMNS
    return np.asarray(((azimuth - first) % tau < within_rad) | ((last - azimuth) % tau < within_rad))

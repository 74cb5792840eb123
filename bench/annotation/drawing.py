"""An object that was missed, from its points: fitted at one sweep and followed through those before and after."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from shapely import contains_xy, make_valid
from shapely.geometry import MultiPoint, Polygon

from bench.annotation.boxes import guess_class, slopes
from bench.annotation.settings import ProposalSettings
from bench.annotation.store import Position, StoredTrack, box_states
from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import Recording
from bench.recordings.validation import FileModel
from bench.reference.sweeps import pose_sweep
from bench.times import SECOND_NS

GROUND_M, GROUND_SLOPE = 0.2, 0.01  # above the road by less than this and this part of the range
NEAR_M, LOW_PERCENT = 15.0, 5  # returns so near tell the height of the road
FEWEST_POINTS = 5
FARTHEST_SWEEPS = 300  # that a track is followed in each direction
REACH_M = 0.6  # around where the object is expected, in which its points are looked for
MARGIN_M = 0.08  # between the outermost returns and the side of a box
LARGEST_SPEED_MPS = 60.0
STANDING_MPS = 0.5  # below, the heading is that of the outline
FOLLOWED_PART = 0.25  # of its points a sweep before, below which an object is lost
SMALLEST_M = 0.3


class Lasso(FileModel):
    """Outline that a reviewer drew around the points of an object.

    Attributes:
        sweep: index of the sweep.
        outline_m: x and y in the world, m.
    """

    sweep: int = Field(ge=0)
    outline_m: tuple[tuple[Position, Position], ...] = Field(min_length=3, max_length=1000)


def sweep_points_world(sweep: LidarSweep, recording: Recording) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """The points of a sweep in the world, each taken from where the lidar was at its own time.

    Returns:
        points: (N, 3) float64, m, world frame.
        ground: (N,) bool, True near the road as the vehicle stands on it.

    Raises:
        DataError: no ego-motion at the time of the sweep.
    """
    placed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar)
    if placed is None:
        for time_ns in sweep.times_ns[[0, -1]] if len(sweep.times_ns) else ():
            recording.trajectory.world_from_vehicle(int(time_ns))  # raises, with what is there
        return np.empty((0, 3)), np.empty(0, dtype=bool)
    points = placed.points_world()
    world_from_vehicle = recording.trajectory.world_from_vehicle(int(placed.interpolation_ns[0]))
    away = points - world_from_vehicle.translation_m
    above_m, range_m = away @ world_from_vehicle.rotation[:, 2], np.hypot(*away.T[:2])
    near = range_m < NEAR_M
    road_m = np.percentile(above_m[near], LOW_PERCENT) if near.any() else 0.0
    return points, above_m - road_m < GROUND_M + GROUND_SLOPE * range_m


def draw_track(recording: Recording, lasso: Lasso, *, name: str) -> StoredTrack:
    """Make a track of the points inside of a lasso.

    Raises:
        UsageError: no such sweep, or fewer than five points above the road.
        DataError: a sweep or the ego-motion cannot be used.
    """
    if lasso.sweep >= len(recording.sweeps):
        raise UsageError(f"sweep: expected one of {len(recording.sweeps)}, got {lasso.sweep}")
    points = _standing(recording, lasso.sweep)
    points = points[contains_xy(make_valid(Polygon(lasso.outline_m)), points[:, 0], points[:, 1])]
    if len(points) < FEWEST_POINTS:
        raise UsageError(f"lasso: expected at least {FEWEST_POINTS} points above the road, got {len(points)}")
    sweeps, points_in = range(len(recording.sweeps)), {lasso.sweep: points}
    for way in (sweeps[: lasso.sweep][::-1], sweeps[lasso.sweep + 1 :]):
        points_in |= dict(_followed(recording, points, lasso.sweep, way[:FARTHEST_SWEEPS]))
    return _fitted(recording, dict(sorted(points_in.items())), name)


def _standing(recording: Recording, index: int) -> NDArray[np.float64]:
    points, ground = sweep_points_world(recording.sweeps[index].read(), recording)
    return points[~ground]


def _followed(
    recording: Recording, start: NDArray[np.float64], start_index: int, indices: Iterable[int]
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """The object's points in further sweeps, as long as enough are near to where its motion leads."""
    times_s = {start_index: recording.sweeps[start_index].timestamp_ns / 1e9}
    points, index, velocity = start, start_index, np.zeros(2)
    for following in indices:
        times_s[following] = recording.sweeps[following].timestamp_ns / 1e9
        step_s = times_s[following] - times_s[index]
        expected = points[:, :2] + velocity * step_s
        area = MultiPoint(expected).convex_hull.buffer(REACH_M)
        seen = _standing(recording, following)
        inside = contains_xy(area, seen[:, 0], seen[:, 1])
        if inside.sum() < max(FEWEST_POINTS, FOLLOWED_PART * len(points)):
            return
        moved = (_middle(seen[inside]) - _middle(points)) / step_s
        if np.hypot(*moved) > LARGEST_SPEED_MPS:
            return
        velocity = moved if index == start_index else 0.6 * velocity + 0.4 * moved
        points, index = seen[inside], following
        yield following, points


def _middle(points: NDArray[np.float64]) -> NDArray[np.float64]:
    low, high = np.percentile(points[:, :2], [5, 95], axis=0)
    return np.asarray((low + high) / 2)


def _fitted(recording: Recording, points_in: dict[int, NDArray[np.float64]], name: str) -> StoredTrack:
    times_ns = np.array([recording.sweeps[i].timestamp_ns for i in points_in], dtype=np.int64)
    middles = np.array([_middle(points) for points in points_in.values()])
    velocities = slopes((times_ns - times_ns[0]) / SECOND_NS, middles, ProposalSettings().fit_s)
    speeds = np.hypot(*velocities.T)
    moving = speeds > STANDING_MPS
    if np.median(speeds) > STANDING_MPS:
        headings = np.unwrap(np.arctan2(velocities[moving, 1], velocities[moving, 0]))
        yaws = np.interp(np.arange(len(points_in)), np.flatnonzero(moving), headings)
    else:
        yaws = np.full(len(points_in), _heading(next(iter(points_in.values()))))
    axes = [RigidTransform.from_yaw(yaw).rotation for yaw in yaws]
    ends = [np.percentile(points @ own, [2, 98], axis=0) for points, own in zip(points_in.values(), axes, strict=True)]
    lows, highs = np.stack(ends, axis=1) + np.array([-MARGIN_M, MARGIN_M])[:, None, None]
    lows[:, 2] -= GROUND_M - MARGIN_M  # what stands on the road was left out with it
    size_m = np.maximum(np.percentile(highs - lows, 80, axis=0), SMALLEST_M)
    middles = np.column_stack([(lows + highs)[:, :2] / 2, highs[:, 2] - size_m[2] / 2])
    centres_m = np.einsum("nij,nj->ni", axes, middles)
    return StoredTrack(
        id=name,
        object_class=guess_class(size_m, float(np.median(speeds[moving])) if moving.any() else 0.0),
        size_m=tuple(size_m.tolist()),
        points_median=float(np.median([len(points) for points in points_in.values()])),
        states=box_states(times_ns, centres_m, yaws, velocities),
    )


def _heading(points: NDArray[np.float64]) -> float:
    """Along the longer side of the smallest rectangle around the points."""
    outline = MultiPoint(points[:, :2]).minimum_rotated_rectangle
    if not isinstance(outline, Polygon):
        return 0.0
    sides = np.diff(np.array(outline.exterior.coords)[:3], axis=0)
    x, y = sides[np.argmax(np.hypot(*sides.T))]
    return float(np.arctan2(y, x))

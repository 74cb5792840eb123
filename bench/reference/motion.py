"""Objects that are annotated at an exposure, and how each moves: static or not, which category, which direction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import atan2, hypot, radians

import numpy as np
from numpy.typing import NDArray

from bench.egomotion.trajectory import Trajectory
from bench.geometry import Floats, RigidTransform
from bench.records.recording import (
    Cuboid,
    GroundPolygon,
    ObjectShape,
    ObjectState,
    Recording,
    Track,
    world_velocities,
)
from bench.records.reference import Category, Direction
from bench.records.rules import MotionSettings, ReferenceSettings
from bench.times import SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectAtExposure:
    """An annotated object at an exposure.

    Attributes:
        track: the object.
        state: its annotation nearest in time.
        world_from_vehicle: pose of the vehicle at the time of the annotation.
        velocity_world_mps: (3,) float64, over the ground, by which its points are moved; NaN where unknown.
        smooth_world_mps: (3,) float64, averaged along the track, which decides the category; NaN where unknown.
        moving: by its own speed, with hysteresis.
    """

    track: Track
    state: ObjectState
    world_from_vehicle: RigidTransform
    velocity_world_mps: Floats
    smooth_world_mps: Floats
    moving: bool

    @property
    def known_velocity_mps(self) -> Floats:
        """(3,) float64, by which its points are moved; 0 where unknown."""
        return np.nan_to_num(self.velocity_world_mps)

    @property
    def static(self) -> bool:
        """It stands, and the data set says neither that it moves nor that its motion is unclear."""
        stated = self.state.category is not None or self.state.unclear
        return not (stated or self.moving) and bool(np.isfinite(self.smooth_world_mps).all())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackMotion:
    """Motion of a track at each of its states.

    Attributes:
        track: of N states.
        velocity_world_mps: (N, 3) float64, over the ground, world axes, as annotated or from the track's positions;
            NaN where neither tells.
        smooth_world_mps: (N, 3) float64, the same averaged along the track; NaN where unknown.
        moving: (N,) bool, with hysteresis and minimum run length; False where unknown.
    """

    track: Track
    velocity_world_mps: Floats
    smooth_world_mps: Floats
    moving: NDArray[np.bool_]

    def at(self, index: int, world_from_vehicle: RigidTransform) -> ObjectAtExposure:
        """The object by one of its states, with the pose of the vehicle then."""
        return ObjectAtExposure(
            track=self.track,
            state=self.track.states[index],
            world_from_vehicle=world_from_vehicle,
            velocity_world_mps=self.velocity_world_mps[index],
            smooth_world_mps=self.smooth_world_mps[index],
            moving=bool(self.moving[index]),
        )


def track_motion(track: Track, trajectory: Trajectory, settings: MotionSettings) -> TrackMotion:
    """Velocities and the moving state along a track.

    Source:
        docs/metrics.md, category of a moving object, rule 1.
    """
    times_ns = np.array([state.timestamp_ns for state in track.states], dtype=np.int64)
    rotations, positions_m, _ = trajectory.at(times_ns)
    annotated = np.array([state.velocity_mps for state in track.states], dtype=np.float64).reshape(-1, 3)
    velocity = np.einsum("nij,nj->ni", rotations, annotated)
    centres = np.array([centre_vehicle(state.shape) for state in track.states]).reshape(-1, 3)
    centres_world = np.einsum("nij,nj->ni", rotations, centres) + positions_m
    velocity = np.where(np.isfinite(velocity), velocity, world_velocities(times_ns, centres_world))
    smooth = _smoothed(times_ns, velocity, round(settings.smoothing_s * SECOND_NS))
    moving = moving_states(times_ns, np.hypot(smooth[:, 0], smooth[:, 1]), settings)
    return TrackMotion(track=track, velocity_world_mps=velocity, smooth_world_mps=smooth, moving=moving)


def centre_vehicle(shape: ObjectShape) -> Floats:
    """(3,) float64, m, a point that moves with the object, vehicle frame; NaN for point indices: it takes the sweep."""
    match shape:
        case Cuboid():
            return shape.vehicle_from_object.translation_m
        case GroundPolygon():
            return np.array([*shape.outline_m.mean(axis=0), shape.bottom_m])
    return np.full(3, np.nan)


def moving_states(times_ns: NDArray[np.int64], speed_mps: Floats, settings: MotionSettings) -> NDArray[np.bool_]:
    """Moving or static at each time, with hysteresis; runs that are too short take the state around them.

    Args:
        times_ns: (N,) int64, increasing.
        speed_mps: (N,) float64, over the ground; NaN keeps the state before it.
        settings: thresholds.

    Returns:
        (N,) bool.
    """
    moving = np.zeros(len(speed_mps), dtype=bool)
    state: bool | None = None
    for index, speed in enumerate(speed_mps):
        if np.isfinite(speed):
            limit = {None: settings.object_static_mps, True: settings.hysteresis_low_mps}.get(
                state, settings.hysteresis_high_mps
            )
            state = bool(speed >= limit)
        moving[index] = bool(state)
    return _without_short_runs(times_ns, moving, round(settings.min_run_s * SECOND_NS))


def categorise(velocity_mps: Floats, ego_velocity_mps: Floats, settings: MotionSettings) -> Category:
    """Kind of motion of a moving object.

    Args:
        velocity_mps: (3,) float64, of the object over the ground, in axes with z up that both share.
        ego_velocity_mps: (3,) float64, of the ego vehicle; it points backwards along the vehicle in reverse gear.
        settings: thresholds.

    Source:
        docs/metrics.md, category of a moving object, rules 2 and 3.
    """
    (x, y), (ego_x, ego_y) = velocity_mps[:2].tolist(), ego_velocity_mps[:2].tolist()
    ego_speed = hypot(ego_x, ego_y)
    if ego_speed < settings.ego_static_mps or not ego_speed:  # at rest it has no direction of travel
        return Category.STATIC_EGO
    along, across = (x * ego_x + y * ego_y) / ego_speed, (ego_x * y - ego_y * x) / ego_speed
    angle_rad = atan2(abs(across), along)
    if angle_rad > radians(settings.crossing_to_deg):
        return Category.APPROACHING
    if angle_rad >= radians(settings.crossing_from_deg):
        return Category.CROSSING
    return Category.OVERTAKING if along >= ego_speed else Category.PRECEDING


def relative_direction(velocity_vehicle_mps: Floats, ego_vehicle_mps: Floats) -> Direction:
    """Lateral or longitudinal, by the larger component of the relative velocity in the vehicle frame."""
    relative = velocity_vehicle_mps - ego_vehicle_mps
    return Direction.LATERAL if abs(relative[1]) > abs(relative[0]) else Direction.LONGITUDINAL


def _smoothed(times_ns: NDArray[np.int64], values: Floats, window_ns: int) -> Floats:
    """Mean over a window around each time, NaN rows left out."""
    known: NDArray[np.bool_] = np.asarray(np.isfinite(values).all(axis=1))
    sums = np.vstack([np.zeros(3), np.cumsum(np.where(known[:, None], values, 0.0), axis=0)])
    counts = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(known)])
    first = np.searchsorted(times_ns, times_ns - window_ns // 2, side="left")
    last = np.searchsorted(times_ns, times_ns + window_ns // 2, side="right")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((sums[last] - sums[first]) / (counts[last] - counts[first])[:, None])


def _without_short_runs(times_ns: NDArray[np.int64], moving: NDArray[np.bool_], min_run_ns: int) -> NDArray[np.bool_]:
    """Flip inner runs shorter than the limit, the shortest first; runs at the ends are cut off, not short."""
    moving = moving.copy()
    while True:
        starts = np.flatnonzero(np.diff(moving)) + 1
        if len(starts) < 2:
            return moving
        spans_ns = times_ns[starts[1:]] - times_ns[starts[:-1]]
        shortest = int(np.argmin(spans_ns))
        if spans_ns[shortest] >= min_run_ns:
            return moving
        moving[starts[shortest] : starts[shortest + 1]] ^= True


class AnnotationIndex:
    """Finds the objects of an exposure among all annotations of a recording, in time order or not.

    Args:
        recording: the drive.
        settings: of the protocol.
    """

    def __init__(self, recording: Recording, settings: ReferenceSettings) -> None:
        self._trajectory, self._gap_ns = recording.trajectory, round(settings.max_annotation_gap_ms * 1e6)
        self._motion = cache(lambda number: track_motion(recording.tracks[number], self._trajectory, settings.motion))
        rows = [(s.timestamp_ns, t, i) for t, track in enumerate(recording.tracks) for i, s in enumerate(track.states)]
        self._rows = np.array(sorted(rows), dtype=np.int64).reshape(-1, 3)

    def at(self, exposure_ns: int) -> list[ObjectAtExposure]:
        """Every track's state nearest to the exposure, where one is within the protocol's gap."""
        first = np.searchsorted(self._rows[:, 0], exposure_ns - self._gap_ns, side="left")
        last = np.searchsorted(self._rows[:, 0], exposure_ns + self._gap_ns, side="right")
        nearest: dict[int, tuple[int, int]] = {}
        for time_ns, number, index in self._rows[first:last].tolist():
            wait_ns = abs(time_ns - exposure_ns)
            if number not in nearest or wait_ns < nearest[number][0]:
                nearest[number] = wait_ns, index
        pose = cache(self._trajectory.world_from_vehicle)  # most tracks share the time
        motions = [(self._motion(number), index) for number, (_, index) in sorted(nearest.items())]
        return [motion.at(index, pose(motion.track.states[index].timestamp_ns)) for motion, index in motions]

"""The motion of labelled objects: velocities from places, states at sweeps, points as groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from bench.egomotion import Trajectory
from bench.geometry import RigidTransform
from bench.labels.formats import LabelSet
from bench.recordings import Cuboid, GroundPolygon, ObjectShape, ObjectState, Recording, Track
from bench.records.recording import world_velocities, world_yaw_rates

LONGEST_GAP_NS = 1_000_000_000  # an object that was out of sight for longer says nothing of its speed


def with_motion(track: Track, trajectory: Trajectory) -> Track:
    """The track with velocities and yaw rates where it has none, from its places in the world.

    States keep what they have where they have a velocity, where there is no ego-motion, and where an object is seen
    once in a second; outlines give no yaw rate and points named one by one neither.

    Args:
        track: an object.
        trajectory: of the ego vehicle.
    """
    states = list(track.states)
    for run in _runs(states):
        for i, state in zip(run, _moved([states[i] for i in run], trajectory), strict=True):
            states[i] = state
    return replace(track, states=tuple(states))


def _runs(states: Sequence[ObjectState]) -> list[list[int]]:
    """Rows of states with a place, split where nothing is known for too long."""
    runs: list[list[int]] = []
    for i, state in enumerate(states):
        if not isinstance(state.shape, Cuboid | GroundPolygon):
            continue
        if not runs or state.timestamp_ns - states[runs[-1][-1]].timestamp_ns > LONGEST_GAP_NS:
            runs.append([])
        runs[-1].append(i)
    return [run for run in runs if len(run) > 1]


def _moved(states: Sequence[ObjectState], trajectory: Trajectory) -> list[ObjectState]:
    times_ns = np.array([state.timestamp_ns for state in states], dtype=np.int64)
    rotations, positions_m, valid = trajectory.at(times_ns)
    places_m = np.stack([_centre(state) for state in states])
    world_m = np.einsum("nij,nj->ni", rotations, places_m) + positions_m
    velocities = np.full_like(places_m, np.nan)
    if valid.sum() > 1:
        world = world_velocities(times_ns[valid], world_m[valid])
        velocities[valid] = np.einsum("nji,nj->ni", rotations[valid], world)
    turns = np.array([state.yaw_rate_radps for state in states])
    boxes = [(i, state.shape) for i, state in enumerate(states) if valid[i] and isinstance(state.shape, Cuboid)]
    if len(boxes) > 1:
        rows = [i for i, _ in boxes]
        headings = np.stack([box.vehicle_from_object.rotation for _, box in boxes])
        turns[rows] = world_yaw_rates(times_ns[rows], rotations[rows] @ headings)
    return [
        replace(state, velocity_mps=velocities[i], yaw_rate_radps=state.yaw_rate_radps or float(turns[i]))
        if np.isnan(state.velocity_mps).any() and valid[i]
        else state
        for i, state in enumerate(states)
    ]


def _centre(state: ObjectState) -> NDArray[np.float64]:
    if isinstance(state.shape, Cuboid):
        return state.shape.vehicle_from_object.translation_m
    assert isinstance(state.shape, GroundPolygon)
    middle = state.shape.outline_m.mean(axis=0)
    return np.array([*middle, (state.shape.bottom_m + state.shape.top_m) / 2.0])


KINDS = {"Cuboid": "boxes", "GroundPolygon": "ground outlines", "PointIndices": "objects given by their points"}


def states_at_sweeps(
    label_set: LabelSet, recording: Recording, kinds: tuple[type[ObjectShape], ...]
) -> tuple[dict[int, list[tuple[Track, ObjectState]]], list[str]]:
    """Select what a tool that labels sweeps can hold of a label set.

    Args:
        label_set: the annotations.
        recording: what they belong to.
        kinds: shapes that the format has.

    Returns:
        states: sweep's time -> objects at that time; also annotated sweeps without objects.
        lost: one line for states between sweeps, one for each kind of shape that the format does not have.
    """
    sweep_times = {sweep.timestamp_ns for sweep in recording.sweeps}
    states: dict[int, list[tuple[Track, ObjectState]]] = {
        time_ns: [] for time_ns in label_set.timestamps_ns if time_ns in sweep_times
    }
    between: list[int] = []
    shapeless: dict[str, int] = {}
    for track in label_set.tracks:
        for state in track.states:
            if state.timestamp_ns not in sweep_times:
                between.append(state.timestamp_ns)
            elif not isinstance(state.shape, kinds):
                kind = KINDS[type(state.shape).__name__]
                shapeless[kind] = shapeless.get(kind, 0) + 1
            else:
                states.setdefault(state.timestamp_ns, []).append((track, state))
    lost = [f"{count} states that are {kind}: the format has none" for kind, count in shapeless.items()]
    if between:
        lost.append(f"{len(between)} states at {len(set(between))} times at which there is no sweep")
    return dict(sorted(states.items())), lost


def box_state(
    recording: Recording,
    timestamp_ns: int,
    lidar_from_object: RigidTransform,
    size_m: NDArray[np.float64],
    *,
    category: str | None = None,
    unclear: bool = False,
) -> ObjectState:
    """A box that a tool labelled in the frame of the lidar; its velocity is unknown."""
    shape = Cuboid(vehicle_from_object=recording.vehicle_from_lidar @ lidar_from_object, size_m=size_m)
    velocity_mps = np.full(3, np.nan)
    return ObjectState(
        timestamp_ns=timestamp_ns, shape=shape, velocity_mps=velocity_mps, category=category, unclear=unclear
    )


def lidar_from_object(cuboid: Cuboid, recording: Recording) -> RigidTransform:
    """Pose of a box's centre in the frame of the lidar, at the sweep's reference time."""
    return recording.vehicle_from_lidar.inverse() @ cuboid.vehicle_from_object


def motion_lost(tracks: Sequence[Track]) -> list[str]:
    """Lines for what a format that holds boxes and classes only has no place for."""
    states = [state for track in tracks for state in track.states]
    counts = {
        "kinds of motion (category)": sum(state.category is not None for state in states),
        "marks of unclear objects": sum(state.unclear for state in states),
        "velocities": sum(bool(np.isfinite(state.velocity_mps).all()) for state in states),
        "yaw rates": sum(bool(state.yaw_rate_radps) for state in states),
        "numbers in truth images (instance_id)": sum(track.instance_id is not None for track in tracks),
    }
    return [f"{count} {what}: no field for them" for what, count in counts.items() if count]


NEIGHBOUR_M = 0.5  # points nearer than this belong together; people who walk abreast stay apart
FASTEST_MPS = 30.0  # from one sweep to the next that shows an object, beyond what the motion so far predicts
LONGEST_UNSEEN_NS = 600_000_000  # or one and a half times from sweep to sweep: some annotate once a second
SECOND_NS = 1_000_000_000


def near_groups(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Euclidean clustering: points that a chain of steps under half a metre joins are one group.

    Args:
        points: (N, 3), m.

    Returns:
        (N,) int64, number of the group of each point, from 0 on.
    """
    if not len(points):
        return np.empty(0, dtype=np.int64)
    first, second = KDTree(points).query_pairs(NEIGHBOUR_M, output_type="ndarray").T
    near = coo_array((np.ones(len(first), dtype=bool), (first, second)), shape=(len(points), len(points)))
    return connected_components(near, directed=False)[1].astype(np.int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroupedSweep:
    """The groups of one sweep.

    Attributes:
        timestamp_ns: of the sweep.
        middles_m: (K, 3) float64, m, world frame, mean of the points of each group; NaN where unknown.
    """

    timestamp_ns: int
    middles_m: NDArray[np.float64]


def linked_groups(sweeps: Sequence[GroupedSweep]) -> tuple[tuple[int, ...], ...]:
    """Number the groups so that one object keeps its number from sweep to sweep.

    Groups are paired with where the objects so far should be, all at once with the smallest sum of distances; what is
    further away than anything goes in that time is a new object.

    Args:
        sweeps: by increasing time.

    Returns:
        For each sweep the object of each of its groups, from 0 on.
    """
    followed: dict[int, _LastSeen] = {}
    steps_ns = np.diff([sweep.timestamp_ns for sweep in sweeps])
    unseen_ns = max(LONGEST_UNSEEN_NS, 1.5 * float(np.median(steps_ns)) if len(steps_ns) else 0.0)
    count = 0
    numbers = []
    for sweep in sweeps:
        followed = {i: o for i, o in followed.items() if sweep.timestamp_ns - o.seen_ns <= unseen_ns}
        predicted = np.array([one.predicted(sweep.timestamp_ns) for one in followed.values()]).reshape(-1, 3)
        gaps_s = np.array([sweep.timestamp_ns - one.seen_ns for one in followed.values()]) / SECOND_NS
        numbers_followed, found = list(followed), dict(_pairs(sweep.middles_m, predicted, FASTEST_MPS * gaps_s))
        row = []
        for group, middle in enumerate(sweep.middles_m):
            if group in found:
                number = numbers_followed[found[group]]
                followed[number] = followed[number].moved(middle, sweep.timestamp_ns)
            else:
                number, count = count, count + 1
                followed[number] = _LastSeen(seen_ns=sweep.timestamp_ns, place_m=middle, velocity_mps=np.zeros(3))
            row.append(number)
        numbers.append(tuple(row))
    return tuple(numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LastSeen:
    """An object where it was last seen."""

    seen_ns: int
    place_m: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]

    def predicted(self, timestamp_ns: int) -> NDArray[np.float64]:
        return np.asarray(self.place_m + self.velocity_mps * (timestamp_ns - self.seen_ns) / SECOND_NS)

    def moved(self, place_m: NDArray[np.float64], timestamp_ns: int) -> _LastSeen:
        velocity = (place_m - self.place_m) * SECOND_NS / (timestamp_ns - self.seen_ns)
        return _LastSeen(seen_ns=timestamp_ns, place_m=place_m, velocity_mps=velocity)


def _pairs(
    middles_m: NDArray[np.float64], predicted_m: NDArray[np.float64], reach_m: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """(group, object) of all pairs within the object's reach, (K,), with the smallest sum of distances."""
    away_m = np.nan_to_num(cdist(middles_m, predicted_m), nan=np.inf)
    near = away_m < reach_m
    # Pairs that are too far cost the same, so that they do not push near ones apart.
    rows, columns = linear_sum_assignment(np.where(near, away_m, reach_m.max(initial=0.0)))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if near[r, c]]


WINDOW_NS = SECOND_NS  # the visible side of an object changes: shorter windows give its jitter, not its motion


def middle_velocities(times_ns: NDArray[np.int64], middles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocity at each time: the slope of a straight line through the middles half a second before and after.

    Where they are further apart than that, it goes through the neighbours.

    Args:
        times_ns: (N,) int64, increasing; mean time of the points.
        middles_m: (N, 3) float64, m, world frame; NaN where unknown.

    Returns:
        (N, 3) float64, m/s, world axes; NaN where fewer than two middles are known within the window.
    """
    velocities = np.full(middles_m.shape, np.nan)
    known = np.flatnonzero(np.isfinite(middles_m).all(axis=1))
    known_ns = times_ns[known]
    half_ns = max(WINDOW_NS // 2, int(np.median(np.diff(known_ns)))) if len(known) > 1 else WINDOW_NS // 2
    first = np.searchsorted(known_ns, times_ns - half_ns, side="left")
    last = np.searchsorted(known_ns, times_ns + half_ns, side="right")
    for row in np.flatnonzero(last - first >= 2):
        used = known[first[row] : last[row]]
        seconds = (times_ns[used] - times_ns[row]) / SECOND_NS
        away = seconds - seconds.mean()
        velocities[row] = away @ middles_m[used] / (away @ away)
    return velocities


FLOATING_M = 0.5  # from the road to the bottom of the middle box; more is another convention or another calibration


def floating(tracks: Sequence[Track], reason: str) -> list[str]:
    """A line where boxes are not on the road, as happens when the file has another convention.

    Args:
        tracks: objects, vehicle frame.
        reason: what it may be, beside another mounting of the lidar.
    """
    bottoms_m = [
        state.shape.vehicle_from_object.translation_m[2] - state.shape.size_m[2] / 2.0
        for track in tracks
        for state in track.states
        if isinstance(state.shape, Cuboid)
    ]
    height_m = float(np.median(bottoms_m)) if bottoms_m else 0.0
    if abs(height_m) <= FLOATING_M:
        return []
    side = "above" if height_m > 0 else "below"
    return [
        f"check the heights: the median box is {abs(height_m):.2f} m {side} the road; {reason}, "
        f"or the lidar's mounting is wrong"
    ]

"""The motion of labelled objects: velocities from places, and objects without ids followed from time to time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from bench.egomotion import Trajectory
from bench.recordings import Cuboid, GroundPolygon, ObjectState
from bench.records.recording import world_velocities, world_yaw_rates
from bench.times import SECOND_NS

Floats = NDArray[np.float64]
LONGEST_GAP_NS = SECOND_NS  # an object that was out of sight for longer says nothing of its speed
WINDOW_NS = SECOND_NS  # the visible side of an object changes: shorter windows give its jitter, not its motion
FASTEST_MPS = {"pedestrian": 5.0, "cyclist": 15.0, "animal": 15.0, "vehicle": 30.0, "unclear": 30.0}
JITTER_M = 1.0  # of the middle of what is seen


def centre(state: ObjectState) -> Floats:
    """Middle of a box or outline, (3,) m, vehicle frame."""
    if isinstance(state.shape, Cuboid):
        return state.shape.vehicle_from_object.translation_m
    assert isinstance(state.shape, GroundPolygon)
    return np.array([*state.shape.outline_m.mean(axis=0), (state.shape.bottom_m + state.shape.top_m) / 2.0])


def with_motion(states: Sequence[ObjectState], trajectory: Trajectory) -> list[ObjectState]:
    """States with velocities and yaw rates where they have none, from their places in the world.

    States keep what they have where they have a velocity, where there is no ego-motion, and where an object is seen
    once in a second; outlines give no yaw rate, and points named one by one neither.

    Args:
        states: of one object, by time.
        trajectory: of the ego vehicle.
    """
    moved = list(states)
    runs: list[list[int]] = []
    for i, state in enumerate(states):
        if isinstance(state.shape, Cuboid | GroundPolygon):
            if not runs or state.timestamp_ns - states[runs[-1][-1]].timestamp_ns > LONGEST_GAP_NS:
                runs.append([])
            runs[-1].append(i)
    for run in (run for run in runs if len(run) > 1):
        for i, state in zip(run, _moved([states[i] for i in run], trajectory), strict=True):
            moved[i] = state
    return moved


def _moved(states: Sequence[ObjectState], trajectory: Trajectory) -> list[ObjectState]:
    times_ns = np.array([state.timestamp_ns for state in states], dtype=np.int64)
    rotations, positions_m, valid = trajectory.at(times_ns)
    world_m = np.einsum("nij,nj->ni", rotations, np.stack([centre(state) for state in states])) + positions_m
    velocities = np.full_like(world_m, np.nan)
    if valid.sum() > 1:
        world_mps = world_velocities(times_ns[valid], world_m[valid])
        velocities[valid] = np.einsum("nji,nj->ni", rotations[valid], world_mps)
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


def middle_velocities(times_ns: NDArray[np.int64], middles_m: Floats) -> Floats:
    """Velocity at each time: the slope of a straight line through the middles half a second before and after.

    Args:
        times_ns: (N,) int64, increasing; mean time of the points.
        middles_m: (N, 3) float64, m, world frame; NaN where unknown.

    Returns:
        (N, 3) float64, m/s, world axes; NaN where fewer than two middles are known within the window.
    """
    velocities = np.full(middles_m.shape, np.nan)
    known = np.flatnonzero(np.isfinite(middles_m).all(axis=1))
    known_ns = times_ns[known]
    first = np.searchsorted(known_ns, times_ns - WINDOW_NS // 2, side="left")
    last = np.searchsorted(known_ns, times_ns + WINDOW_NS // 2, side="right")
    for row in np.flatnonzero(last - first >= 2):
        used = known[first[row] : last[row]]
        seconds = (times_ns[used] - times_ns[row]) / SECOND_NS
        away = seconds - seconds.mean()
        velocities[row] = away @ middles_m[used] / (away @ away)
    return velocities


def followed(times_ns: Sequence[int], places_m: Sequence[Floats], *, fastest_mps: float) -> list[list[int]]:
    """Number objects without ids so that one keeps its number from time to time.

    They are paired with where the objects so far should be, all at once with the smallest sum of distances. What is
    further away than the fastest could have gone since is a new object.

    Args:
        times_ns: increasing, each time once.
        places_m: of the objects at each time, (K, 3), m, world frame; NaN where unknown.
        fastest_mps: how fast such an object may be.

    Returns:
        For each time the number of each of its objects, from 0 on.
    """
    known: dict[int, tuple[int, Floats, Floats]] = {}  # when and where each was last seen, and how fast it was
    count = 0
    numbers: list[list[int]] = []
    for time_ns, places in zip(times_ns, places_m, strict=True):
        known = {number: last for number, last in known.items() if time_ns - last[0] <= LONGEST_GAP_NS}
        gaps_s = np.array([(time_ns - seen_ns) / SECOND_NS for seen_ns, _, _ in known.values()])
        last_m, last_mps = (np.array([last[i] for last in known.values()]).reshape(-1, 3) for i in (1, 2))
        away = cdist(places, last_m + last_mps * gaps_s[:, None]) / (JITTER_M + fastest_mps * gaps_s)
        away = np.minimum(np.nan_to_num(away, nan=1.0), 1.0)  # what is too far costs the same, and pushes nothing apart
        pairs = {int(a): int(b) for a, b in zip(*linear_sum_assignment(away), strict=True) if away[a, b] < 1.0}
        names, row = list(known), []
        for i, place_m in enumerate(places):
            number, velocity_mps = count, np.zeros(3)
            if (pair := pairs.get(i)) is not None:
                number, velocity_mps = names[pair], (place_m - last_m[pair]) / gaps_s[pair]
            count += number == count
            known[number] = time_ns, place_m, velocity_mps
            row.append(number)
        numbers.append(row)
    return numbers

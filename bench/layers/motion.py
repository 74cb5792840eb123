"""How imported objects move over the ground, for tools that tell no velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import Trajectory
from bench.recordings import Cuboid, GroundPolygon, ObjectState, Track
from bench.recordings.object_motion import world_velocities, world_yaw_rates

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
    turns = _turns(states, rotations, times_ns, valid)
    return [
        replace(state, velocity_mps=velocities[i], yaw_rate_radps=state.yaw_rate_radps or float(turns[i]))
        if np.isnan(state.velocity_mps).any() and valid[i]
        else state
        for i, state in enumerate(states)
    ]


def _turns(
    states: Sequence[ObjectState],
    rotations: NDArray[np.float64],
    times_ns: NDArray[np.int64],
    valid: NDArray[np.bool_],
) -> NDArray[np.float64]:
    turns = np.array([state.yaw_rate_radps for state in states])
    boxes = np.array([isinstance(state.shape, Cuboid) for state in states]) & valid
    if boxes.sum() > 1:
        headings = np.stack(
            [state.shape.vehicle_from_object.rotation for state in states if isinstance(state.shape, Cuboid)]
        )
        kept = np.array([valid[i] for i, state in enumerate(states) if isinstance(state.shape, Cuboid)])
        turns[boxes] = world_yaw_rates(times_ns[boxes], rotations[boxes] @ headings[kept])
    return turns


def _centre(state: ObjectState) -> NDArray[np.float64]:
    if isinstance(state.shape, Cuboid):
        return state.shape.vehicle_from_object.translation_m
    assert isinstance(state.shape, GroundPolygon)
    middle = state.shape.outline_m.mean(axis=0)
    return np.array([*middle, (state.shape.bottom_m + state.shape.top_m) / 2.0])

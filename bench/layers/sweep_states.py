"""States of tracks, sorted by the sweeps at whose time they stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.geometry import RigidTransform
from bench.layers.layer import Layer
from bench.recordings import Cuboid, ObjectShape, ObjectState, Recording, Track

KINDS = {"Cuboid": "boxes", "GroundPolygon": "ground outlines", "PointIndices": "objects given by their points"}


def states_at_sweeps(
    layer: Layer, recording: Recording, kinds: tuple[type[ObjectShape], ...]
) -> tuple[dict[int, list[tuple[Track, ObjectState]]], list[str]]:
    """What a tool that labels sweeps can hold of a layer.

    Args:
        layer: the annotations.
        recording: what they belong to.
        kinds: shapes that the format has.

    Returns:
        states: sweep's time -> objects at that time; also annotated sweeps without objects.
        lost: one line for states between sweeps, one for each kind of shape that the format does not have.
    """
    sweep_times = {sweep.timestamp_ns for sweep in recording.sweeps}
    states: dict[int, list[tuple[Track, ObjectState]]] = {
        time_ns: [] for time_ns in layer.timestamps_ns if time_ns in sweep_times
    }
    between: list[int] = []
    shapeless: dict[str, int] = {}
    for track in layer.tracks:
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
    return [f"{count} {what}: no place for them" for what, count in counts.items() if count]

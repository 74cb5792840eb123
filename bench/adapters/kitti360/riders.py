"""A rider and what they ride on: two boxes in KITTI-360, one cyclist here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.records.recording import Cuboid, ObjectState, Track

RIDERS, RIDDEN = frozenset({"rider"}), frozenset({"bicycle", "motorcycle"})
TOGETHER = 0.5  # share of the frames in which both are seen; a rider passes a parked bicycle in few
CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def joined_riders(tracks: Sequence[Track], kinds: Mapping[str, str]) -> tuple[Track, ...]:
    """Make one track of each rider and the bicycle or motorcycle below them.

    They belong together where, in half of the frames or more that have both, the middle of one box lies within the
    outline of the other, seen from above; of several pairs the nearest. The box is the one around both, along the axes
    of what is ridden; where only one of them is seen, it is that one's. Motion is that of what is ridden, or of the
    rider where the former is unclear.

    Args:
        tracks: objects of one drive.
        kinds: track -> name of its label.

    Returns:
        All tracks, a pair in the place of the rider.
    """
    riders = [track for track in tracks if kinds.get(track.track_id) in RIDERS]
    ridden = [track for track in tracks if kinds.get(track.track_id) in RIDDEN]
    pairs = [(away, a.track_id, b) for a in riders for b in ridden if (away := _apart_m(a, b)) is not None]
    below: dict[str, Track] = {}
    taken: set[str] = set()
    for _, rider, mount in sorted(pairs, key=lambda pair: pair[0]):
        if rider not in below and mount.track_id not in taken:
            below[rider] = mount
            taken.add(mount.track_id)
    return tuple(
        _joined(track, below[track.track_id]) if track.track_id in below else track
        for track in tracks
        if track.track_id not in taken
    )


def _apart_m(rider: Track, mount: Track) -> float | None:
    """Median distance from above of a pair that belongs together; None for one that does not."""
    states = {state.timestamp_ns: state for state in mount.states}
    both = [(state, states[state.timestamp_ns]) for state in rider.states if state.timestamp_ns in states]
    within = [pair for pair in both if _is_within(*pair) or _is_within(*reversed(pair))]
    if not both or len(within) < TOGETHER * len(both):
        return None
    return float(np.median([np.hypot(*(_box(a)[0] - _box(b)[0])[:2]) for a, b in within]))


def _is_within(inner: ObjectState, outer: ObjectState) -> bool:
    """Return True where the middle of one box is in the outline of another, seen from above."""
    centre_m, rotation, size_m = _box(outer)
    along = rotation.T @ (_box(inner)[0] - centre_m)
    return bool((np.abs(along[:2]) <= size_m[:2] / 2).all())


def _box(state: ObjectState) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    assert isinstance(state.shape, Cuboid)
    pose = state.shape.vehicle_from_object
    return pose.translation_m, pose.rotation, state.shape.size_m


def _joined(rider: Track, mount: Track) -> Track:
    alone = {state.timestamp_ns: state for state in rider.states}
    states = dict(alone)
    for state in mount.states:
        other = alone.get(state.timestamp_ns)
        states[state.timestamp_ns] = state if other is None else _around_both(state, other)
    in_time = tuple(states[time_ns] for time_ns in sorted(states))
    return replace(rider, track_id=f"{rider.track_id}+{mount.track_id}", states=in_time)


def _around_both(mount: ObjectState, rider: ObjectState) -> ObjectState:
    centre_m, rotation, size_m = _box(mount)
    rider_m, rider_rotation, rider_size_m = _box(rider)
    corners_m = (rider_m + (CORNERS * rider_size_m) @ rider_rotation.T - centre_m) @ rotation
    low, high = np.minimum(corners_m.min(axis=0), -size_m / 2), np.maximum(corners_m.max(axis=0), size_m / 2)
    middle_m = centre_m + rotation @ ((low + high) / 2)
    clear = (state for state in (mount, rider) if not state.unclear and np.isfinite(state.velocity_mps).all())
    clearest = next(clear, mount)
    return replace(
        mount,
        shape=Cuboid(vehicle_from_object=RigidTransform(rotation, middle_m), size_m=high - low),
        velocity_mps=clearest.velocity_mps,
        yaw_rate_radps=clearest.yaw_rate_radps,
        unclear=mount.unclear and rider.unclear,
    )

"""Which annotated objects are due at an exposure, and how they move there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.recordings.records import ObjectState, Recording, Track
from bench.reference.motion import TrackMotion, track_motion
from bench.reference.records import ReferenceSettings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighting:
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
    velocity_world_mps: NDArray[np.float64]
    smooth_world_mps: NDArray[np.float64]
    moving: bool


class SightingIndex:
    """Finds the objects of an exposure among all annotations of a recording, in time order or not.

    Args:
        recording: the drive.
        settings: of the protocol.
    """

    def __init__(self, recording: Recording, settings: ReferenceSettings) -> None:
        self._recording, self._settings = recording, settings
        rows = [(s.timestamp_ns, t, i) for t, track in enumerate(recording.tracks) for i, s in enumerate(track.states)]
        self._rows = np.array(sorted(rows), dtype=np.int64).reshape(-1, 3)
        self._motions: dict[int, TrackMotion] = {}

    def at(self, exposure_ns: int) -> list[Sighting]:
        """Every track's state nearest to the exposure, where one is within the protocol's gap."""
        gap_ns = self._settings.max_annotation_gap_ns
        first = np.searchsorted(self._rows[:, 0], exposure_ns - gap_ns, side="left")
        last = np.searchsorted(self._rows[:, 0], exposure_ns + gap_ns, side="right")
        nearest: dict[int, tuple[int, int]] = {}
        for time_ns, number, index in self._rows[first:last].tolist():
            wait_ns = abs(time_ns - exposure_ns)
            if number not in nearest or wait_ns < nearest[number][0]:
                nearest[number] = wait_ns, index
        chosen = [(self._recording.tracks[number], number, index) for number, (_, index) in sorted(nearest.items())]
        times_ns = {track.states[index].timestamp_ns for track, _, index in chosen}
        poses = {time_ns: self._recording.trajectory.world_from_vehicle(time_ns) for time_ns in times_ns}
        return [self._sighting(track, number, index, poses) for track, number, index in chosen]

    def _sighting(self, track: Track, number: int, index: int, poses: Mapping[int, RigidTransform]) -> Sighting:
        if number not in self._motions:
            self._motions[number] = track_motion(track, self._recording.trajectory, self._settings.motion)
        motion = self._motions[number]
        return Sighting(
            track=track,
            state=track.states[index],
            world_from_vehicle=poses[track.states[index].timestamp_ns],
            velocity_world_mps=motion.velocity_world_mps[index],
            smooth_world_mps=motion.smooth_world_mps[index],
            moving=bool(motion.moving[index]),
        )

"""The same recording with less motion compensation between lidar and camera, to see what the compensation is worth."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.recordings import ObjectState, Recording, Track
from bench.reference import Category


class Compensation(StrEnum):
    """What of the motion between a lidar point and the exposure is undone."""

    NONE = "none"  # the sweep is taken for a snapshot at exposure
    EGO_MOTION = "ego_motion"  # every point is freed of the host's motion
    FULL = "full"  # and moved with its object: what the benchmark does


def with_compensation(recording: Recording, compensation: Compensation) -> Recording:
    """A recording whose reference is built with that much compensation and nothing else changed.

    The reference builder takes ego-motion and the objects' velocities from the recording: without the one the host
    stands, without the other the objects do. Every object of a changed recording is annotated as moving, since
    velocities no longer tell; who is evaluated is decided by the unchanged one.
    """
    if compensation is Compensation.FULL:
        return recording
    tracks = tuple(_standing(track) for track in recording.tracks)
    if compensation is Compensation.EGO_MOTION:
        return replace(recording, tracks=tracks)
    return replace(recording, tracks=tracks, trajectory=_standing_host(recording.trajectory))


def _standing(track: Track) -> Track:
    return replace(track, states=tuple(_without_motion(state) for state in track.states))


def _without_motion(state: ObjectState) -> ObjectState:
    category = Category.CROSSING.value if state.category is None else state.category
    return replace(state, velocity_mps=np.zeros(3), yaw_rate_radps=0.0, category=category)


def _standing_host(driven: Trajectory) -> Trajectory:
    ends_ns = driven.timestamps_ns[[0, -1]]
    return Trajectory(
        source=driven.source,
        timestamps_ns=ends_ns,
        rotations=Rotation.identity(2),
        positions_m=np.zeros((2, 3)),
        max_gap_ns=int(ends_ns[1] - ends_ns[0]),
        max_extrapolation_ns=driven.max_extrapolation_ns,
    )

"""From reviews to annotations, and label files on disk."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import count
from os.path import lexists
from pathlib import Path

import numpy as np

from bench.annotation.decisions import ReviewedTrack, applied, rotated
from bench.annotation.store import Review
from bench.atomic import write_bytes
from bench.errors import DataError, OutputError
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, ObjectState, Recording, Track
from bench.records.recording import world_yaw_rates


def to_tracks(review: Review, recording: Recording, *, unreviewed: bool = False) -> tuple[Track, ...]:
    """Tracks of a recording from its review.

    Args:
        review: of the recording.
        recording: for its ego-motion.
        unreviewed: take what was proposed and not rejected, and mark it as not reviewed, instead of what was accepted.

    Returns:
        Tracks with boxes in the vehicle frame at each time, level in the world, and velocities over the ground along
        the vehicle's axes.

    Raises:
        DataError: a time without ego-motion.
        UsageError: decisions that cannot be carried out.
    """
    wanted = {"open", "accepted"} if unreviewed else {"accepted"}
    tracks = [track for track in applied(review).values() if track.status in wanted]
    return tuple(to_track(track, recording, reviewed=not unreviewed) for track in tracks)


def refuse_unfinished(review: Review, recording: Recording, file: Path) -> None:
    """Refuse a review that leaves something open.

    Raises:
        DataError: tracks without a decision, or sweeps that were not watched.
    """
    hint = "finish it with `fisheye-bench annotate review`, or take --unreviewed"
    undecided = [track.id for track in applied(review).values() if track.status == "open"]
    if undecided:
        got = f"{len(undecided)} without one, the first {undecided[0]}"
        raise DataError(file, field="decisions", expected="a decision on each track", got=got, hint=hint)
    watched_ns = set(review.watched_ns)
    unseen = sum(sweep.timestamp_ns not in watched_ns for sweep in recording.sweeps)
    if unseen:
        got = f"{unseen} of {len(recording.sweeps)} sweeps that nobody watched"
        raise DataError(file, field="watched_ns", expected="a drive that was watched to its end", got=got, hint=hint)


def to_track(track: ReviewedTrack, recording: Recording, *, reviewed: bool) -> Track:
    """One track of a recording; see `to_tracks`.

    Raises:
        DataError: a time without ego-motion.
    """
    motion = track.motion
    rotations, positions_m, valid = recording.trajectory.at(motion.times_ns)
    if not valid.all():
        recording.trajectory.world_from_vehicle(int(motion.times_ns[~valid][0]))  # raises, with what is there
    vehicle_from_world = rotations.swapaxes(1, 2)
    axes = np.stack([rotated(np.tile(axis, (len(motion), 1)), motion.yaws_rad) for axis in np.eye(3)], axis=2)
    centres_m = np.einsum("nij,nj->ni", vehicle_from_world, motion.centres_m - positions_m)
    velocities = np.einsum("nij,nj->ni", vehicle_from_world[:, :, :2], motion.velocities_mps)
    poses = RigidTransform.each(vehicle_from_world @ axes, centres_m)
    return Track(
        track_id=track.id,
        object_class=track.object_class,
        states=tuple(
            ObjectState(
                timestamp_ns=int(time_ns),
                shape=Cuboid(vehicle_from_object=pose, size_m=track.size_m),
                velocity_mps=velocity,
                yaw_rate_radps=float(rate),
                category=track.category,
                unclear=track.unclear,
            )
            for time_ns, pose, velocity, rate in zip(
                motion.times_ns, poses, velocities, world_yaw_rates(motion.times_ns, axes), strict=True
            )
        ),
        reviewed=reviewed,
    )


def store_labels(folder: Path, files: Mapping[str, bytes], *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write label files, all or none.

    Args:
        folder: of the files; made where it is not there.
        files: name -> content.
        overwrite: replace also files of another content, and keep a copy of each, `<name>.1` and on.

    Returns:
        The copies.

    Raises:
        OutputError: a file of another content is in the way, or one cannot be written.
    """
    others = [name for name in files if (folder / name).is_file() and (folder / name).read_bytes() != files[name]]
    if others and not overwrite:
        hint = "give another folder; or --overwrite, which keeps a copy of them"
        raise OutputError(folder / others[0], got="other labels that are there", hint=hint)
    copies = []
    for name in others:
        copies.append(next(path for i in count(1) if not lexists(path := folder / f"{name}.{i}")))
        write_bytes(copies[-1], (folder / name).read_bytes())
    for name, content in files.items():
        write_bytes(folder / name, content)
    return tuple(copies)

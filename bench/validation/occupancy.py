"""Boxes and outlines without a point in them, although beams go through, or with their points just outside.

A box that is hidden or far away has no points for a good reason. One that beams pass through, to meet something behind
it, is empty: its object is elsewhere, or not there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.recordings import Cuboid, ObjectState, PointIndices, Recording, Track
from bench.reference.clusters import object_cluster
from bench.reference.sweeps import PosedSweep, pose_sweep
from bench.validation.findings import Finding, Severity, annotation_file, object_field
from bench.validation.motion import box_of

NEAR_NS = 60_000_000  # of a state to a sweep
FAR_M = 60.0
SLACK_M = 0.25  # around the box in which points are looked for
CORE = 0.6  # of the box's sizes that beams have to pass through
LEAST_BEAMS = 12
LEAST_POINTS = 10  # just outside of a box that is too tight; as many the protocols ask for inside
TIGHT = 0.1  # of those, as many as may be inside
OUTSIDE_M = 0.1  # how far outside of the box points count as the object's
MOST_TIGHT = 0.1  # of the states of an object that are looked at
MOST_EMPTY = 0.5  # of the states of an object that are looked at
LEAST_STATES = 3
MOST_BOXES = 200  # looked at in a sweep, 2 ms each
SECOND_NS = 1_000_000_000


@dataclass(slots=True)
class _Tally:
    tried: int = 0
    looked: int = 0
    empty: int = 0
    points: int = 0
    first_ns: int | None = None
    mirrored: int = 0
    tight_ns: list[int] = field(default_factory=list)
    in_tight: int = 0
    beams: int = 0
    wrong_indices: list[tuple[int, str]] = field(default_factory=list)


class Occupancy:
    """Takes sweeps in turn and counts for every object the states whose box is empty.

    In sweeps with more boxes than `MOST_BOXES` those are looked at that were looked at least so far.

    Args:
        recording: the drive.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._tallies = {track.track_id: _Tally() for track in recording.tracks}
        self._times_ns = {
            track.track_id: np.array([s.timestamp_ns for s in track.states], dtype=np.int64)
            for track in recording.tracks
        }
        self._left_out = 0

    def add(self, sweep: LidarSweep) -> None:
        """Look at the states near a sweep."""
        placed = pose_sweep(sweep, self._recording.trajectory, self._recording.vehicle_from_lidar)
        if placed is None:
            return
        boxes = []
        for track in self._recording.tracks:
            times_ns = self._times_ns[track.track_id]
            if not len(times_ns):
                continue
            nearest = int(np.argmin(np.abs(times_ns - sweep.timestamp_ns)))
            if abs(int(times_ns[nearest]) - sweep.timestamp_ns) > NEAR_NS:
                continue
            state = track.states[nearest]
            if isinstance(state.shape, PointIndices):
                self._look_at_indices(self._tallies[track.track_id], state.shape, sweep)
            elif not state.unclear:
                boxes.append((self._tallies[track.track_id], state))
        self._left_out += max(len(boxes) - MOST_BOXES, 0)
        for tally, state in sorted(boxes, key=lambda box: box[0].tried)[:MOST_BOXES]:
            tally.tried += 1
            self._look_at(tally, state, placed)

    def findings(self) -> Iterator[Finding]:
        """Findings about empty boxes, object by object."""
        file = annotation_file(self._recording)
        if self._left_out:
            yield Finding(check="crowded-boxes", severity=Severity.WARNING, file=file, field="cuboid",
                          expected=f"at most {MOST_BOXES} boxes in a sweep",
                          got=f"more; in {self._left_out} boxes no points were looked for",
                          hint="fix the reported ones, then validate again", times=self._left_out)  # fmt: skip
        sweeps_ns = {sweep.timestamp_ns for sweep in self._recording.sweeps}
        for track in self._recording.tracks:
            yield from _unknown_sweeps(track, sweeps_ns, file)
            tally = self._tallies[track.track_id]
            if tally.wrong_indices:
                time_ns, got = tally.wrong_indices[0]
                yield Finding(check="point-indices", file=file, field=f"object {track.track_id!r}",
                              expected="rows of the sweep, each once", got=got,
                              times=len(tally.wrong_indices), timestamp_ns=time_ns)  # fmt: skip
            if tally.empty and tally.empty > MOST_EMPTY * tally.looked:
                never = tally.points == 0
                sure = never and tally.looked >= min(LEAST_STATES, len(track.states))
                yield Finding(
                    check="empty-box",
                    severity=Severity.ERROR if sure else Severity.WARNING,
                    file=file,
                    field=object_field(track),
                    expected="lidar points in the box where beams pass through it",
                    got=f"none in {tally.empty} of {tally.looked} sweeps, with {tally.beams} beams through it",
                    hint="the lidar's y has the wrong sign? Mirrored, points would fill the box (y is left)"
                    if tally.mirrored > tally.empty / 2
                    else "the box is elsewhere than its object, or at another time",
                    times=tally.empty,
                    timestamp_ns=tally.first_ns,
                )
            elif len(tally.tight_ns) > MOST_TIGHT * tally.looked:
                few = f"at most {tally.in_tight}" if tally.in_tight else "0"
                yield Finding(
                    check="tight-box",
                    severity=Severity.WARNING,
                    file=file,
                    field=object_field(track),
                    expected=f"{LEAST_POINTS} lidar points in the box, below which the protocols ignore an object",
                    got=f"{few} points in {len(tally.tight_ns)} of {tally.looked} sweeps that see it, and more within "
                    f"{100 * OUTSIDE_M:.0f} cm outside",
                    hint="the box is too tight (leave some centimetres around the object), or at another time",
                    times=len(tally.tight_ns),
                    timestamp_ns=tally.tight_ns[0],
                )

    def _look_at(self, tally: _Tally, state: ObjectState, placed: PosedSweep) -> None:
        box = box_of(state.shape)
        if box is None or float(np.hypot(*box.vehicle_from_object.translation_m[:2])) > FAR_M:
            return
        rotations, positions_m, valid = self._recording.trajectory.at(np.array([state.timestamp_ns], dtype=np.int64))
        if not valid[0]:
            return
        world_from_vehicle = RigidTransform(rotations[0], positions_m[0])
        velocity_world = np.nan_to_num(world_from_vehicle.rotation @ state.velocity_mps)
        inside = object_cluster(
            placed,
            replace(state, shape=replace(box, size_m=box.size_m + 2 * SLACK_M)),
            velocity_world_mps=velocity_world,
            world_from_vehicle=world_from_vehicle,
            exposure_ns=state.timestamp_ns,
        )
        placed_points = (world_from_vehicle @ box.vehicle_from_object).inverse().apply(inside.points_world)
        outside_m = np.max(np.abs(placed_points) - box.size_m / 2, axis=1)
        outside_m = outside_m[placed_points[:, 2] > 0.1 - box.size_m[2] / 2]  # what lies lower is the road's
        points = len(outside_m)
        beams = 0 if points else _beams_through(box, state, placed, world_from_vehicle, velocity_world)
        if not points and beams < LEAST_BEAMS:
            return
        tally.looked += 1
        tally.points += points
        in_box, just_outside = int((outside_m <= 0.0).sum()), int(((outside_m > 0.0) & (outside_m < OUTSIDE_M)).sum())
        if just_outside >= LEAST_POINTS and in_box <= TIGHT * just_outside:
            tally.tight_ns.append(state.timestamp_ns)
            tally.in_tight = max(tally.in_tight, in_box)
        if not points:
            tally.empty += 1
            tally.mirrored += _points_if_mirrored(box, placed.sweep, self._recording) >= LEAST_POINTS
            tally.beams += beams
            tally.first_ns = state.timestamp_ns if tally.first_ns is None else tally.first_ns

    @staticmethod
    def _look_at_indices(tally: _Tally, shape: PointIndices, sweep: LidarSweep) -> None:
        if shape.sweep_timestamp_ns != sweep.timestamp_ns or not len(shape.indices):
            return
        largest, points = int(shape.indices.max()), len(sweep.points_lidar)
        if largest >= points or int(shape.indices.min()) < 0:
            tally.wrong_indices.append((sweep.timestamp_ns, f"row {largest} of a sweep of {points} points"))
        elif len(np.unique(shape.indices)) < len(shape.indices):
            tally.wrong_indices.append((sweep.timestamp_ns, "rows named twice"))


def _points_if_mirrored(box: Cuboid, sweep: LidarSweep, recording: Recording) -> int:
    """Points in the box, roughly, if the lidar's y pointed to the other side."""
    points = recording.vehicle_from_lidar.apply(sweep.points_lidar * np.array([1.0, -1.0, 1.0]))
    away_m = np.abs(box.vehicle_from_object.inverse().apply(points)) - box.size_m / 2
    away_m[:, 2] += 2 * SLACK_M  # neither the road nor what hangs above
    return int((away_m < SLACK_M).all(axis=1).sum())


def _unknown_sweeps(track: Track, sweeps_ns: set[int], file: str) -> Iterator[Finding]:
    lost = [
        state.timestamp_ns
        for state in track.states
        if isinstance(state.shape, PointIndices) and state.shape.sweep_timestamp_ns not in sweeps_ns
    ]
    if lost:
        yield Finding(check="point-indices", file=file, field=f"object {track.track_id!r}",
                      expected="the time of a sweep of the recording", got=f"{len(lost)} states without such a sweep",
                      times=len(lost), timestamp_ns=lost[0])  # fmt: skip


def _beams_through(
    box: Cuboid,
    state: ObjectState,
    placed: PosedSweep,
    world_from_vehicle: RigidTransform,
    velocity_world_mps: NDArray[np.float64],
) -> int:
    """Beams that cross the core of the box and end behind it; each at its own time."""
    object_from_world = (world_from_vehicle @ box.vehicle_from_object).inverse()
    centre = world_from_vehicle.apply(box.vehicle_from_object.translation_m)
    middle = len(placed.interpolation_ns) // 2
    lidar_world = placed.positions_m[middle]
    towards = placed.rotations[middle].T @ (centre - lidar_world)
    points = placed.sweep.points_lidar
    bearing = np.arctan2(points[:, 1], points[:, 0]) - np.arctan2(towards[1], towards[0])
    half = np.arctan2(float(np.linalg.norm(box.size_m)), max(float(np.hypot(*towards[:2])), 0.1)) + 0.1
    rows = np.flatnonzero(np.abs((bearing + np.pi) % (2 * np.pi) - np.pi) < half)
    if not len(rows):
        return 0
    times_ns = placed.times_ns[rows]
    shift = velocity_world_mps * ((state.timestamp_ns - times_ns) / SECOND_NS)[:, None]
    ends = object_from_world.apply(placed.points_world(rows) + shift)
    positions = placed.positions_m[
        np.clip(np.searchsorted(placed.interpolation_ns, times_ns), 0, len(placed.interpolation_ns) - 1)
    ]
    starts = object_from_world.apply(positions + shift)
    half_m = CORE * box.size_m / 2
    along = ends - starts
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half_m - starts) / along, (half_m - starts) / along
    enter = np.fmin(one, other).max(axis=1)
    leave = np.fmax(one, other).min(axis=1)
    return int(((enter > 0) & (enter < leave) & (leave < 1.0)).sum())

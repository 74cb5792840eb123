"""Decisions applied to proposals, the geometry of what reviewers change, and what of it becomes annotations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import LineString, Polygon, box
from shapely.ops import split

from bench.annotation import store
from bench.errors import DataError, UsageError
from bench.geometry import RigidTransform
from bench.plain_text import counted
from bench.recordings import Cuboid, ObjectState, Recording, Track
from bench.records.recording import world_yaw_rates
from bench.records.reference import ObjectClass

Floats = NDArray[np.float64]

Status = Literal["open", "accepted", "rejected"]
STATUS_AFTER: dict[str, Status] = {"accept": "accepted", "reject": "rejected", "reopen": "open"}

USUAL_STEP_NS = 100_000_000  # between states, where a track has only one
LARGEST_GAP_NS = 2_000_000_000  # that merging fills; a longer one stays open
HOLE = 1.5  # usual steps between two states, from which on one is missing
FAR_M = 1000.0  # a line through a box is drawn out to both sides by this


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Places of a box over time, world frame.

    Attributes:
        times_ns: (N,) int64, increasing.
        rows: (N, 6) float64, x, y and z of the centre, m, heading, rad, continuous, and velocity along x and y over the
            ground, m/s.
    """

    times_ns: NDArray[np.int64]
    rows: Floats

    def __len__(self) -> int:
        return len(self.times_ns)

    @property
    def centres_m(self) -> Floats:
        """(N, 3) float64, m."""
        return self.rows[:, :3]

    @property
    def yaws_rad(self) -> Floats:
        """(N,) float64."""
        return self.rows[:, 3]

    @property
    def velocities_mps(self) -> Floats:
        """(N, 2) float64, m/s."""
        return self.rows[:, 4:]

    def where(self, chosen: NDArray[np.bool_]) -> Motion:
        """The states that are chosen, (N,) bool."""
        return Motion(times_ns=self.times_ns[chosen], rows=self.rows[chosen])

    def at(self, times_ns: NDArray[np.int64]) -> Motion:
        """Interpolated at other times; beyond the ends the first and last velocity carries on."""
        seconds, known_s = self._seconds(times_ns), self._seconds(self.times_ns)
        outside_s = seconds - np.clip(seconds, known_s[0], known_s[-1])
        rows = _interpolated(seconds, known_s, self.rows)
        rows[:, :2] += outside_s[:, None] * rows[:, 4:]
        return Motion(times_ns=times_ns, rows=rows)

    def moved(self, offsets_m: Floats, turns_rad: Floats | float = 0.0) -> Motion:
        """Each box moved in its own axes, (N, 3) m, and turned, (N,) rad; velocities follow the change."""
        shift, rows = rotated(offsets_m, self.yaws_rad), self.rows.copy()
        rows[:, :3] += shift
        rows[:, 3] += turns_rad
        if len(self) > 1:
            rows[:, 4:] += np.gradient(shift[:, :2], self._seconds(self.times_ns), axis=0)
        return Motion(times_ns=self.times_ns, rows=rows)

    def _seconds(self, times_ns: NDArray[np.int64]) -> Floats:
        return np.asarray((times_ns - self.times_ns[0]) / 1e9)

    @property
    def step_ns(self) -> int:
        """Usual time between two states."""
        return int(np.median(np.diff(self.times_ns))) if len(self) > 1 else USUAL_STEP_NS

    def holes(self, step_ns: int) -> list[tuple[int, int]]:
        """The last time before each hole and the first time after it; states are usually a step apart."""
        rows = np.flatnonzero(np.diff(self.times_ns) > HOLE * step_ns)
        return [(int(self.times_ns[row]), int(self.times_ns[row + 1])) for row in rows]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReviewedTrack:
    """One object as it stands after all decisions.

    Attributes:
        id: unique in the review.
        status: what was decided of it.
        object_class: one of `OBJECT_CLASSES`.
        category: kind of motion where a reviewer named it, else None.
        unclear: it is ignored when scored.
        size_m: (3,) float64, full length, width and height, m.
        proposed_doubts: reasons to look twice, of those who proposed it.
        points_median: returns in its box.
        uncorrected: where it is without key frames; splits and merges begin anew from where it is with them.
        keys: key frames by time.
    """

    id: str
    status: Status
    object_class: ObjectClass
    category: str | None
    unclear: bool
    size_m: Floats
    proposed_doubts: tuple[store.Doubt, ...]
    points_median: float
    uncorrected: Motion
    keys: Mapping[int, store.SetBox]

    @property
    def motion(self) -> Motion:
        """Where it is, key frames applied."""
        return _corrected(self.uncorrected, self.keys)

    @property
    def doubts(self) -> tuple[store.Doubt, ...]:
        """Reasons to look twice: holes in the track as it stands, which a reviewer can fill, go first."""
        step_ns = self.uncorrected.step_ns
        missing = [round((end - start) / step_ns) - 1 for start, end in self.uncorrected.holes(step_ns)]
        if not missing:
            return self.proposed_doubts
        count = max(sum(missing), 1)
        reason = f"{'hole' if len(missing) == 1 else counted(len(missing), 'hole')} of {counted(count, 'sweep')}"
        return (store.Doubt(reason=reason, value=count), *self.proposed_doubts)


State = dict[str, ReviewedTrack]  # by id, in the order in which they came up


def applied(review: store.Review) -> State:
    """Return all tracks as they stand after all decisions in force; merged ones are gone, rejected ones are there.

    Raises:
        UsageError: a decision about a track that does not exist then, or one that cannot be carried out.
    """
    return reduce(after, history(review.decisions)[0], opening(review))


def opening(review: store.Review) -> State:
    """The tracks before the first decision."""
    return {track.id: undecided(track) for track in review.tracks}


def history(decisions: Iterable[store.Decision]) -> tuple[tuple[store.Decision, ...], tuple[store.Decision, ...]]:
    """The decisions in force, and those that a redo would make again, the next one last.

    Raises:
        UsageError: an undo or redo where there is nothing to take back or to make again.
    """
    made: list[store.Decision] = []
    taken_back: list[store.Decision] = []
    for decision in decisions:
        if isinstance(decision, store.Undo | store.Redo):
            source, target = (made, taken_back) if isinstance(decision, store.Undo) else (taken_back, made)
            if not source:
                raise UsageError(f"{decision.action}: expected a decision to {decision.action}, got none")
            target.append(source.pop())
        else:
            made.append(decision)
            taken_back.clear()
    return tuple(made), tuple(taken_back)


def after(state: State, decision: store.Decision) -> State:
    """The tracks after one more decision, which is neither an undo nor a redo.

    Raises:
        UsageError: as `applied`.
    """
    match decision:
        case store.Judge():
            return _each(state, decision.tracks, lambda track: replace(track, status=STATUS_AFTER[decision.action]))
        case store.SetClass():
            return _each(state, decision.tracks, lambda track: replace(track, object_class=decision.object_class))
        case store.SetUnclear():
            return _each(state, decision.tracks, lambda track: replace(track, unclear=decision.unclear))
        case store.SetCategory():
            return _each(state, decision.tracks, lambda track: replace(track, category=decision.category))
        case store.Merge():
            return _merged(state, decision)
        case store.SplitTime():
            return _split_in_time(state, decision)
        case store.SplitSpace():
            return _split_in_space(state, decision)
        case store.SetBox():
            return _each(state, (decision.track,), lambda track: _with_key(track, decision))
        case store.Draw():
            return _drawn(state, decision)
    raise AssertionError(decision)


def rotated(vectors: Floats, yaws_rad: Floats) -> Floats:
    """Vectors turned about the z axis: (N, 3) and (N,) -> (N, 3)."""
    cos, sin = np.cos(yaws_rad), np.sin(yaws_rad)
    x, y, z = vectors.T
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)


def _interpolated(seconds: Floats, known_s: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(seconds, known_s, column) for column in values.T], axis=1)


def undecided(track: store.StoredTrack) -> ReviewedTrack:
    """A track of a file before any decision."""
    rows = np.array([(*state.centre_m, state.yaw_rad, *state.velocity_mps) for state in track.states], dtype=np.float64)
    rows[:, 3] = np.unwrap(rows[:, 3])
    times_ns = np.array([state.timestamp_ns for state in track.states], dtype=np.int64)
    return ReviewedTrack(
        id=track.id,
        status="open",
        object_class=track.object_class,
        category=track.category,
        unclear=track.unclear,
        size_m=np.array(track.size_m),
        proposed_doubts=track.doubts,
        points_median=track.points_median,
        uncorrected=Motion(times_ns=times_ns, rows=rows),
        keys={},
    )


def _get(state: State, track_id: str) -> ReviewedTrack:
    if track_id not in state:
        raise UsageError(f"track {track_id!r}: expected one of the {len(state)} tracks, got none of this name")
    return state[track_id]


def _each(state: State, ids: Iterable[str], change: Callable[[ReviewedTrack], ReviewedTrack]) -> State:
    return {**state, **{track_id: change(_get(state, track_id)) for track_id in ids}}


def _free_id(state: State, track_id: str) -> str:
    return next(name for i in range(1, len(state) + 2) if (name := f"{track_id}.{i}") not in state)


def _drawn(state: State, decision: store.Draw) -> State:
    if decision.drawn.id in state:
        raise UsageError(f"track {decision.drawn.id!r}: expected a new name, got one that exists")
    return {**state, decision.drawn.id: replace(undecided(decision.drawn), status="accepted")}


def _with_key(track: ReviewedTrack, key: store.SetBox) -> ReviewedTrack:
    keys = dict(sorted({**track.keys, key.timestamp_ns: key}.items()))
    uncorrected = _reaching(track.uncorrected, key.timestamp_ns)
    return replace(track, keys=keys, uncorrected=uncorrected, size_m=np.array(key.size_m))


def _reaching(motion: Motion, time_ns: int) -> Motion:
    """The same motion with a state at a time and, up to 2 s from there, without the hole around it.

    Before its beginning and behind its end it is carried on to there.
    """
    first, last = int(motion.times_ns[0]), int(motion.times_ns[-1])
    if abs(time_ns - np.clip(time_ns, first, last)) > LARGEST_GAP_NS:
        raise UsageError(f"key frame at {time_ns}: expected at most 2 s before or after the track, {first} to {last}")
    later = int(np.searchsorted(motion.times_ns, time_ns))
    beside = motion.times_ns[max(later - 1, 0) : later + 1].tolist()
    gaps = [(min(near_ns, time_ns), max(near_ns, time_ns)) for near_ns in beside]
    reached = _filled(np.append(motion.times_ns, time_ns), gaps, motion.step_ns)
    return motion if len(reached) == len(motion) else motion.at(reached)


def _filled(times_ns: NDArray[np.int64], gaps: Sequence[tuple[int, int]], step_ns: int) -> NDArray[np.int64]:
    """The times, and others about a step apart in gaps of at most 2 s."""
    between = [
        np.linspace(start, end, round((end - start) / step_ns) + 1).round().astype(np.int64)[1:-1]
        for start, end in gaps
        if end - start <= LARGEST_GAP_NS
    ]
    return np.unique(np.concatenate([times_ns, *between]))


def _corrected(uncorrected: Motion, keys: Mapping[int, store.SetBox]) -> Motion:
    """The motion led through key frames: each gives a correction in the box's own axes, linear in between."""
    if not keys:
        return uncorrected
    key_times = np.array(list(keys), dtype=np.int64)
    at_keys = uncorrected.at(key_times)
    offsets_m = rotated(np.array([key.centre_m for key in keys.values()]) - at_keys.centres_m, -at_keys.yaws_rad)
    turns_rad = np.array([key.yaw_rad for key in keys.values()]) - at_keys.yaws_rad
    turns_rad = np.unwrap((turns_rad + np.pi) % (2 * np.pi) - np.pi)
    seconds, known_s = (uncorrected.times_ns - key_times[0]) / 1e9, (key_times - key_times[0]) / 1e9
    corrections = _interpolated(seconds, known_s, np.column_stack([offsets_m, turns_rad]))
    return uncorrected.moved(corrections[:, :3], corrections[:, 3])


def _split_in_time(state: State, decision: store.SplitTime) -> State:
    track = _get(state, decision.track)
    early = track.motion.times_ns < decision.timestamp_ns
    if early.all() or not early.any():
        raise UsageError(f"track {track.id!r}: expected a time within it, got {decision.timestamp_ns}")
    other = _free_id(state, track.id)
    return {
        **state,
        track.id: replace(track, uncorrected=track.motion.where(early), keys={}),
        other: replace(track, id=other, uncorrected=track.motion.where(~early), keys={}),
    }


def _split_in_space(state: State, decision: store.SplitSpace) -> State:
    track = _get(state, decision.track)
    length, width, _ = track.size_m
    at = track.motion.at(np.array([decision.timestamp_ns], dtype=np.int64))
    ends = np.column_stack([np.array(decision.line_m) - at.centres_m[0, :2], [0.0, 0.0]])
    (a, b) = rotated(ends, np.repeat(-at.yaws_rad, 2))[:, :2]
    along = b - a
    norm = float(np.linalg.norm(along))
    outline = box(-length / 2, -width / 2, length / 2, width / 2)
    if norm > 0:
        line = LineString([a - along / norm * FAR_M, b + along / norm * FAR_M])
        parts = [part for part in split(outline, line).geoms if isinstance(part, Polygon)]
    if norm == 0 or len(parts) != 2:
        raise UsageError(f"track {track.id!r}: expected a line that crosses its box, got one beside it")
    first, second = sorted(parts, key=lambda part: -part.area)
    other = _free_id(state, track.id)
    return {**state, track.id: _part(track, first), other: replace(_part(track, second), id=other)}


def _part(track: ReviewedTrack, part: Polygon) -> ReviewedTrack:
    low_x, low_y, high_x, high_y = part.bounds
    half_m = track.size_m[2] / 2
    return _resized(track, np.array([low_x, low_y, -half_m]), np.array([high_x, high_y, half_m]))


def _resized(track: ReviewedTrack, low: Floats, high: Floats) -> ReviewedTrack:
    """The box between two corners in its own axes, (3,) m each."""
    motion = track.motion.moved(np.tile((low + high) / 2, (len(track.motion), 1)))
    return replace(track, uncorrected=motion, keys={}, size_m=high - low)


def _merged(state: State, decision: store.Merge) -> State:
    first, *others = (_get(state, track_id) for track_id in dict.fromkeys(decision.tracks))
    if not others:
        raise UsageError(f"merge: expected two tracks, got {first.id!r} twice")
    for other in others:
        first = _joined(first, other)
    gone = {other.id for other in others}
    return {track_id: track for track_id, track in {**state, first.id: first}.items() if track_id not in gone}


def _joined(a: ReviewedTrack, b: ReviewedTrack) -> ReviewedTrack:
    """One box around both where they are seen together, and it through the times of each."""
    common, of_a, of_b = np.intersect1d(a.motion.times_ns, b.motion.times_ns, return_indices=True)
    if len(common):
        yaws = a.motion.yaws_rad[of_a]
        between = np.median(rotated(b.motion.centres_m[of_b] - a.motion.centres_m[of_a], -yaws), axis=0)
        half_a, half_b = a.size_m / 2, _half_seen_from(b, of_b, yaws)
        low, high = np.minimum(-half_a, between - half_b), np.maximum(half_a, between + half_b)
    else:
        between = np.zeros(3)
        high = np.maximum(a.size_m, b.size_m) / 2
        low = -high
    grown_a, grown_b = _resized(a, low, high), _resized(b, low - between, high - between)
    alone = ~np.isin(grown_b.motion.times_ns, grown_a.motion.times_ns)
    return replace(
        grown_a,
        uncorrected=_in_one(grown_a.motion, grown_b.motion.where(alone)),
        points_median=max(a.points_median, b.points_median),
    )


def _half_seen_from(track: ReviewedTrack, rows: NDArray[np.intp], yaws_rad: Floats) -> Floats:
    """Half the extents of a box in axes of other headings, the median over the times."""
    turn = track.motion.yaws_rad[rows] - yaws_rad
    cos, sin = float(np.median(np.abs(np.cos(turn)))), float(np.median(np.abs(np.sin(turn))))
    length, width, height = track.size_m / 2
    return np.array([length * cos + width * sin, length * sin + width * cos, height])


def _in_one(a: Motion, b: Motion) -> Motion:
    """The states of both by time; gaps of at most 2 s are filled at the usual step."""
    times_ns, rows = np.concatenate([a.times_ns, b.times_ns]), np.concatenate([a.rows, b.rows])
    order = np.argsort(times_ns)
    rows = rows[order]
    rows[:, 3] = np.unwrap(rows[:, 3])
    together = Motion(times_ns=times_ns[order], rows=rows)
    step_ns = min(a.step_ns, b.step_ns) if len(b) > 1 else a.step_ns
    return together.at(_filled(together.times_ns, together.holes(step_ns), step_ns))


def to_tracks(review: store.Review, recording: Recording, *, unreviewed: bool = False) -> tuple[Track, ...]:
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


def refuse_unfinished(review: store.Review, recording: Recording, file: Path) -> None:
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

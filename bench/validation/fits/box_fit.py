"""Boxes against lidar returns: boxes that are empty, too tight, elsewhere, in another frame or at another time.

Mistakes are tried over all boxes of the drive: where the share of returns inside (`box_returns`) rises clearly for most
objects if all boxes are read in another way, that mistake is named. What only one object has is reported for it. And
returns that move without a box: what the drive itself shows to be missing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar.sweep import LidarSweep
from bench.plain_text import counted
from bench.recordings import Cuboid, PointIndices, Recording, Track
from bench.records.recording import NOT_ANNOTATED, world_velocities
from bench.reference.silhouette import left_out_ground
from bench.times import SECOND_NS
from bench.validation.findings import Finding, Severity, box_of, new_finding, object_field
from bench.validation.fits.box_returns import MARGINS_M, Beams, Boxes, Near, returns_held
from bench.validation.fits.readings import BoxChange, Reading, box_readings

if TYPE_CHECKING:
    from bench.annotation.store import BoxState, StoredTrack

Array = NDArray[np.float64]

NEAR_NS = 60_000_000  # of a state to a sweep
FAR_M = 40.0
SLACK_M = 0.25  # around the box in which points are looked for
LEAST_RETURNS = 40  # of an object in all its sweeps
LEAST_BEAMS = 12
LEAST_POINTS = 10  # just outside of a box that is too tight; as many the protocols ask for inside
TIGHT = 0.1  # of those, as many as may be inside
OUTSIDE_M = 0.1  # how far outside of the box points count as the object's
MOST_TIGHT = 0.1  # of the states of an object that are looked at
MOST_EMPTY = 0.5  # of the states of an object that are looked at
LEAST_STATES = 3
ALL_TIGHT, HELD = 0.9, 0.98  # shares of the returns within the largest margin: too few inside, and enough
MOST_TRIED = 6  # boxes of a sweep in every reading, 20 ms each

LATE_MS = np.arange(-200, 201, 10)
GROWN_M = np.arange(1, 8) / 10  # each of length, width and height
QUARTER_M = 0.25
STEPS_M = np.arange(-4, 5) * QUARTER_M
SHIFTS_M = np.stack(np.meshgrid(STEPS_M, STEPS_M, indexing="ij"), axis=-1).reshape(-1, 2)
CLEARLY, FITS = 0.15, 0.6  # how much more of the returns another reading holds, and how many
SLIGHTLY = 0.05  # so much more tells of centimetres and milliseconds
AS_WELL = 0.02  # a share that differs by less is no difference
LEAST_LATE_MS = 20
# Rows of an object's counts: as stated, at other times, larger, shifted, then in the readings.
_ENDS = 1 + np.cumsum([0, len(LATE_MS), 3 * len(GROWN_M), len(SHIFTS_M)])
LATE, GROWN, SHIFTED = (slice(int(first), int(last)) for first, last in itertools.pairwise(_ENDS))
READ = int(_ENDS[-1])


@dataclass(slots=True, kw_only=True)
class _Tally:
    """An object, with its motion by its own positions (stated velocities may be wrong), and its counts in all sweeps.

    Attributes:
        track: the object, of N states.
        times_ns: (N,) int64.
        boxes: N, vehicle frame; None for point indices, where it is unclear, and without ego-motion.
        over_ground_mps: (N, 3), world axes; 0 where unknown.
        relative_mps: (N, 3), of the box in the vehicle frame, as the vehicle moves, too; 0 where unknown.
        counts: (readings, 3), see `Near.counts`.
        held: (11,), see `returns_held`.
        tried: sweeps near it.
        looked: those in which it is seen, or should be.
        empty_ns: times of those without a return in the box.
        beams: through the empty boxes.
        points: returns in the boxes.
        tight_ns: times at which returns lie just outside.
        in_tight: returns inside then, at most.
        wrong_indices: times at which its point indices name no points, and why.
    """

    track: Track
    times_ns: NDArray[np.int64]
    boxes: tuple[Cuboid | None, ...]
    over_ground_mps: Array
    relative_mps: Array
    counts: Array
    held: Array = field(default_factory=lambda: np.zeros(len(MARGINS_M)))
    tried: int = 0
    looked: int = 0
    empty_ns: list[int] = field(default_factory=list)
    beams: int = 0
    points: int = 0
    tight_ns: list[int] = field(default_factory=list)
    in_tight: int = 0
    wrong_indices: list[tuple[int, str]] = field(default_factory=list)


class BoxFit:
    """Takes sweeps in turn, and counts returns in and around the boxes near them, in every reading.

    In every reading are those of a sweep looked at that were looked at least so far.

    Args:
        recording: the drive.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._readings = tuple(box_readings(recording))
        self._tallies = [_tally(track, recording, READ + len(self._readings)) for track in recording.tracks]

    def add(self, sweep: LidarSweep) -> None:
        """Look at the states near a sweep."""
        try:
            beams = Beams(sweep, self._recording)
        except LookupError:
            return
        near = []
        for tally in self._tallies:
            away_ns = np.abs(tally.times_ns - sweep.timestamp_ns)
            if not len(away_ns) or away_ns.min() > NEAR_NS:
                continue
            i = int(np.argmin(away_ns))
            box, shape = tally.boxes[i], tally.track.states[i].shape
            if isinstance(shape, PointIndices):
                _look_at_indices(tally, shape, sweep)
            elif box is not None and float(np.hypot(*box.vehicle_from_object.translation_m[:2])) < FAR_M:
                near.append((tally, i, box))
        near.sort(key=lambda entry: entry[0].tried)
        for number, (tally, i, box) in enumerate(near):
            self._look_at(tally, i, box, beams, in_every_reading=number < MOST_TRIED)

    def _look_at(self, tally: _Tally, i: int, box: Cuboid, beams: Beams, *, in_every_reading: bool) -> None:
        tally.tried += 1
        time_ns = int(tally.times_ns[i])
        world_from_vehicle = self._recording.trajectory.world_from_vehicle(time_ns)

        def near(place: Cuboid, reach_m: float) -> Near:
            return beams.near(
                place,
                time_ns=time_ns,
                vehicle_from_world=world_from_vehicle.inverse(),
                velocity_mps=tally.over_ground_mps[i],
                reach_m=reach_m,
            )

        relative, opaque = tally.relative_mps[i], tally.track.object_class == "vehicle"
        reach_m = min(0.8 + max(float(box.size_m.max()) / 2, 0.2 * float(np.linalg.norm(relative))), 4.0)
        around = near(box, reach_m)
        _look_inside(tally, box, around, time_ns)
        if in_every_reading:
            read = [reading.undo(box, world_from_vehicle) for reading in self._readings]
            beside = [other for other, reading in zip(read, self._readings, strict=True) if not reading.elsewhere]
            counts = [around.counts(_tried(box, relative, beside), opaque=opaque)]
            counts += [near(other, 0.5).counts(Boxes.of([other]), opaque=opaque) for other in read[len(beside) :]]
            tally.counts += np.concatenate(counts)

    def findings(self) -> Iterator[Finding]:
        """Findings about all boxes, else object by object."""
        sweeps_ns = {sweep.timestamp_ns for sweep in self._recording.sweeps}
        for tally in self._tallies:
            yield from _index_findings(tally, sweeps_ns)
        of_all = self._of_all()
        tight = list(tight_boxes(np.array([tally.held for tally in self._tallies]).reshape(-1, len(MARGINS_M))))
        if of_all is not None and not (tight and "sizes" in str(of_all.field)):  # centimetres come before a factor
            yield of_all
            return
        yield from tight
        for tally in self._tallies:
            finding = self._of_one(tally)
            if finding is not None and not (tight and finding.check in {"box-place", "tight-box"}):
                yield finding

    def _of_all(self) -> Finding | None:
        """The mistake that fits all boxes best, with all that fit as well."""
        counts = np.array([tally.counts for tally in self._tallies]).reshape(-1, READ + len(self._readings), 3)
        shares = _share(counts)
        held = counts[:, :, 0]
        told = np.maximum(held, held[:, :1]) >= LEAST_RETURNS  # by objects that neither finds, nothing is told
        objects = told.sum(axis=0)
        share, stated = ((values * told).sum(axis=0) / np.maximum(objects, 1) for values in (shares, shares[:, :1]))
        gains, better = share - stated, (shares - shares[:, :1] > SLIGHTLY) & told
        fits = (share > FITS) & (gains > SLIGHTLY) & (better.sum(axis=0) > objects / 2)
        read = np.where(fits & (gains > CLEARLY), share, 0.0)[READ:]
        mistakes = [
            *([(float(read.max()), _read_finding(self._readings[int(np.argmax(read))]))] if read.any() else []),
            *_late(share[LATE], fits[LATE]),
            *_grown(share[GROWN], fits[GROWN]),
        ]
        if not mistakes:
            return None
        best, first = max(mistakes, key=lambda mistake: mistake[0])
        others = [other for as_good, other in mistakes if other is not first and as_good > best - AS_WELL]
        row = int(np.argmax(np.where(fits, share, 0.0)))
        count = counted(int(objects[row]), "object")
        return replace(
            first,
            got=f"{stated[row]:.0%} of the points around {count} inside; {best:.0%} {first.got}"
            + "".join(f"; as many {other.got}" for other in others),
            hint="; or ".join([first.hint, *(other.hint for other in others)]),
            times=int(objects[row]),
        )

    def _of_one(self, tally: _Tally) -> Finding | None:
        counts, usual = tally.counts, _empty_or_tight(tally)
        if max(counts[0, 0], counts[0, 2]) < LEAST_RETURNS:  # a hidden one may have its neighbour's returns around it
            return usual
        share = _share(counts)
        shifted, read = share[SHIFTED], share[READ:][[not reading.elsewhere for reading in self._readings]]
        now = f"{share[0]:.0%} of the points around it inside"
        if read.max() - max(share[0], shifted.max()) > CLEARLY and read.max() > FITS:
            told = _read_finding(self._readings[int(np.argmax(read))])
            return replace(told, field=object_field(tally.track), got=f"{now}; {read.max():.0%} {told.got}")
        fitting = SHIFTS_M[shifted > shifted.max() - AS_WELL]
        shift_m = fitting[np.argmin(np.abs(fitting).sum(axis=1))]
        least_m = QUARTER_M if usual is not None and usual.check == "tight-box" else 0.0
        if shifted.max() - max(share[0], FITS - CLEARLY) > CLEARLY and np.abs(shift_m).max() > least_m:
            got = f"{now}; {shifted.max():.0%} if it were {' and '.join(_ways(shift_m))}"
            return new_finding("box-place", got, field=object_field(tally.track))
        return usual


def _tally(track: Track, recording: Recording, rows: int) -> _Tally:
    """An object that was not looked at yet, for so many rows of counts."""
    times_ns = np.array([state.timestamp_ns for state in track.states], dtype=np.int64)
    rotations, positions_m, valid = recording.trajectory.at(times_ns)
    known = valid & ~np.array([state.unclear for state in track.states], dtype=bool)
    boxes = tuple(box_of(state.shape) if good else None for state, good in zip(track.states, known, strict=True))
    centres_m = np.full((len(boxes), 3), np.nan)
    for row, box in enumerate(boxes):
        if box is not None:
            centres_m[row] = box.vehicle_from_object.translation_m
    places_m = np.einsum("nij,nj->ni", rotations, centres_m) + positions_m
    over_ground, relative = (np.nan_to_num(world_velocities(times_ns, places)) for places in (places_m, centres_m))
    counts = np.zeros((rows, 3))
    return _Tally(
        track=track, times_ns=times_ns, boxes=boxes, over_ground_mps=over_ground, relative_mps=relative, counts=counts
    )


def _tried(box: Cuboid, relative_mps: NDArray[np.floating], read: list[Cuboid]) -> Boxes:
    """The box as stated, at other times, larger, shifted, and in the readings near its place."""
    pose = box.vehicle_from_object
    along, grown = np.zeros((READ, 3)), np.zeros((READ, 3))
    along[LATE] = LATE_MS[:, None] / 1000 * relative_mps
    along[SHIFTED] = SHIFTS_M @ pose.rotation[:, :2].T
    grown[GROWN] = (np.eye(3)[:, None] * GROWN_M[:, None]).reshape(-1, 3)
    others = Boxes.of(read)
    return Boxes(
        rotations=np.concatenate([np.repeat(pose.rotation[None], READ, axis=0), others.rotations]),
        centres_m=np.concatenate([pose.translation_m + along, others.centres_m]),
        sizes_m=np.concatenate([box.size_m + grown, others.sizes_m]),
    )


def _share(counts: Array) -> Array:
    return np.asarray(counts[..., 0] / np.maximum(counts.sum(axis=-1), 1.0))


def _ways(shift_m: Array) -> Iterator[str]:
    for way_m, forth, back in zip(shift_m, ("ahead", "to its left"), ("behind", "to its right"), strict=True):
        if way_m:
            yield f"{abs(way_m):.2f} m farther {forth if way_m > 0 else back}"


def _late(share: Array, fits: NDArray[np.bool_]) -> Iterator[tuple[float, Finding]]:
    """Lateness of all boxes with its interval: all that fits about as well."""
    fitting = LATE_MS[share > share.max() - AS_WELL]
    low, high = int(fitting[0]), int(fitting[-1])
    if not fits.any() or (low < LEAST_LATE_MS and high > -LEAST_LATE_MS):
        return
    middle, (least, most) = abs(low + high) // 2, sorted((abs(low), abs(high)))
    word, change, other = ("late", "subtract {} ms from", "early") if low > 0 else ("early", "add {} ms to", "late")
    got, change = f"if boxes are {middle} ms {word} ({least} to {most} ms)", change.format(middle)
    hint = (
        f"{change} the annotations' times, or take them from the sweep that was annotated; or the clock of the sweeps "
        f"is as much {other}, if images or ego-motion disagree with it alike"
    )
    yield float(share.max()), new_finding("box-time", got, field="timestamp", hint=hint)


def _grown(share: Array, fits: NDArray[np.bool_]) -> Iterator[tuple[float, Finding]]:
    """Length, width or height that lacks some."""
    sides = share.reshape(3, -1)
    side = int(np.argmax(sides.max(axis=1)))
    if not fits.any():
        return
    name, by_m = ("length", "width", "height")[side], GROWN_M[np.argmax(sides[side] > sides[side].max() - AS_WELL)]
    got, hint = f"if the {name} is too short by {by_m:.1f} m", f"add {by_m:.1f} m to the {name}"
    yield float(sides.max()), new_finding("box-short", got, field="cuboid, sizes", hint=hint)


def _read_finding(reading: Reading[BoxChange]) -> Finding:
    return new_finding("box-reading", f"as if {reading.description}", field=reading.field, hint=reading.hint)


def _look_inside(tally: _Tally, box: Cuboid, near: Near, time_ns: int) -> None:
    outside_m = near.depths_m(box)
    tally.held += returns_held(outside_m)
    points = int((outside_m < SLACK_M).sum())
    beams = 0 if points else int(near.counts(Boxes.of([box]), opaque=True)[0, 2])
    if not points and beams < LEAST_BEAMS:
        return
    tally.looked += 1
    tally.points += points
    in_box, just_outside = int((outside_m <= 0.0).sum()), int(((outside_m > 0.0) & (outside_m < OUTSIDE_M)).sum())
    if just_outside >= LEAST_POINTS and in_box <= TIGHT * just_outside:
        tally.tight_ns.append(time_ns)
        tally.in_tight = max(tally.in_tight, in_box)
    if not points:
        tally.empty_ns.append(time_ns)
        tally.beams += beams


def _empty_or_tight(tally: _Tally) -> Finding | None:
    field, times = object_field(tally.track), len(tally.tight_ns)
    if len(tally.empty_ns) > MOST_EMPTY * tally.looked:
        sure = tally.points == 0 and tally.looked >= min(LEAST_STATES, len(tally.track.states))
        severity = Severity.ERROR if sure else Severity.WARNING
        got = f"none in {len(tally.empty_ns)} of {tally.looked} sweeps, with {tally.beams} beams through it"
        return new_finding("empty-box", got, field=field, severity=severity, at_ns=tally.empty_ns)
    if times > MOST_TIGHT * tally.looked:
        got = f"{f'at most {tally.in_tight}' if tally.in_tight else '0'} points in {times} of {tally.looked} sweeps "
        got += f"that see it, and more within {100 * OUTSIDE_M:.0f} cm outside"
        return new_finding("tight-box", got, field=field, at_ns=tally.tight_ns, least=LEAST_POINTS)
    return None


def tight_boxes(held: Array) -> Iterator[Finding]:
    """The finding that boxes leave out returns of their objects by centimetres, with the margin that holds them.

    None where half of the objects have their returns inside, or where even the largest margin seems too small.

    Args:
        held: (objects, 11) float64, sums of `returns_held`.
    """
    told = held[held[:, -1] >= LEAST_RETURNS]
    shares = np.median(told / told[:, -1:], axis=0) if len(told) else np.ones(len(MARGINS_M))
    fitting = int(np.argmax(shares >= HELD))
    if shares[0] < ALL_TIGHT and fitting < len(MARGINS_M) - 1:
        margin_cm = round(100 * MARGINS_M[fitting])
        count = counted(len(told), "object")
        got = f"{shares[0]:.0%} of them inside, median of {count}; {shares[fitting]:.0%} with {margin_cm} cm more "
        got += "on each side"
        hint = f"make the boxes {2 * margin_cm} cm longer and wider and {margin_cm} cm higher, or score with "
        hint += f"shape_margin_m: {MARGINS_M[fitting]:.2f} or more (surface-v1 has 0.05)"
        widest_cm = 100 * MARGINS_M[-1]
        yield new_finding("tight-boxes", got, field="cuboid, sizes", hint=hint, times=len(told), margin_cm=widest_cm)


def _look_at_indices(tally: _Tally, shape: PointIndices, sweep: LidarSweep) -> None:
    if shape.sweep_timestamp_ns != sweep.timestamp_ns or not len(shape.indices):
        return
    largest, points = int(shape.indices.max()), sweep.rows_stored
    if largest >= points or int(shape.indices.min()) < 0:
        tally.wrong_indices.append((sweep.timestamp_ns, f"row {largest} of a sweep of {points} points"))
    elif len(np.unique(shape.indices)) < len(shape.indices):
        tally.wrong_indices.append((sweep.timestamp_ns, "rows named twice"))


def _index_findings(tally: _Tally, sweeps_ns: set[int]) -> Iterator[Finding]:
    lost = [
        (state.timestamp_ns, "a time at which there is no sweep")
        for state in tally.track.states
        if isinstance(state.shape, PointIndices) and state.shape.sweep_timestamp_ns not in sweeps_ns
    ]
    for wrong in filter(None, (lost, tally.wrong_indices)):
        (_, got), field = wrong[0], f"object {tally.track.track_id!r}"
        yield new_finding("point-indices", got, field=field, at_ns=[time_ns for time_ns, _ in wrong])


# ---------------------------------------------------------------- what has no box


SEARCHED = 40  # sweeps in the middle of the drive, 0.1 s each
SEARCHED_M = 15.0  # from the vehicle's origin; proposals further away are less sure
LEAST_MPS = 1.0  # median speed; a tree in the wind is slower
LEAST_WITHOUT = 8  # sweeps in which an object moves without a box
STATE_NS = 300_000_000  # of an annotated state to a sweep
AROUND_M = 1.0  # a box so far from an object is its own, if misplaced
HARMLESS = {"fragments joined", "seen from one end", "top not seen"}  # doubts about a box, not its being there


def check_unboxed(recording: Recording) -> Iterator[Finding]:
    """Objects that surely move and have no box in most sweeps."""
    if recording.annotated == NOT_ANNOTATED or not recording.sweeps:
        return
    from bench.annotation.proposals import propose  # compiled loops: most of a second, which other commands need not

    first = max((len(recording.sweeps) - SEARCHED) // 2, 0)
    proposals: tuple[StoredTrack, ...] = ()
    with suppress(DataError):  # reported by the check of the sweeps
        proposals = propose(replace(recording, sweeps=recording.sweeps[first : first + SEARCHED]))
    unboxed = []
    for track in proposals:
        moving = [state for state in track.states if _moves_near(state, recording)]
        without = [state for state in moving if not _has_box(state, track, recording)]
        if track.reasons <= HARMLESS and len(without) > max(LEAST_WITHOUT - 1, len(moving) / 2):
            unboxed.append((track, without))
    if unboxed:
        track, without = max(unboxed, key=lambda entry: len(entry[1]))
        more = f"; {counted(len(unboxed) - 1, 'more object')} like that" if len(unboxed) > 1 else ""
        got, at_ns = _described(track, without, recording) + more, [without[0].timestamp_ns]
        yield new_finding("object-without-box", got, field="objects", times=len(unboxed), at_ns=at_ns)


def _described(track: StoredTrack, without: Sequence[BoxState], recording: Recording) -> str:
    x, y, _ = _place_vehicle(without[len(without) // 2], recording)
    speed_mps = float(np.median([np.hypot(*state.velocity_mps) for state in without]))
    length_m, width_m, _ = track.size_m
    place = f"{abs(x):.0f} m {'ahead' if x > 0 else 'behind'}, {abs(y):.0f} m to the {'left' if y > 0 else 'right'}"
    size = f"{length_m:.1f} m x {width_m:.1f} m of returns that move at {speed_mps:.1f} m/s"
    return f"{size} without a box in {counted(len(without), 'sweep')} ({place})"


def _moves_near(state: BoxState, recording: Recording) -> bool:
    """An object moves nearby, when and where the recording is annotated."""
    place_m = _place_vehicle(state, recording)[:2]
    near = np.hypot(*state.velocity_mps) > LEAST_MPS and np.hypot(*place_m) < SEARCHED_M
    left_out = left_out_ground(recording.annotated)
    return bool(
        near and recording.annotated.covers(state.timestamp_ns) and not left_out.intersects(shapely.Point(place_m))
    )


def _has_box(proposed: BoxState, track: StoredTrack, recording: Recording) -> bool:
    """The middle of the object is in or near an annotated box, seen from above, moved to the time of the sweep."""
    for annotated in recording.tracks:
        state = annotated.state_near(proposed.timestamp_ns, within_ns=STATE_NS)
        if state is None:
            continue
        box = box_of(state.shape)
        if box is None:
            return True  # point indices: which object has them is not looked at
        seconds = (proposed.timestamp_ns - state.timestamp_ns) / SECOND_NS
        then_m = np.array(proposed.centre_m) - np.append(proposed.velocity_mps, 0.0) * seconds
        world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
        local = (world_from_vehicle @ box.vehicle_from_object).inverse().apply(then_m)
        if (np.abs(local[:2]) < np.maximum(box.size_m, min(track.size_m))[:2] / 2 + AROUND_M).all():
            return True
    return False


def _place_vehicle(state: BoxState, recording: Recording) -> NDArray[np.float64]:
    world_from_vehicle = recording.trajectory.world_from_vehicle(state.timestamp_ns)
    return world_from_vehicle.inverse().apply(np.array(state.centre_m))

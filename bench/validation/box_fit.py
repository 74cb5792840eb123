"""Boxes against lidar returns: boxes that are empty, too tight, elsewhere, in another frame or at another time.

Mistakes are tried over all boxes of the drive: where the share of returns inside (`box_returns`) rises clearly for most
objects if all boxes are read in another way, that mistake is named. What only one object has is reported for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.lidar import LidarSweep
from bench.recordings import Cuboid, PointIndices, Recording, Track
from bench.validation.box_returns import (
    LEAST_RETURNS,
    MARGINS_M,
    Beams,
    Boxes,
    BoxPath,
    Near,
    returns_held,
    tight_boxes,
)
from bench.validation.drive import annotation_file, object_field
from bench.validation.findings import Finding, Severity
from bench.validation.readings import Reading, readings

NEAR_NS = 60_000_000  # of a state to a sweep
FAR_M = 40.0
SLACK_M = 0.25  # around the box in which points are looked for
LEAST_BEAMS = 12
LEAST_POINTS = 10  # just outside of a box that is too tight; as many the protocols ask for inside
TIGHT = 0.1  # of those, as many as may be inside
OUTSIDE_M = 0.1  # how far outside of the box points count as the object's
MOST_TIGHT = 0.1  # of the states of an object that are looked at
MOST_EMPTY = 0.5  # of the states of an object that are looked at
LEAST_STATES = 3
MOST_BOXES = 200  # looked at in a sweep, 1 ms each
MOST_TRIED = 6  # of those in a sweep, in every reading, 20 ms each

LATE_MS = np.arange(-200, 201, 10)
GROWN_M = np.arange(1, 8) / 10  # each of length, width and height
QUARTER_M = 0.25
STEPS_M = np.arange(-4, 5) * QUARTER_M
SHIFTS_M = np.stack(np.meshgrid(STEPS_M, STEPS_M, indexing="ij"), axis=-1).reshape(-1, 2)
CLEARLY, FITS = 0.15, 0.6  # how much more of the returns another reading holds, and how many
SLIGHTLY = 0.05  # so much more tells of centimetres and milliseconds
AS_WELL = 0.02  # a share that differs by less is no difference
LEAST_LATE_MS = 20


@dataclass(slots=True)
class _Tally:
    """Counts of an object."""

    counts: NDArray[np.float64]  # (readings, 3)
    tried: int = 0
    looked: int = 0
    empty: int = 0
    points: int = 0
    first_ns: int | None = None
    tight_ns: list[int] = field(default_factory=list)
    in_tight: int = 0
    held: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(MARGINS_M)))
    beams: int = 0
    wrong_indices: list[tuple[int, str]] = field(default_factory=list)


class BoxFit:
    """Takes sweeps in turn, and counts returns in and around the boxes near them, in every reading.

    In sweeps with more boxes than `MOST_BOXES` those are looked at that were looked at least so far.

    Args:
        recording: the drive.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._paths = {track.track_id: BoxPath.of(track, recording) for track in recording.tracks}
        every = list(readings(recording))
        self._near = [reading for reading in every if not reading.elsewhere]
        self._elsewhere = [reading for reading in every if reading.elsewhere]
        lengths = len(LATE_MS), 3 * len(GROWN_M), len(SHIFTS_M), len(every)
        ends = 1 + np.cumsum(lengths)
        self._late, self._grown, self._shifted, self._read = (
            slice(end - length, end) for end, length in zip(ends, lengths, strict=True)
        )
        self._tallies = {track.track_id: _Tally(counts=np.zeros((ends[-1], 3))) for track in recording.tracks}
        self._left_out = 0

    def add(self, sweep: LidarSweep) -> None:
        """Look at the states near a sweep."""
        try:
            beams = Beams(sweep, self._recording)
        except LookupError:
            return
        near = []
        for track in self._recording.tracks:
            path, tally = self._paths[track.track_id], self._tallies[track.track_id]
            if not len(path.times_ns):
                continue
            i = int(np.argmin(np.abs(path.times_ns - sweep.timestamp_ns)))
            if abs(int(path.times_ns[i]) - sweep.timestamp_ns) > NEAR_NS:
                continue
            box, shape = path.boxes[i], track.states[i].shape
            if isinstance(shape, PointIndices):
                _look_at_indices(tally, shape, sweep)
            elif box is not None and float(np.hypot(*box.vehicle_from_object.translation_m[:2])) < FAR_M:
                near.append((track, i, box))
        self._left_out += max(len(near) - MOST_BOXES, 0)
        near.sort(key=lambda entry: self._tallies[entry[0].track_id].tried)
        for number, (track, i, box) in enumerate(near[:MOST_BOXES]):
            self._look_at(track, i, box, beams, in_every_reading=number < MOST_TRIED)

    def _look_at(self, track: Track, i: int, box: Cuboid, beams: Beams, *, in_every_reading: bool) -> None:
        path, tally = self._paths[track.track_id], self._tallies[track.track_id]
        tally.tried += 1
        relative = path.relative_mps[i]
        reach_m = min(0.8 + max(float(box.size_m.max()) / 2, 0.2 * float(np.linalg.norm(relative))), 4.0)
        time_ns, velocity = int(path.times_ns[i]), path.over_ground_mps[i]
        near = beams.near(box, time_ns=time_ns, velocity_mps=velocity, reach_m=reach_m)
        if near is None:
            return
        _look_inside(tally, box, near, time_ns)
        if not in_every_reading:
            return
        opaque = track.object_class == "vehicle"
        rotations, positions_m, _ = self._recording.trajectory.at(path.times_ns[i : i + 1])
        world_from_vehicle = RigidTransform(rotations[0], positions_m[0])
        counts = [near.counts(self._tried(box, relative, world_from_vehicle), opaque=opaque)]
        for reading in self._elsewhere:
            other = reading.change(box, world_from_vehicle)
            there = beams.near(other, time_ns=time_ns, velocity_mps=velocity, reach_m=0.5)
            counts.append(np.zeros((1, 3)) if there is None else there.counts(Boxes.of([other]), opaque=opaque))
        tally.counts += np.concatenate(counts)

    def _tried(self, box: Cuboid, relative_mps: NDArray[np.floating], world_from_vehicle: RigidTransform) -> Boxes:
        """The box as stated, at other times, larger, shifted, and in the readings near its place."""
        pose = box.vehicle_from_object
        read = Boxes.of([box, *(reading.change(box, world_from_vehicle) for reading in self._near)])
        late = LATE_MS[:, None] / 1000 * relative_mps
        grown = (np.eye(3)[:, None] * GROWN_M[:, None]).reshape(-1, 3)
        shifted = SHIFTS_M @ pose.rotation[:, :2].T
        along = np.concatenate([np.zeros((1, 3)), late, np.zeros_like(grown), shifted])
        sizes = np.repeat(box.size_m[None], len(along), axis=0)
        sizes[self._grown] += grown
        return Boxes(
            rotations=np.concatenate([np.repeat(pose.rotation[None], len(along), axis=0), read.rotations[1:]]),
            centres_m=np.concatenate([pose.translation_m + along, read.centres_m[1:]]),
            sizes_m=np.concatenate([sizes, read.sizes_m[1:]]),
        )

    def findings(self) -> Iterator[Finding]:
        """Findings about all boxes, else object by object."""
        file = annotation_file(self._recording)
        if self._left_out:
            yield Finding(check="crowded-boxes", severity=Severity.WARNING, file=file, field="cuboid",
                          expected=f"at most {MOST_BOXES} boxes in a sweep",
                          got=f"more; in {self._left_out} boxes no points were looked for",
                          hint="fix the reported ones, then validate again", times=self._left_out)  # fmt: skip
        sweeps_ns = {sweep.timestamp_ns for sweep in self._recording.sweeps}
        for track in self._recording.tracks:
            yield from _index_findings(track, self._tallies[track.track_id], sweeps_ns, file)
        of_all = self._of_all()
        if of_all is not None:
            yield replace(of_all, file=file)
            return
        tight = tight_boxes(np.array([tally.held for tally in self._tallies.values()]).reshape(-1, len(MARGINS_M)))
        if tight is not None:
            yield replace(tight, file=file)
        for track in self._recording.tracks:
            finding = self._of_one(track)
            if finding is not None:
                yield replace(finding, file=file)

    # ------------------------------------------------------------ all boxes

    def _of_all(self) -> Finding | None:
        """The mistake that fits all boxes best, with all that fit as well."""
        counts = np.array([tally.counts for tally in self._tallies.values()]).reshape(-1, self._read.stop, 3)
        shares = _share(counts)
        held = counts[:, :, 0]
        told = np.maximum(held, held[:, :1]) >= LEAST_RETURNS  # by objects that neither finds, nothing is told
        objects = told.sum(axis=0)
        share, stated = ((values * told).sum(axis=0) / np.maximum(objects, 1) for values in (shares, shares[:, :1]))
        gains, better = share - stated, (shares - shares[:, :1] > SLIGHTLY) & told
        fits = (share > FITS) & (gains > SLIGHTLY) & (better.sum(axis=0) > objects / 2)
        mistakes = [
            *self._reading_of_all(share, fits & (gains > CLEARLY)),
            *_late(share[self._late], fits[self._late]),
            *_grown(share[self._grown], fits[self._grown]),
        ]
        if not mistakes:
            return None
        best, first = max(mistakes, key=lambda mistake: mistake[0])
        others = [other for as_good, other in mistakes if other is not first and as_good > best - AS_WELL]
        row = int(np.argmax(np.where(fits, share, 0.0)))
        return replace(
            first,
            got=f"{stated[row]:.0%} of the points around {objects[row]} objects inside; {best:.0%} {first.got}"
            + "".join(f"; as many {other.got}" for other in others),
            hint="; or ".join([first.hint, *(other.hint for other in others)]),
            times=int(objects[row]),
        )

    def _reading_of_all(self, share: NDArray[np.float64], fits: NDArray[np.bool_]) -> Iterator[tuple[float, Finding]]:
        every = [*self._near, *self._elsewhere]
        rows = [row for row in range(self._read.start, self._read.stop) if fits[row]]
        if rows:
            best = max(rows, key=lambda row: float(share[row]))
            yield float(share[best]), _read_finding(every[best - self._read.start])

    # ------------------------------------------------------------ single objects

    def _of_one(self, track: Track) -> Finding | None:
        tally = self._tallies[track.track_id]
        counts, usual = tally.counts, _empty_or_tight(track, tally)
        tight = usual is not None and usual.check == "tight-box"
        if max(counts[0, 0], counts[0, 2]) >= LEAST_RETURNS:  # a hidden one may have its neighbour's returns around it
            share = _share(counts)
            shifted = share[self._shifted]
            fitting = SHIFTS_M[shifted > shifted.max() - AS_WELL]
            shift_m = fitting[np.argmin(np.abs(fitting).sum(axis=1))]
            best = int(np.argmax(share[self._read][: len(self._near)]))
            read = share[self._read][best]
            if read - max(share[0], shifted.max()) > CLEARLY and read > FITS:
                told = _read_finding(self._near[best])
                got = f"{share[0]:.0%} of the points around it inside; {read:.0%} {told.got}"
                return replace(told, field=object_field(track), got=got)
            least_m = QUARTER_M if tight else 0.0
            if shifted.max() - max(share[0], FITS - CLEARLY) > CLEARLY and np.abs(shift_m).max() > least_m:
                return Finding(
                    check="box-place",
                    field=object_field(track),
                    expected="lidar points of the object in its box",
                    got=f"{share[0]:.0%} of the points around it inside; {shifted.max():.0%} if it were "
                    + " and ".join(_ways(shift_m)),
                    hint="move its boxes by so much (to a quarter of a metre); the others fit",
                )
        return usual


def _share(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(counts[..., 0] / np.maximum(counts.sum(axis=-1), 1.0))


def _ways(shift_m: NDArray[np.float64]) -> Iterator[str]:
    for way_m, forth, back in zip(shift_m, ("ahead", "to its left"), ("behind", "to its right"), strict=True):
        if way_m:
            yield f"{abs(way_m):.2f} m farther {forth if way_m > 0 else back}"


def _late(share: NDArray[np.float64], fits: NDArray[np.bool_]) -> Iterator[tuple[float, Finding]]:
    """Lateness of all boxes with its interval: all that fits about as well."""
    fitting = LATE_MS[share > share.max() - AS_WELL]
    low, high = int(fitting[0]), int(fitting[-1])
    if not fits.any() or (low < LEAST_LATE_MS and high > -LEAST_LATE_MS):
        return
    middle, (least, most) = abs(low + high) // 2, sorted((abs(low), abs(high)))
    word, change, other = (
        ("late", f"subtract {middle} ms from", "early") if low > 0 else ("early", f"add {middle} ms to", "late")
    )
    yield (
        float(share.max()),
        Finding(
            check="box-time",
            field="timestamp",
            expected="boxes at the times of their points",
            got=f"if boxes are {middle} ms {word} ({least} to {most} ms)",
            hint=f"{change} the annotations' times, or take them from the sweep that was annotated; or the clock of "
            f"the sweeps is as much {other}, if images or ego-motion disagree with it alike",
        ),
    )


def _grown(share: NDArray[np.float64], fits: NDArray[np.bool_]) -> Iterator[tuple[float, Finding]]:
    """Length, width or height that lacks some."""
    sides = share.reshape(3, -1)
    side = int(np.argmax(sides.max(axis=1)))
    if not fits.any():
        return
    name, by_m = ("length", "width", "height")[side], GROWN_M[np.argmax(sides[side] > sides[side].max() - AS_WELL)]
    yield (
        float(sides.max()),
        Finding(
            check="box-short",
            severity=Severity.WARNING,
            field="cuboid, sizes",
            expected="boxes around the whole of an object",
            got=f"if the {name} is too short by {by_m:.1f} m",
            hint=f"add {by_m:.1f} m to the {name}",
        ),
    )


def _read_finding(reading: Reading) -> Finding:
    return Finding(
        check="box-reading",
        field=reading.field,
        expected="lidar points of the objects in their boxes",
        got=f"as if {reading.description}",
        hint=reading.hint,
    )


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
        tally.empty += 1
        tally.beams += beams
        tally.first_ns = time_ns if tally.first_ns is None else tally.first_ns


def _look_at_indices(tally: _Tally, shape: PointIndices, sweep: LidarSweep) -> None:
    if shape.sweep_timestamp_ns != sweep.timestamp_ns or not len(shape.indices):
        return
    largest, points = int(shape.indices.max()), sweep.rows_stored
    if largest >= points or int(shape.indices.min()) < 0:
        tally.wrong_indices.append((sweep.timestamp_ns, f"row {largest} of a sweep of {points} points"))
    elif len(np.unique(shape.indices)) < len(shape.indices):
        tally.wrong_indices.append((sweep.timestamp_ns, "rows named twice"))


def _index_findings(track: Track, tally: _Tally, sweeps_ns: set[int], file: str) -> Iterator[Finding]:
    lost = [
        state.timestamp_ns
        for state in track.states
        if isinstance(state.shape, PointIndices) and state.shape.sweep_timestamp_ns not in sweeps_ns
    ]
    if lost:
        yield Finding(check="point-indices", file=file, field=f"object {track.track_id!r}",
                      expected="the time of a sweep of the recording", got=f"{len(lost)} states without such a sweep",
                      times=len(lost), timestamp_ns=lost[0])  # fmt: skip
    if tally.wrong_indices:
        time_ns, got = tally.wrong_indices[0]
        yield Finding(check="point-indices", file=file, field=f"object {track.track_id!r}",
                      expected="rows of the sweep, each once", got=got,
                      times=len(tally.wrong_indices), timestamp_ns=time_ns)  # fmt: skip


def _empty_or_tight(track: Track, tally: _Tally) -> Finding | None:
    if tally.empty and tally.empty > MOST_EMPTY * tally.looked:
        sure = tally.points == 0 and tally.looked >= min(LEAST_STATES, len(track.states))
        return Finding(
            check="empty-box",
            severity=Severity.ERROR if sure else Severity.WARNING,
            field=object_field(track),
            expected="lidar points in the box where beams pass through it",
            got=f"none in {tally.empty} of {tally.looked} sweeps, with {tally.beams} beams through it",
            hint="the box is elsewhere than its object, or at another time",
            times=tally.empty,
            timestamp_ns=tally.first_ns,
        )
    if len(tally.tight_ns) > MOST_TIGHT * tally.looked:
        few = f"at most {tally.in_tight}" if tally.in_tight else "0"
        return Finding(
            check="tight-box",
            severity=Severity.WARNING,
            field=object_field(track),
            expected=f"{LEAST_POINTS} lidar points in the box, below which the protocols ignore an object",
            got=f"{few} points in {len(tally.tight_ns)} of {tally.looked} sweeps that see it, and more within "
            f"{100 * OUTSIDE_M:.0f} cm outside",
            hint="the box is too tight (leave some centimetres around the object), or at another time",
            times=len(tally.tight_ns),
            timestamp_ns=tally.tight_ns[0],
        )
    return None

"""Tracks over time: jumps, names that change, labels that come and go, speeds, velocities and headings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise, product

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import Trajectory
from bench.plain_text import listed
from bench.recordings import Cuboid, Recording, Track
from bench.times import SECOND_NS
from bench.validation.drive import annotated_times, boxes_of, object_field
from bench.validation.findings import BODIES, BodyLimits, Finding, Severity, occurrences

LONGEST_STEP_S = 1.0
JUMP_M = 1.0
JUMP_SHARE_OF_RANGE = 0.02  # boxes far away are seen by few points and shake
HARD_MPS2 = 10.0  # braking on a dry road
CHUNK_NS = 1_000_000_000
SHORTEST_CHUNK_S = 0.25
OFF_MPS, OFF_SHARE = 1.0, 0.25
FAR_M = 50.0
MOVING_MPS = 2.0
WALKING_MPS = 0.7
ROLLING = frozenset({"vehicle", "cyclist"})
SLIDING_DEG, BACKWARDS_DEG, SAME_DEG = 50.0, 130.0, 20.0
SAME_OBJECT_M, SAME_OBJECT_SIZE = 0.4, 0.15  # of its expected place, and part of each side
EXCHANGED_M, EXCHANGED_BETTER = 1.0, 0.3  # what two names are off, and what part of it is left after an exchange
GAP_STEPS = 1.5
FLICKERS, FLICKER_STEPS = 3, 2  # gaps of an object, and the annotated times in one; hidden objects have few, long gaps
# What the box's heading may be, the sign and the offset in degrees that undo it, and what to do.
HEADINGS: tuple[tuple[str, float, float, str], ...] = (
    ("it is right", 1.0, 0.0, ""),
    ("the box is back to front", 1.0, 180.0, "turn it by 180 degrees, unless the object reverses"),
    (
        "x points to its left",
        1.0,
        -90.0,
        "turn it by 90 degrees to the right, or swap length and width with the heading",
    ),
    (
        "x points to its right",
        1.0,
        90.0,
        "turn it by 90 degrees to the left, or swap length and width with the heading",
    ),
    ("the sign of the yaw is reversed", -1.0, 0.0, "reverse the yaw: positive is to the left"),
    ("the yaw is a compass's", -1.0, 90.0, "count the yaw from x to the left, not from y to the right"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPath:
    """The states of a track that have a box or outline and ego-motion.

    Attributes:
        times_ns: (N,) int64.
        positions_m: (N, 3) float64, m, centres, world frame.
        stated_mps: (N, 3) float64, stated velocity over the ground, world axes; NaN where unknown.
        forward: (N, 2) float64, horizontal part of the box's x axis, world axes; NaN for outlines.
        range_m: (N,) float64, m, horizontal distance from the vehicle's origin.
        ego_mps: (N, 3) float64, velocity of the ego vehicle, world axes.
        stated_turn_radps: (N,) float64.
        rotations: (N, 3, 3) float64, world_from_vehicle.
    """

    times_ns: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    stated_mps: NDArray[np.float64]
    forward: NDArray[np.float64]
    range_m: NDArray[np.float64]
    ego_mps: NDArray[np.float64]
    stated_turn_radps: NDArray[np.float64]
    rotations: NDArray[np.float64]


def track_path(track: Track, trajectory: Trajectory) -> TrackPath:
    """Arrays of a track."""
    boxed = boxes_of(track)
    times_ns = np.array([state.timestamp_ns for state, _ in boxed], dtype=np.int64)
    rotations, positions_m, valid = trajectory.at(times_ns)
    kept = [pair for pair, good in zip(boxed, valid, strict=True) if good]
    rotations, positions_m, times_ns = rotations[valid], positions_m[valid], times_ns[valid]
    centres = np.array([box.vehicle_from_object.translation_m for _, box in kept]).reshape(-1, 3)
    stated = np.array([state.velocity_mps for state, _ in kept], dtype=np.float64).reshape(-1, 3)
    axes = np.array([
        box.vehicle_from_object.rotation[:, 0] if isinstance(state.shape, Cuboid) else np.full(3, np.nan)
        for state, box in kept
    ]).reshape(-1, 3)  # fmt: skip
    ego = np.array([rotations[i] @ trajectory.velocity_vehicle_mps(int(t)) for i, t in enumerate(times_ns)])
    return TrackPath(
        times_ns=times_ns,
        positions_m=_turned(rotations, centres) + positions_m,
        stated_mps=_turned(rotations, stated),
        forward=_turned(rotations, axes)[:, :2],
        range_m=np.hypot(centres[:, 0], centres[:, 1]),
        ego_mps=ego.reshape(-1, 3),
        stated_turn_radps=np.array([state.yaw_rate_radps for state, _ in kept], dtype=np.float64),
        rotations=rotations,
    )


def _turned(rotations: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))


def check_motion(recording: Recording) -> Iterator[Finding]:
    """Every track for itself; a fault that many of them share is reported once."""
    yield from _names_that_change(recording)
    yield from _labels_that_come_and_go(recording)
    velocities: dict[str, list[tuple[str, float]]] = defaultdict(list)
    headings: dict[str, NDArray[np.float64]] = {}
    for track in recording.tracks:
        limits = BODIES.get(track.object_class)
        path = track_path(track, recording.trajectory)
        if limits is None or len(path.times_ns) < 2:
            continue
        field = object_field(track)
        yield from _jumps(path, field)
        yield from _too_fast(path, limits, field)
        yield from _turns(path, limits, field)
        errors_deg = _heading_errors(path, MOVING_MPS if track.object_class in ROLLING else WALKING_MPS)
        if errors_deg is not None:
            headings[field] = errors_deg
        fault = _velocity_fault(path)
        if fault is not None:
            velocities[fault[0]].append((track.track_id, fault[1]))
    rolling = frozenset(object_field(track) for track in recording.tracks if track.object_class in ROLLING)
    yield from _headings(headings, rolling)
    for cause, objects in velocities.items():
        yield Finding(
            check="velocity",
            field="velocity_mps",
            expected="velocities over the ground along the vehicle's axes, as the positions change",
            got=f"{len(objects)} objects off by up to {max(off for _, off in objects):.1f} m/s: "
            + listed([name for name, _ in objects]),
            hint=cause,
            times=len(objects),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sighting:
    """An object at an annotated time: place (3,) m and velocity (3,) m/s, world frame, size (3,) m."""

    track: Track
    position_m: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]
    size_m: NDArray[np.float64]

    def misses_m(self, later: _Sighting, seconds: float) -> float:
        """Distance of a later sighting from where this object is expected then; infinite for another class."""
        if later.track.object_class != self.track.object_class:
            return np.inf
        return float(np.linalg.norm((later.position_m - self.position_m - seconds * self.velocity_mps)[:2]))


def _sightings(recording: Recording) -> dict[int, dict[str, _Sighting]]:
    """Objects by time and name; velocities from the state before, of the first state as stated."""
    sightings: dict[int, dict[str, _Sighting]] = defaultdict(dict)
    for track in recording.tracks:
        path = track_path(track, recording.trajectory)
        sizes_m = {state.timestamp_ns: box.size_m for state, box in boxes_of(track)}
        velocities = path.stated_mps.copy()
        if len(path.times_ns) > 1:
            seconds = np.diff(path.times_ns)[:, None] / SECOND_NS
            velocities[1:] = np.diff(path.positions_m, axis=0) / seconds
        for time_ns, position_m, velocity in zip(path.times_ns.tolist(), path.positions_m, velocities, strict=True):
            sightings[time_ns][track.track_id] = _Sighting(
                track=track, position_m=position_m, velocity_mps=velocity, size_m=sizes_m[time_ns]
            )
    return dict(sorted(sightings.items()))


def _names_that_change(recording: Recording) -> Iterator[Finding]:
    """One object that goes on under another name, and two that exchange their names."""
    handed_over: dict[tuple[str, str], list[int]] = defaultdict(list)
    exchanged: dict[tuple[str, str], list[int]] = defaultdict(list)
    for (before_ns, before), (time_ns, now) in pairwise(_sightings(recording).items()):
        seconds = (time_ns - before_ns) / SECOND_NS
        if seconds > LONGEST_STEP_S:
            continue
        ended = [seen for name, seen in before.items() if name not in now]
        begun = [seen for name, seen in now.items() if name not in before]
        for old, new in product(ended, begun):
            alike = bool((np.abs(new.size_m - old.size_m) < SAME_OBJECT_SIZE * old.size_m).all())
            if alike and old.misses_m(new, seconds) < SAME_OBJECT_M:
                handed_over[_pair(old, new)].append(time_ns)
        for one, other in combinations([name for name in before if name in now], 2):
            stated_m = before[one].misses_m(now[one], seconds) + before[other].misses_m(now[other], seconds)
            exchanged_m = before[one].misses_m(now[other], seconds) + before[other].misses_m(now[one], seconds)
            if stated_m > EXCHANGED_M and exchanged_m < EXCHANGED_BETTER * stated_m:
                exchanged[_pair(before[one], before[other])].append(time_ns)
    for pairs, what in ((handed_over, "one ends where the other goes on"), (exchanged, "each goes on as the other")):
        for (one, other), times_ns in pairs.items():
            yield Finding(
                check="object-name",
                severity=Severity.WARNING,
                field=f"objects {one!r} and {other!r}",
                expected="one name for each object, from its first to its last label",
                got=f"{what} at {len(times_ns)} times",
                hint="give both parts of a track one name" if pairs is handed_over else "exchange the names back",
                times=len(times_ns),
                timestamp_ns=times_ns[0],
            )


def _pair(one: _Sighting, other: _Sighting) -> tuple[str, str]:
    first, last = sorted((one.track.track_id, other.track.track_id))
    return first, last


def _labels_that_come_and_go(recording: Recording) -> Iterator[Finding]:
    """Times without any label between labels of one object, and objects that have gaps again and again."""
    times_ns = annotated_times(recording)
    if len(times_ns) < 3:
        return
    usual_ns = float(np.quantile(np.diff(times_ns), 0.25, method="lower"))
    rows = [np.searchsorted(times_ns, [s.timestamp_ns for s in track.states]) for track in recording.tracks]
    followed = np.zeros(len(times_ns) - 1, dtype=bool)  # steps over which an object has labels on both sides
    for row in rows:
        followed[row[:-1][np.diff(row) == 1]] = True
    middle_ns = (times_ns[1:] + times_ns[:-1]) // 2
    gaps = (np.diff(times_ns) > GAP_STEPS * usual_ns) & followed
    gaps &= [recording.annotated.covers(int(time_ns)) for time_ns in middle_ns]
    if gaps.any():
        yield Finding(
            check="label-gaps",
            severity=Severity.WARNING,
            field="frames",
            expected=f"labels every {usual_ns / 1e6:.1f} ms, as in most of the recording",
            got=f"none for up to {np.diff(times_ns)[gaps].max() / 1e6:.1f} ms, {int(gaps.sum())} times, "
            "between labels of one object",
            hint="label these frames too, or leave their times out by `annotated: {timestamps_ns: ...}`",
            **occurrences(gaps, times_ns[1:]),
        )
    for track, row in zip(recording.tracks, rows, strict=True):
        missing = np.diff(row) - 1
        flickers = (missing > 0) & (missing <= FLICKER_STEPS)
        if flickers.sum() >= FLICKERS:
            yield Finding(
                check="label-gaps",
                severity=Severity.WARNING,
                field=object_field(track),
                expected="a label at each annotated time, while the object is there",
                got=f"none for one or two times, {int(flickers.sum())} times",
                hint="label it there too; where it is hidden from the lidar, nothing is scored anyway",
                **occurrences(flickers, times_ns[row[1:]]),
            )


def _jumps(path: TrackPath, field: str) -> Iterator[Finding]:
    """Steps that leave what the steps around them lead one to expect."""
    seconds = np.diff(path.times_ns) / SECOND_NS
    velocity = np.diff(path.positions_m, axis=0) / seconds[:, None]
    usual = np.empty_like(velocity)
    for i in range(len(velocity)):
        around = [k for k in range(max(i - 3, 0), min(i + 4, len(velocity))) if k != i]
        usual[i] = np.median(velocity[around], axis=0) if around else velocity[i]
    off_m = np.linalg.norm((velocity - usual)[:, :2], axis=1) * seconds
    range_m = np.maximum(path.range_m[1:], path.range_m[:-1])
    allowed_m = JUMP_M + HARD_MPS2 * seconds**2 + JUMP_SHARE_OF_RANGE * range_m
    jumps = (off_m > allowed_m) & (seconds <= LONGEST_STEP_S)
    if jumps.any():
        yield Finding(
            check="object-jump",
            field=field,
            expected="a path without jumps",
            got=f"{int(jumps.sum())} steps off their line by up to {off_m[jumps].max():.1f} m",
            hint="two objects under one name, or a box left behind",
            **occurrences(jumps, path.times_ns[1:]),
        )


def _too_fast(path: TrackPath, limits: BodyLimits, field: str) -> Iterator[Finding]:
    seconds = (path.times_ns[-1] - path.times_ns[0]) / SECOND_NS
    mean_mps = float(np.linalg.norm(path.positions_m[-1] - path.positions_m[0])) / seconds
    stated = np.linalg.norm(path.stated_mps, axis=1)
    fastest = max(mean_mps, float(np.nanmedian(stated)) if np.isfinite(stated).any() else 0.0)
    if fastest > limits.top_speed_mps:
        yield Finding(
            check="object-speed",
            field=field,
            expected=f"at most {limits.top_speed_mps:.0f} m/s",
            got=f"{fastest:.1f} m/s {'along its positions' if fastest == mean_mps else 'as stated'}",
            hint="km/h instead of m/s, another class, or another frame",
            timestamp_ns=int(path.times_ns[0]),
        )


def _turns(path: TrackPath, limits: BodyLimits, field: str) -> Iterator[Finding]:
    fastest = float(np.abs(path.stated_turn_radps).max())
    if fastest > limits.top_turn_radps:
        yield Finding(
            check="object-turn",
            field=f"{field}: yaw_rate_radps",
            expected=f"at most {limits.top_turn_radps} rad/s",
            got=f"{fastest:.3g}",
            hint="degrees per second instead of rad/s?",
            timestamp_ns=int(path.times_ns[int(np.argmax(np.abs(path.stated_turn_radps)))]),
        )


def _heading_errors(path: TrackPath, least_mps: float) -> NDArray[np.float64] | None:
    """Medians over the path of the angle between the box's x, in each of `HEADINGS`, and the way the object goes.

    Returns:
        (H,) float64, degrees; None where the object does not go anywhere, or has no heading.
    """
    angles = []
    for first, last in _chunks(path):
        way = path.positions_m[last] - path.positions_m[first]
        seconds = (path.times_ns[last] - path.times_ns[first]) / SECOND_NS
        middle = (first + last) // 2
        if np.hypot(*way[:2]) / seconds > least_mps and path.range_m[first] < FAR_M:
            axes = path.rotations[middle].T  # vehicle_from_world
            forward = axes @ np.append(path.forward[middle], 0.0)
            ways = axes @ way
            yaw_deg, way_deg = (float(np.degrees(np.arctan2(v[1], v[0]))) for v in (forward, ways))
            turned = np.array([sign * yaw_deg + offset_deg for _, sign, offset_deg, _ in HEADINGS]) - way_deg
            angles.append(np.abs((turned + 180.0) % 360.0 - 180.0))
    if not angles or not np.isfinite(angles).all():
        return None
    return np.asarray(np.median(angles, axis=0))


def _headings(errors_deg: dict[str, NDArray[np.float64]], single: frozenset[str]) -> Iterator[Finding]:
    """Wheels roll along the length of a body: one mistake of all boxes, else object by object.

    Args:
        errors_deg: from `_heading_errors`, by the objects' fields.
        single: objects reported for themselves; people may walk sideways.
    """
    wrong = {name: errors for name, errors in errors_deg.items() if errors[0] > SLIDING_DEG}
    mean = np.mean(list(errors_deg.values()), axis=0) if wrong else np.zeros(len(HEADINGS))
    if wrong and len(errors_deg) > 1 and mean.min() < SAME_DEG:
        yield _heading_finding("all boxes", mean, times=len(errors_deg))
        return
    for name, errors in wrong.items():
        if name in single or len(errors_deg) == 1:
            yield _heading_finding(name, errors, times=1)


def _heading_finding(field: str, errors_deg: NDArray[np.float64], *, times: int) -> Finding:
    fitting = [entry for entry, off in zip(HEADINGS, errors_deg, strict=True) if off < errors_deg.min() + SAME_DEG]
    backwards = times == 1 and errors_deg[0] > BACKWARDS_DEG
    return Finding(
        check="heading",
        severity=Severity.WARNING if backwards else Severity.ERROR,
        field=field,
        expected="boxes whose x points where the object goes",
        got=f"{errors_deg[0]:.0f} degrees between them; {errors_deg.min():.0f} if "
        + " or ".join(description for description, *_ in fitting),
        hint="; or ".join(hint for *_, hint in fitting),
        times=times,
    )


def _velocity_fault(path: TrackPath) -> tuple[str, float] | None:
    """Fault of the stated velocities, and its size in m/s."""
    known = np.isfinite(path.stated_mps).all(axis=1) & (path.range_m < FAR_M)
    real, claimed, ego, local = [], [], [], []
    for first, last in _chunks(path):
        rows = slice(first, last + 1)
        if not known[rows].all():
            continue
        seconds = (path.times_ns[last] - path.times_ns[first]) / SECOND_NS
        real.append(((path.positions_m[last] - path.positions_m[first]) / seconds)[:2])
        claimed.append(_mean(path.times_ns[rows], path.stated_mps[rows])[:2])
        ego.append(_mean(path.times_ns[rows], path.ego_mps[rows])[:2])
        local.append(np.einsum("nji,nj->ni", path.rotations[rows], path.stated_mps[rows]).mean(axis=0)[:2])
    if not real:
        return None
    truth, stated = np.array(real), np.array(claimed)
    off = np.linalg.norm(stated - truth, axis=1)
    allowed = np.maximum(OFF_MPS, OFF_SHARE * np.maximum(*(np.linalg.norm(v, axis=1) for v in (stated, truth))))
    if np.mean(off > allowed) <= 0.5:
        return None
    readings = {
        "km/h instead of m/s": stated / 3.6,
        "m/s divided by 3.6 once too often": stated * 3.6,
        "relative to the vehicle instead of over the ground": stated + np.array(ego),
        "the ego vehicle's own velocity added once too often": stated - np.array(ego),
        "along the world's axes instead of the vehicle's": np.array(local),
        "the sign is reversed": -stated,
    }
    errors = {reading: float(np.mean(np.linalg.norm(v - truth, axis=1))) for reading, v in readings.items()}
    best = min(errors, key=lambda reading: errors[reading])
    fits = errors[best] < 0.4 * float(off.mean())
    return (best if fits else "check unit, axes, and whether it is over the ground"), float(np.median(off))


def _mean(times_ns: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    seconds = (times_ns - times_ns[0]) / SECOND_NS
    return np.asarray(np.trapezoid(values, seconds, axis=0) / seconds[-1])


def _chunks(path: TrackPath) -> Iterator[tuple[int, int]]:
    """First and last row of stretches of about a second."""
    first = 0
    while first < len(path.times_ns) - 1:
        last = int(np.searchsorted(path.times_ns, path.times_ns[first] + CHUNK_NS, side="right")) - 1
        last = min(max(last, first + 1), len(path.times_ns) - 1)
        if SHORTEST_CHUNK_S <= (path.times_ns[last] - path.times_ns[first]) / SECOND_NS <= 2.0:
            yield first, last
        first = last

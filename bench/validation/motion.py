"""Tracks over time: jumps, speeds beyond the class, stated velocities and turns against positions and headings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import Trajectory
from bench.plain_text import listed
from bench.recordings import Cuboid, Recording, Track
from bench.validation.drive import boxes_of, object_field
from bench.validation.findings import BODIES, SECOND_NS, BodyLimits, Finding, Severity, occurrences

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
    for cause, found in velocities.items():
        yield Finding(
            check="velocity",
            field="velocity_mps",
            expected="velocities over the ground along the vehicle's axes, as the positions change",
            got=f"{len(found)} objects off by up to {max(off for _, off in found):.1f} m/s: "
            + listed([name for name, _ in found]),
            hint=cause,
            times=len(found),
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

"""Paths over time, the ego vehicle's and the objects': limits, jumps, names that change, gaps, velocities, headings."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, product

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.egomotion.trajectory import Trajectory
from bench.geometry import twist_between
from bench.plain_text import counted, listed
from bench.recordings import Cuboid, Recording, Track
from bench.times import SECOND_NS
from bench.validation.findings import Finding, Severity, annotated_times, boxes_of, new_finding, object_field
from bench.validation.fits.scan_matching import measured_motion, scan_steps
from bench.validation.quick.boxes import BODIES, BodyLimits

Array = NDArray[np.float64]

SPEED_WINDOW_NS = 200_000_000  # single steps of measured poses jitter
EGO_JUMP_MPS2 = 40.0  # a crash; also what a pose that jumps by half a metre between two 10 Hz poses gives
EGO_TOP_SPEED_MPS = 75.0
EGO_TOP_TURN_RADPS = 1.5  # a tight turn at walking pace is 0.5
EGO_SIDEWAYS_MPS2 = 1.3 * 9.81  # a car on a dry road holds about 1 g


def check_ego_limits(recording: Recording) -> Iterator[Finding]:
    """Speed, turn, cornering and jumps of the path, from poses a fifth of a second apart."""
    path = recording.trajectory
    times_ns = path.timestamps_ns
    after = np.minimum(np.searchsorted(times_ns, times_ns + SPEED_WINDOW_NS), len(times_ns) - 1)
    before = np.flatnonzero((times_ns[after] > times_ns) & (times_ns[after] - times_ns <= SECOND_NS))
    after = after[before]
    if not len(before):
        return
    turns, paths_m = twist_between(
        path.rotations[before], path.positions_m[before], path.rotations[after], path.positions_m[after]
    )
    seconds = (times_ns[after] - times_ns[before]) / SECOND_NS
    speed, turn = np.linalg.norm(paths_m, axis=1) / seconds, np.linalg.norm(turns, axis=1) / seconds
    for kind, field, values, limit, unit in (
        ("ego-speed", "speed", speed, EGO_TOP_SPEED_MPS, "m/s"),
        ("ego-turn", "yaw rate", turn, EGO_TOP_TURN_RADPS, "rad/s"),
        ("ego-cornering", "speed times yaw rate", speed * turn, EGO_SIDEWAYS_MPS2, "m/s2"),
    ):
        if (beyond := values > limit).any():
            got = f"up to {values.max():.3g} {unit}"
            yield new_finding(kind, got, field=field, limit=limit, at_ns=times_ns[before][beyond])
            return  # consequences of a wrong unit are not reported again
    yield from _ego_jumps(path)


def _ego_jumps(path: Trajectory) -> Iterator[Finding]:
    """Poses that leave the line of their neighbours."""
    if len(path.timestamps_ns) < 4:
        return
    seconds = np.diff(path.timestamps_ns) / SECOND_NS
    velocity = np.diff(path.positions_m, axis=0) / seconds[:, None]
    change_mps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    span_s = (seconds[1:] + seconds[:-1]) / 2
    away_m = change_mps * np.minimum(seconds[1:], seconds[:-1])
    jumps = (change_mps / span_s > EGO_JUMP_MPS2) & (away_m > 0.3)
    if jumps.any():
        got = f"{int(jumps.sum())} places where it leaves its line, by up to {away_m[jumps].max():.2f} m"
        yield new_finding("ego-jump", got, field="position", at_ns=path.timestamps_ns[1:-1][jumps])


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
TURN_IT = "turn it by 90 degrees to the {}, or swap length and width with the heading"
# By what the ego vehicle's speed is multiplied where people confuse its unit: every object seems to go otherwise then.
EGO_SPEEDS = {
    "the ego vehicle's speed is km/h read as m/s": 1 / 3.6,
    "the ego vehicle's speed is m/s read as km/h": 3.6,
}
CONFIRMED_BY = 6  # pairs of sweeps
EXPLAINED = 0.4  # of the error of stated velocities, that a reading leaves which explains it
# What the box's heading may be, the sign and the offset in degrees that undo it, and what to do.
HEADINGS: tuple[tuple[str, float, float, str], ...] = (
    ("it is right", 1.0, 0.0, ""),
    ("the box is back to front", 1.0, 180.0, "turn it by 180 degrees, unless the object reverses"),
    ("x points to its left", 1.0, -90.0, TURN_IT.format("right")),
    ("x points to its right", 1.0, 90.0, TURN_IT.format("left")),
    ("the sign of the yaw is reversed", -1.0, 0.0, "reverse the yaw: positive is to the left"),
    ("the yaw is a compass's", -1.0, 90.0, "count the yaw from x to the left, not from y to the right"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPath:
    """The states of a track that have a box or outline and ego-motion.

    Attributes:
        track: the object.
        times_ns: (N,) int64.
        sizes_m: (N, 3) float64, m.
        positions_m: (N, 3) float64, m, centres, world frame.
        stated_mps: (N, 3) float64, stated velocity over the ground, world axes; NaN where unknown.
        forward: (N, 2) float64, horizontal part of the box's x axis, world axes; NaN for outlines.
        range_m: (N,) float64, m, horizontal distance from the vehicle's origin.
        ego_mps: (N, 3) float64, velocity of the ego vehicle, world axes.
        stated_turn_radps: (N,) float64.
        rotations: (N, 3, 3) float64, world_from_vehicle.
    """

    track: Track
    times_ns: NDArray[np.int64]
    sizes_m: Array
    positions_m: Array
    stated_mps: Array
    forward: Array
    range_m: Array
    ego_mps: Array
    stated_turn_radps: Array
    rotations: Array

    @property
    def seconds(self) -> Array:
        """(N,) float64, time since the first state."""
        return np.asarray((self.times_ns - self.times_ns[:1]) / SECOND_NS)


def track_path(track: Track, trajectory: Trajectory) -> TrackPath:
    """Arrays of a track."""
    boxed = boxes_of(track)
    times_ns = np.array([state.timestamp_ns for state, _ in boxed], dtype=np.int64)
    rotations, positions_m, valid = trajectory.at(times_ns)
    boxed = [pair for pair, good in zip(boxed, valid, strict=True) if good]
    rotations, positions_m, times_ns = rotations[valid], positions_m[valid], times_ns[valid]
    centres = np.array([box.vehicle_from_object.translation_m for _, box in boxed]).reshape(-1, 3)
    stated = np.array([state.velocity_mps for state, _ in boxed], dtype=np.float64).reshape(-1, 3)
    axes = np.array([
        box.vehicle_from_object.rotation[:, 0] if isinstance(state.shape, Cuboid) else np.full(3, np.nan)
        for state, box in boxed
    ]).reshape(-1, 3)  # fmt: skip
    ego = np.array([trajectory.velocity_vehicle_mps(int(time_ns)) for time_ns in times_ns]).reshape(-1, 3)
    return TrackPath(
        track=track,
        times_ns=times_ns,
        sizes_m=np.array([box.size_m for _, box in boxed]).reshape(-1, 3),
        positions_m=_rotated(rotations, centres) + positions_m,
        stated_mps=_rotated(rotations, stated),
        forward=_rotated(rotations, axes)[:, :2],
        range_m=np.hypot(centres[:, 0], centres[:, 1]),
        ego_mps=_rotated(rotations, ego),
        stated_turn_radps=np.array([state.yaw_rate_radps for state, _ in boxed], dtype=np.float64),
        rotations=rotations,
    )


def _rotated(rotations: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))


def check_motion(recording: Recording) -> Iterator[Finding]:
    """Every track for itself; a fault that many of them share is reported once."""
    paths = [track_path(track, recording.trajectory) for track in recording.tracks]
    yield from _names_that_change(paths)
    yield from _labels_that_come_and_go(recording)
    paths = [path for path in paths if path.track.object_class in BODIES and len(path.times_ns) > 1]
    for path in paths:
        limits, field = BODIES[path.track.object_class], object_field(path.track)
        yield from _jumps(path, field)
        yield from _too_fast(path, limits, field)
    told = [*_velocities(paths, recording), *_headings(paths, recording)]
    yield from [finding for finding in told if finding.check == "ego-speed"][:1]
    yield from (finding for finding in told if finding.check != "ego-speed")


Sighting = tuple[TrackPath, int]  # an object at an annotated time: its path, and the row


def _names_that_change(paths: Sequence[TrackPath]) -> Iterator[Finding]:
    """One object that goes on under another name, and two that exchange their names."""
    at: dict[int, dict[str, Sighting]] = defaultdict(dict)
    for path in paths:
        for row, time_ns in enumerate(path.times_ns.tolist()):
            at[time_ns][path.track.track_id] = path, row
    changes: dict[tuple[str, str, str], list[int]] = defaultdict(list)
    for (before_ns, before), (time_ns, now) in pairwise(sorted(at.items())):
        seconds = (time_ns - before_ns) / SECOND_NS
        if seconds > LONGEST_STEP_S:
            continue
        ended, begun = before.keys() - now.keys(), now.keys() - before.keys()
        for old, new in product(ended, begun):
            if _alike(before[old], now[new]) and _misses_m(before[old], now[new], seconds) < SAME_OBJECT_M:
                changes["object-name", min(old, new), max(old, new)].append(time_ns)
        for one, other in combinations(sorted(before.keys() & now.keys()), 2):
            stated_m, exchanged_m = (
                _misses_m(before[one], now[first], seconds) + _misses_m(before[other], now[second], seconds)
                for first, second in ((one, other), (other, one))
            )
            if stated_m > EXCHANGED_M and exchanged_m < EXCHANGED_BETTER * stated_m:
                changes["object-name: exchanged", one, other].append(time_ns)
    for (kind, one, other), times_ns in sorted(changes.items()):
        what = "one ends where the other goes on" if kind == "object-name" else "each goes on as the other"
        got, field = f"{what} at {counted(len(times_ns), 'time')}", f"objects {one!r} and {other!r}"
        yield new_finding(kind, got, field=field, at_ns=times_ns)


def _alike(before: Sighting, now: Sighting) -> bool:
    """Boxes of one size."""
    sizes_m, later_m = (path.sizes_m[row] for path, row in (before, now))
    return bool((np.abs(later_m - sizes_m) < SAME_OBJECT_SIZE * sizes_m).all())


def _misses_m(before: Sighting, now: Sighting, seconds: float) -> float:
    """Distance of a sighting from where an object seen before is expected; infinite for another class.

    Its velocity is that from the state before, of the first state the stated one.
    """
    (path, i), (later, k) = before, now
    if later.track.object_class != path.track.object_class:
        return np.inf
    velocity_mps = path.stated_mps[0]
    if i:
        velocity_mps = (path.positions_m[i] - path.positions_m[i - 1]) / (path.seconds[i] - path.seconds[i - 1])
    return float(np.linalg.norm((later.positions_m[k] - path.positions_m[i] - seconds * velocity_mps)[:2]))


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
        longest_ms = np.diff(times_ns)[gaps].max() / 1e6
        got = f"none for up to {longest_ms:.1f} ms, {int(gaps.sum())} times, between labels of one object"
        usual_ms = usual_ns / 1e6
        yield new_finding("label-gaps", got, field="frames", usual_ms=usual_ms, at_ns=times_ns[1:][gaps])
    for track, row in zip(recording.tracks, rows, strict=True):
        missing = np.diff(row) - 1
        flickers = (missing > 0) & (missing <= FLICKER_STEPS)
        if flickers.sum() >= FLICKERS:
            got, at_ns = f"none for one or two times, {int(flickers.sum())} times", times_ns[row[1:]][flickers]
            yield new_finding("label-gaps: flicker", got, field=object_field(track), at_ns=at_ns)


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
        got = f"{counted(int(jumps.sum()), 'step')} off the line by up to {off_m[jumps].max():.1f} m"
        yield new_finding("object-jump", got, field=field, at_ns=path.times_ns[1:][jumps])


def _too_fast(path: TrackPath, limits: BodyLimits, field: str) -> Iterator[Finding]:
    """Speeds along the positions and as stated, and stated yaw rates."""
    mean_mps = float(np.linalg.norm(path.positions_m[-1] - path.positions_m[0])) / path.seconds[-1]
    stated = np.linalg.norm(path.stated_mps, axis=1)
    fastest = max(mean_mps, float(np.nanmedian(stated)) if np.isfinite(stated).any() else 0.0)
    if fastest > limits.top_speed_mps:
        got = f"{fastest:.1f} m/s {'along its positions' if fastest == mean_mps else 'as stated'}"
        yield new_finding("object-speed", got, field=field, at_ns=path.times_ns[:1], limit=limits.top_speed_mps)
    turns = np.abs(path.stated_turn_radps)
    if turns.max() > limits.top_turn_radps:
        got, field, at_ns = f"{turns.max():.3g}", f"{field}: yaw_rate_radps", [path.times_ns[np.argmax(turns)]]
        yield new_finding("object-turn", got, field=field, at_ns=at_ns, limit=limits.top_turn_radps)


def _ego_speeds(recording: Recording) -> dict[str, float]:
    """Those of `EGO_SPEEDS` that are possible: none where neighbouring sweeps meet by the stated speed."""
    measured = measured_motion(recording, scan_steps(recording))
    return {} if len(measured.middle_ns) >= CONFIRMED_BY else EGO_SPEEDS


def _wrong_ego_speed(reading: str, got: str, recording: Recording, times: int, others: Sequence[str] = ()) -> Finding:
    hint = "; or ".join([f"multiply the speed by {EGO_SPEEDS[reading]:.4g}", *others])
    file, got = recording.trajectory.source, f"{got} if {reading}"
    return new_finding("ego-speed: labels", got, file=file, field="speed", hint=hint, times=times)


def _headings(paths: Sequence[TrackPath], recording: Recording) -> Iterator[Finding]:
    """Wheels roll along a body, people may walk aside: one mistake of all boxes, else object by object."""
    errors_deg = {path: errors for path in paths if (errors := _heading_errors(path)) is not None}
    wrong = {path: errors for path, errors in errors_deg.items() if errors[0] > SLIDING_DEG}
    if not wrong:
        return
    ego = [name for name, factor in _ego_speeds(recording).items() if _explains_headings(factor, errors_deg)]
    mean = np.mean(list(errors_deg.values()), axis=0)
    of_boxes = len(errors_deg) > 1 and mean.min() < SAME_DEG
    if ego and len(wrong) > 1 and not of_boxes:
        worst_deg = max(errors[0] for errors in wrong.values())
        got = f"headings of {len(wrong)} objects up to {worst_deg:.0f} degrees off, none"
        yield _wrong_ego_speed(ego[0], got, recording, len(wrong))
    if of_boxes:
        yield _heading_finding("all boxes", mean, ego, times=len(errors_deg))
        return
    for path, errors in wrong.items():
        if path.track.object_class in ROLLING or len(errors_deg) == 1:
            yield _heading_finding(object_field(path.track), errors, ego, times=1)


def _explains_headings(ego_factor: float, paths: Iterable[TrackPath]) -> bool:
    """With another speed of the ego vehicle all objects go where they head, or stand."""
    errors = (_heading_errors(path, ego_factor) for path in paths)
    return all(each is None or each[0] < SAME_DEG for each in errors)


def _heading_errors(path: TrackPath, ego_factor: float = 1.0) -> Array | None:
    """Medians over the path of the angle between the box's x, in each of `HEADINGS`, and the way the object goes.

    Args:
        path: of the object.
        ego_factor: by which the speed of the ego vehicle is multiplied.

    Returns:
        (H,) float64, degrees; None where the object does not go anywhere, or has no heading.
    """
    least_mps = MOVING_MPS if path.track.object_class in ROLLING else WALKING_MPS
    angles = []
    for first, last in _chunks(path):
        velocity_mps, ego_mps = _mean_velocities(path, first, last)
        velocity_mps = velocity_mps + (ego_factor - 1.0) * ego_mps
        middle = (first + last) // 2
        if np.hypot(*velocity_mps[:2]) > least_mps and path.range_m[first] < FAR_M:
            axes = path.rotations[middle].T  # vehicle_from_world
            forward, way = axes @ np.append(path.forward[middle], 0.0), axes @ velocity_mps
            yaw_deg, way_deg = (float(np.degrees(np.arctan2(v[1], v[0]))) for v in (forward, way))
            turned = np.array([sign * yaw_deg + offset_deg for _, sign, offset_deg, _ in HEADINGS]) - way_deg
            angles.append(np.abs((turned + 180.0) % 360.0 - 180.0))
    if not angles or not np.isfinite(angles).all():
        return None
    return np.asarray(np.median(angles, axis=0))


def _heading_finding(field: str, errors_deg: Array, ego: Sequence[str], *, times: int) -> Finding:
    fitting = [entry for entry, off in zip(HEADINGS, errors_deg, strict=True) if off < errors_deg.min() + SAME_DEG]
    hint = "; or ".join([*(hint for *_, hint in fitting), *ego])
    severity = Severity.WARNING if times == 1 and errors_deg[0] > BACKWARDS_DEG else Severity.ERROR
    got = f"{errors_deg[0]:.0f} degrees between them; {errors_deg.min():.0f} if "
    got += " or ".join(description for description, *_ in fitting)
    return new_finding("heading", got, field=field, severity=severity, hint=hint, times=times)


AS_STATED = "as stated"


def _velocities(paths: Sequence[TrackPath], recording: Recording) -> Iterator[Finding]:
    """First the reading that explains the stated velocities of most objects, then those that explain the rest."""
    told = {path.track.track_id: errors for path in paths if (errors := _velocity_errors(path)) is not None}
    errors_mps = pd.DataFrame.from_dict({name: errors for name, (errors, _) in told.items()}, orient="index")
    at_fault = pd.Series({name: fault for name, (_, fault) in told.items()}, dtype=bool)
    right, wrong, readings = errors_mps[~at_fault], errors_mps[at_fault], list(map(str, errors_mps))
    possible = _ego_speeds(recording) if len(wrong) else {}
    while len(wrong):
        fits = wrong.lt(EXPLAINED * wrong[AS_STATED], axis=0)
        for reading in EGO_SPEEDS:  # which would be that of all objects
            fits[reading] &= reading in possible and (right[reading] > OFF_MPS).sum() < fits[reading].sum()
        left_mps = wrong.where(fits).sum()
        best = max(readings, key=lambda reading: (fits[reading].sum(), -left_mps[reading]))
        objects = wrong[fits[best]] if fits[best].any() else wrong
        equal = [name for name in readings if fits.loc[objects.index, name].all() and objects[name].max() < OFF_MPS]
        others = [reading for reading in equal if reading != best]
        got = f"{counted(len(objects), 'object')} off by up to {objects[AS_STATED].max():.1f} m/s"
        if best in EGO_SPEEDS and fits[best].any():
            yield _wrong_ego_speed(best, f"{got}, {objects[best].max():.1f} m/s", recording, len(objects), others)
        else:
            hint = (
                "; or ".join([best, *others]) if fits[best].any() else "check unit, axes, and if it is over the ground"
            )
            got = f"{got}: {listed(list(objects.index))}"
            yield new_finding("velocity", got, field="velocity_mps", hint=hint, times=len(objects))
        wrong = wrong.drop(index=objects.index)


def _velocity_errors(path: TrackPath) -> tuple[dict[str, float], bool] | None:
    """Mean errors of the stated velocities in each reading, m/s, and whether they are wrong as stated."""
    known = np.isfinite(path.stated_mps).all(axis=1) & (path.range_m < FAR_M)
    in_vehicle = np.einsum("nji,nj->ni", path.rotations, path.stated_mps)
    chunks = []
    for first, last in _chunks(path):
        rows = slice(first, last + 1)
        if known[rows].all():
            mean_mps = _mean(path.seconds[rows], path.stated_mps[rows])
            chunks.append([*_mean_velocities(path, first, last), mean_mps, in_vehicle[rows].mean(axis=0)])
    if not chunks:
        return None
    truth, ego, stated, local = np.moveaxis(np.array(chunks)[..., :2], 1, 0)
    readings = {
        AS_STATED: stated,
        "km/h instead of m/s": stated / 3.6,
        "m/s divided by 3.6 once too often": stated * 3.6,
        "relative to the vehicle instead of over the ground": stated + ego,
        "the ego vehicle's own velocity added once too often": stated - ego,
        "along the world's axes instead of the vehicle's": local,
        "the sign is reversed": -stated,
        **{reading: stated + (1.0 - factor) * ego for reading, factor in EGO_SPEEDS.items()},
    }
    off = {reading: np.linalg.norm(values - truth, axis=1) for reading, values in readings.items()}
    allowed = np.maximum(OFF_MPS, OFF_SHARE * np.maximum(*(np.linalg.norm(v, axis=1) for v in (stated, truth))))
    errors = {reading: float(np.mean(values)) for reading, values in off.items()}
    return errors, bool(np.mean(off[AS_STATED] > allowed) > 0.5)


def _mean_velocities(path: TrackPath, first: int, last: int) -> tuple[Array, Array]:
    """Mean velocities of the object, by its positions, and of the ego vehicle over a stretch, (3,) each, world axes."""
    seconds, rows = path.seconds, slice(first, last + 1)
    velocity_mps = (path.positions_m[last] - path.positions_m[first]) / (seconds[last] - seconds[first])
    return velocity_mps, _mean(seconds[rows], path.ego_mps[rows])


def _mean(seconds: Array, values: Array) -> Array:
    return np.asarray(np.trapezoid(values, seconds, axis=0) / (seconds[-1] - seconds[0]))


def _chunks(path: TrackPath) -> Iterator[tuple[int, int]]:
    """First and last row of stretches of about a second."""
    first = 0
    while first < len(path.times_ns) - 1:
        last = int(np.searchsorted(path.times_ns, path.times_ns[first] + CHUNK_NS, side="right")) - 1
        last = min(max(last, first + 1), len(path.times_ns) - 1)
        if SHORTEST_CHUNK_S <= (path.times_ns[last] - path.times_ns[first]) / SECOND_NS <= 2.0:
            yield first, last
        first = last

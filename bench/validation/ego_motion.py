"""Ego-motion: limits that no road vehicle exceeds, and the stated path tried against what the lidar saw.

Points of two sweeps are placed in the world by the stated path and by what it would be if speed were km/h, yaw rate
degrees, a sign reversed, and so on. Where another reading brings the sweeps clearly closer together, it is the right
one; between plain walls, where none does, nothing is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import advance_twist, twist_between
from bench.lidar import LidarSweep
from bench.recordings import Recording
from bench.reference.sweeps import pose_sweep
from bench.validation.findings import (
    EGO_SIDEWAYS_MPS2,
    EGO_TOP_SPEED_MPS,
    EGO_TOP_TURN_RADPS,
    Finding,
    occurrences,
    sweep_times,
)
from bench.validation.motion import box_of

SECOND_NS = 1_000_000_000
SPEED_WINDOW_NS = 200_000_000  # single steps of measured poses jitter
JUMP_MPS2 = 40.0  # a crash; also what a pose that jumps by half a metre between two 10 Hz poses gives


def check_ego_limits(recording: Recording) -> Iterator[Finding]:
    """Speed, turn, cornering and jumps of the path, from poses a fifth of a second apart."""
    path = recording.trajectory
    times_ns = path.timestamps_ns
    after = np.minimum(np.searchsorted(times_ns, times_ns + SPEED_WINDOW_NS), len(times_ns) - 1)
    before = np.flatnonzero(times_ns[after] > times_ns)
    after = after[before]
    turns, paths_m = twist_between(
        path.rotations[before], path.positions_m[before], path.rotations[after], path.positions_m[after]
    )
    seconds = (times_ns[after] - times_ns[before]) / SECOND_NS
    near = seconds <= 1.0
    if not near.any():
        return
    before, seconds = before[near], seconds[near]
    speed = np.linalg.norm(paths_m[near], axis=1) / seconds
    turn = np.linalg.norm(turns[near], axis=1) / seconds
    tests = (
        ("ego-speed", "speed", speed, EGO_TOP_SPEED_MPS, "m/s", "km/h instead of m/s?"),
        ("ego-turn", "yaw rate", turn, EGO_TOP_TURN_RADPS, "rad/s", "degrees per second instead of rad/s?"),
        ("ego-cornering", "speed times yaw rate", speed * turn, EGO_SIDEWAYS_MPS2, "m/s2",
         "km/h instead of m/s, or degrees instead of radians?"),
    )  # fmt: skip
    for check, what, values, limit, unit, hint in tests:
        beyond = values > limit
        if beyond.any():
            yield Finding(
                check=check,
                field=what,
                expected=f"at most {limit:.3g} {unit}",
                got=f"up to {values.max():.3g} {unit}",
                hint=hint,
                **occurrences(beyond, times_ns[before]),
            )
            return  # consequences of a wrong unit are not reported again
    yield from _jumps(recording)


def _jumps(recording: Recording) -> Iterator[Finding]:
    """Poses that leave the line of their neighbours."""
    path = recording.trajectory
    if len(path.timestamps_ns) < 4:
        return
    seconds = np.diff(path.timestamps_ns) / SECOND_NS
    velocity = np.diff(path.positions_m, axis=0) / seconds[:, None]
    change_mps = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    span_s = (seconds[1:] + seconds[:-1]) / 2
    away_m = change_mps * np.minimum(seconds[1:], seconds[:-1])
    jumps = (change_mps / span_s > JUMP_MPS2) & (away_m > 0.3)
    if jumps.any():
        yield Finding(
            check="ego-jump",
            field="position",
            expected="a path without jumps",
            got=f"{int(jumps.sum())} places where it leaves its line, by up to {away_m[jumps].max():.2f} m",
            **occurrences(jumps, path.timestamps_ns[1:-1]),
        )


MOST_PAIRS = 6
APART_NS = (90_000_000, 350_000_000)  # of two sweeps that are compared; nearer ones share points
WINDOW_NS = 300_000_000  # of poses around a pair
LEAST_MOTION = 0.15  # m of path, or 10 rad/s-metres of turn, between the sweeps under any reading
REACH_M = 40.0
HEIGHTS_M = (0.3, 4.0)  # above the road: the road itself looks alike everywhere
SOURCE_POINTS, TARGET_POINTS, LEAST_POINTS = 1500, 20_000, 150
BOX_SLACK_M = 1.0
FAR_M = 0.5  # a point further from the other sweep counts as this: it was hidden there, or moves
SURFACE_POINTS = 6
CLEARLY = 0.75  # of the stated reading's distance
CLEARLY_M = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A reading of the stated ego-motion: factors of its speed and yaw rate."""

    speed: float
    turn: float
    field: str
    description: str


DEGREE = float(np.pi / 180)
STATED = Reading(speed=1.0, turn=1.0, field="", description="as stated")
READINGS = (
    Reading(speed=1 / 3.6, turn=1.0, field="speed", description="km/h read as m/s"),
    Reading(speed=3.6, turn=1.0, field="speed", description="m/s read as km/h"),
    Reading(speed=0.44704, turn=1.0, field="speed", description="mph read as m/s"),
    Reading(speed=0.01, turn=1.0, field="speed", description="centimetres read as metres"),
    Reading(
        speed=-1.0, turn=1.0, field="gear or sign of the speed", description="the wrong way, forwards for backwards"
    ),
    Reading(speed=0.0, turn=0.0, field="speed", description="a stationary vehicle"),
    Reading(speed=1.0, turn=DEGREE, field="yaw rate", description="degrees per second read as rad/s"),
    Reading(speed=1.0, turn=1 / DEGREE, field="yaw rate", description="rad/s read as degrees per second"),
    Reading(speed=1.0, turn=-1.0, field="sign of the yaw rate", description="positive to the right instead of left"),
    Reading(speed=1 / 3.6, turn=DEGREE, field="speed and yaw rate", description="km/h and degrees per second"),
    Reading(speed=1.0, turn=0.0, field="yaw rate", description="a vehicle that drives straight"),
)


def check_path(recording: Recording) -> Iterator[Finding]:
    """Try readings of the ego-motion on up to six pairs of sweeps; silent where the lidar cannot decide."""
    totals: dict[Reading, list[float]] = {reading: [] for reading in (STATED, *READINGS)}
    for first, second in _pairs(recording):
        try:
            sweeps = recording.sweeps[first].read(), recording.sweeps[second].read()
        except DataError:
            continue  # reported by the check of the sweeps
        window = _window(recording.trajectory, sweeps[0].timestamp_ns, sweeps[1].timestamp_ns)
        source, target = (
            _upright(sweep, recording, most) for sweep, most in zip(sweeps, (SOURCE_POINTS, TARGET_POINTS), strict=True)
        )
        if window is None or min(len(source), len(target)) < LEAST_POINTS:
            continue
        distances = {}
        for reading in totals:
            path = _read_as(window, reading)
            one, other = (pose_sweep(sweep, path, recording.vehicle_from_lidar) for sweep in sweeps)
            if one is None or other is None:
                break
            distances[reading] = _distance(one.points_world(source), other.points_world(target))
        else:
            for reading, distance in distances.items():
                totals[reading].append(distance)
    if len(totals[STATED]) < 2:
        return
    means = {reading: float(np.mean(distances)) for reading, distances in totals.items()}
    best = min(READINGS, key=lambda reading: means[reading])
    nearer = sum(one < other for one, other in zip(totals[best], totals[STATED], strict=True))
    if means[best] < CLEARLY * means[STATED] - CLEARLY_M and nearer > 0.8 * len(totals[best]):
        yield Finding(
            check="ego-motion-unit",
            field=best.field,
            expected="a path on which neighbouring lidar sweeps meet",
            got=f"sweeps {100 * means[STATED]:.0f} cm apart; {100 * means[best]:.0f} cm if this is {best.description}",
            hint="check unit and sign",
            times=len(totals[best]),
        )


def _pairs(recording: Recording) -> list[tuple[int, int]]:
    """Pairs of sweeps between which the vehicle moves, spread over the recording."""
    times_ns = sweep_times(recording)
    if len(times_ns) < 2:
        return []
    partner = np.searchsorted(times_ns, times_ns + APART_NS[0])
    found = [
        (i, int(j)) for i, j in enumerate(partner) if j < len(times_ns) and times_ns[j] - times_ns[i] < APART_NS[1]
    ]
    if not found:
        return []
    rotations, positions_m, valid = recording.trajectory.at(times_ns)
    moved = []
    for i, j in found:
        if valid[i] and valid[j]:
            turn = float(np.linalg.norm(rotations[i] - rotations[j]))
            if np.linalg.norm(positions_m[j] - positions_m[i]) + 10.0 * turn > LEAST_MOTION:
                moved.append((i, j))
    chosen = np.unique(np.linspace(0, len(moved) - 1, min(MOST_PAIRS, len(moved))).astype(int))
    return [moved[k] for k in chosen]


def _window(path: Trajectory, first_ns: int, last_ns: int) -> Trajectory | None:
    rows = np.flatnonzero((path.timestamps_ns > first_ns - WINDOW_NS) & (path.timestamps_ns < last_ns + WINDOW_NS))
    if len(rows) < 2:
        return None
    return Trajectory(
        source=path.source,
        timestamps_ns=path.timestamps_ns[rows],
        rotations=path.rotations[rows],
        positions_m=path.positions_m[rows],
    )


def _read_as(path: Trajectory, reading: Reading) -> Trajectory:
    """The path when each step's twist is scaled."""
    turns, paths_m = twist_between(path.rotations[:-1], path.positions_m[:-1], path.rotations[1:], path.positions_m[1:])
    steps, advances_m = advance_twist(reading.turn * turns, reading.speed * paths_m, np.ones(len(turns)))
    rotations, positions_m = [path.rotations[0].as_matrix()], [path.positions_m[0]]
    for step, advance_m in zip(steps.as_matrix(), advances_m, strict=True):
        positions_m.append(positions_m[-1] + rotations[-1] @ advance_m)
        rotations.append(rotations[-1] @ step)
    return replace(path, rotations=Rotation.from_matrix(np.array(rotations)), positions_m=np.array(positions_m))


def _distance(source: NDArray[np.float64], target: NDArray[np.float64]) -> float:
    """Mean distance of points to the surfaces on which the nearest of others lie, m; those far away count as `FAR_M`.

    Not to the points themselves: along a plain wall the beams of a stationary vehicle hit the same places again, so
    that its points meet better than those of the true path. Each surface is the ellipsoid of a few neighbours; what
    lies within two standard deviations along an axis of it is not away.
    """
    distances_m, rows = cKDTree(target).query(source, k=SURFACE_POINTS)
    nearest_m = np.asarray(distances_m)[:, 0]
    neighbours = target[rows]
    middles = neighbours.mean(axis=1)
    offsets = neighbours - middles[:, None]
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets) / SURFACE_POINTS)
    along_m = np.abs(np.einsum("nij,ni->nj", axes, source - middles))
    beyond_m = np.linalg.norm(np.maximum(along_m - 2.0 * np.sqrt(np.maximum(variances, 0.0)), 0.0), axis=1)
    return float(np.where(nearest_m < FAR_M, np.minimum(beyond_m, nearest_m), FAR_M).mean())


def _upright(sweep: LidarSweep, recording: Recording, most: int) -> NDArray[np.intp]:
    """Rows of points on what stands beside the road and belongs to no annotated object."""
    points = recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
    road_m = min(c.vehicle_from_camera.translation_m[2] - c.road.height_m for c in recording.cameras.values())
    height_m = points[:, 2] - road_m
    near = np.hypot(points[:, 0], points[:, 1]) < REACH_M
    rows = np.flatnonzero(near & (height_m > HEIGHTS_M[0]) & (height_m < HEIGHTS_M[1]))
    rows = rows[~on_objects(points[rows], sweep.timestamp_ns, recording)]
    return np.asarray(rows[np.random.default_rng(0).permutation(len(rows))[:most]])


def on_objects(points_vehicle: NDArray[np.float64], time_ns: int, recording: Recording) -> NDArray[np.bool_]:
    """Points on annotated objects: those that drive along would suggest a stationary vehicle."""
    inside = np.zeros(len(points_vehicle), dtype=bool)
    for track in recording.tracks:
        state = min(track.states, key=lambda state: abs(state.timestamp_ns - time_ns), default=None)
        box = None if state is None or abs(state.timestamp_ns - time_ns) > WINDOW_NS else box_of(state.shape)
        if box is not None:
            local = box.vehicle_from_object.inverse().apply(points_vehicle)
            inside |= (np.abs(local) < box.size_m / 2 + BOX_SLACK_M).all(axis=1)
    return inside

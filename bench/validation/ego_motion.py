"""Ego-motion: limits that no road vehicle exceeds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.geometry import twist_between
from bench.recordings import Recording
from bench.times import SECOND_NS
from bench.validation.drive import boxes_near
from bench.validation.findings import EGO_SIDEWAYS_MPS2, EGO_TOP_SPEED_MPS, EGO_TOP_TURN_RADPS, Finding, occurrences

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


BOX_SLACK_M = 1.0
NEAR_NS = 300_000_000  # of a state to a sweep


def on_objects(points_vehicle: NDArray[np.float64], time_ns: int, recording: Recording) -> NDArray[np.bool_]:
    """Points on annotated objects: those that drive along would suggest a stationary vehicle."""
    inside = np.zeros(len(points_vehicle), dtype=bool)
    for box in boxes_near(recording, time_ns, within_ns=NEAR_NS):
        local = box.vehicle_from_object.inverse().apply(points_vehicle)
        inside |= (np.abs(local) < box.size_m / 2 + BOX_SLACK_M).all(axis=1)
    return inside

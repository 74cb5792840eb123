"""Ego-motion that no road vehicle can have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.geometry import twist_between
from bench.recordings import Recording
from bench.validation.findings import (
    EGO_SIDEWAYS_MPS2,
    EGO_TOP_SPEED_MPS,
    EGO_TOP_TURN_RADPS,
    Finding,
    Severity,
)

SECOND_NS = 1_000_000_000
WINDOW_NS = 200_000_000  # single steps of measured poses jitter
JUMP_MPS2 = 40.0  # a crash; also what a pose that jumps by half a metre between two 10 Hz poses gives


def check_ego_limits(recording: Recording) -> Iterator[Finding]:
    """Speed, turn, cornering and jumps of the path, from poses a fifth of a second apart."""
    path = recording.trajectory
    times_ns = path.timestamps_ns
    after = np.minimum(np.searchsorted(times_ns, times_ns + WINDOW_NS), len(times_ns) - 1)
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
        ("ego-speed", "speed", speed, EGO_TOP_SPEED_MPS, "m/s", "km/h where m/s are due?"),
        ("ego-turn", "yaw rate", turn, EGO_TOP_TURN_RADPS, "rad/s", "degrees per second where rad/s are due?"),
        ("ego-cornering", "speed times yaw rate", speed * turn, EGO_SIDEWAYS_MPS2, "m/s2",
         "km/h where m/s, or degrees where radians are due?"),
    )  # fmt: skip
    for check, what, values, limit, unit, hint in tests:
        beyond = values > limit
        if beyond.any():
            yield Finding(
                check=check,
                file=path.source,
                field=what,
                expected=f"at most {limit:.3g} {unit}",
                got=f"up to {values.max():.3g} {unit}",
                do=hint,
                times=int(beyond.sum()),
                timestamp_ns=int(times_ns[before][np.argmax(beyond)]),
            )
            return  # what follows from a wrong unit is not told again
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
            severity=Severity.ERROR,
            file=path.source,
            field="position",
            expected="a path without jumps",
            got=f"{int(jumps.sum())} places where it leaves its line, by up to {away_m[jumps].max():.2f} m",
            times=int(jumps.sum()),
            timestamp_ns=int(path.timestamps_ns[1:-1][np.argmax(jumps)]),
        )

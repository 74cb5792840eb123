"""Findings of the checks, and the limits beyond which a value looks wrong.

What bodies and vehicles can be and do.

The spans are wide: they hold every everyday case with its annotation's slack, so that what lies beyond is wrong.

Sources:
    Sizes of vehicles: Directive 96/53/EC (width 2.6 m, height 4 m, length 18.75 m; long combinations 25.25 m).
    People: ISO 7250-3, 99th percentile of stature 1.96 m, span of arms about as much.
    Speeds: running records (12.4 m/s on foot), and 250 km/h on a motorway.
    Turning: a car on a dry road holds about 1 g sideways.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError

DEGREE = float(np.pi / 180)


class Severity(StrEnum):
    """Certainty that something is wrong."""

    ERROR = "error"  # wrong: a file that cannot be used, or a value that cannot be
    WARNING = "warning"  # unusual: correct in some recordings, worth checking


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One fault, reported once however often it occurs.

    Attributes:
        check: name of the check, for example "clock-drift".
        severity: how sure it is.
        recording: name; empty for the data set as a whole.
        file: the file, or the folder where none can be named; empty for the one that `report.CHECKS` names.
        field: the field, camera or object in it; None for the whole file.
        expected: the correct state.
        got: what was found.
        hint: what the user can do about it.
        times: how often it was found.
        timestamp_ns: of the first time; None where no time belongs to it.
    """

    check: str
    severity: Severity = Severity.ERROR
    recording: str = ""
    file: str = ""
    field: str | None = None
    expected: str
    got: str
    hint: str = ""
    times: int = 1
    timestamp_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Undecided:
    """A quantity that a recording cannot tell.

    Attributes:
        about: the quantity.
        why: what is missing.
    """

    about: str
    why: str


def unusable(error: DataError, *, check: str = "file", timestamp_ns: int | None = None) -> Finding:
    """Finding of a file that cannot be read, from its reader's error."""
    fields = {name: getattr(error, name) for name in ("file", "field", "expected", "got", "hint")}
    return Finding(check=check, timestamp_ns=timestamp_ns, **fields)


class Occurrences(TypedDict):
    """Number of times that something was found, and the first time, as `Finding` takes it."""

    times: int
    timestamp_ns: int


def occurrences(at: NDArray[np.bool_], times_ns: NDArray[np.int64]) -> Occurrences:
    """Number of elements that are True, at least one, and the time of the first."""
    return {"times": int(at.sum()), "timestamp_ns": int(times_ns[np.argmax(at)])}


Span = tuple[float, float]

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyLimits:
    """Spans that an annotated object of a class stays within.

    Attributes:
        long_side_m: the longer horizontal side.
        short_side_m: the shorter one.
        height_m: height.
        top_speed_mps: over the ground.
        top_turn_radps: about its own centre.
    """

    long_side_m: Span
    short_side_m: Span
    height_m: Span
    top_speed_mps: float
    top_turn_radps: float


# long side, short side, height, top speed, top turn
_BODIES: dict[str, tuple[Span, Span, Span, float, float]] = {
    "pedestrian": ((0.15, 1.7), (0.1, 1.5), (0.4, 2.4), 12.0, 7.0),
    "cyclist": ((0.4, 3.2), (0.15, 1.6), (0.5, 2.7), 60.0, 4.0),
    "vehicle": ((1.0, 26.0), (0.5, 3.7), (0.5, 5.0), 75.0, 2.5),
    "animal": ((0.1, 3.5), (0.05, 1.7), (0.1, 2.8), 20.0, 12.0),
}
BODIES = {
    name: BodyLimits(long_side_m=long, short_side_m=short, height_m=height, top_speed_mps=speed, top_turn_radps=turn)
    for name, (long, short, height, speed, turn) in _BODIES.items()
}

EGO_TOP_SPEED_MPS = 75.0
EGO_TOP_TURN_RADPS = 1.5  # a tight turn at walking pace is 0.5
EGO_SIDEWAYS_MPS2 = 1.3 * GRAVITY_MPS2
CAMERA_HEIGHT_M: Span = (0.1, 4.5)
LIDAR_HEIGHT_M: Span = (0.1, 5.0)
SENSOR_OUTSIDE_M = 2.5  # beyond the ego vehicle's outline
LIDAR_REACH_M = 400.0

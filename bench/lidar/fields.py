"""From the fields of a point cloud, by whatever names and units, to a sweep: the same for files and for messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError
from bench.lidar.sweep import LidarSweep
from bench.times import SECOND_NS

TimeUnit = Literal["s", "ms", "us", "ns"]
UNITS_NS: Mapping[TimeUnit, int] = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
LATEST_NS = 2**62
SHORTEST_SWEEP_NS, FARTHEST_TIME_NS = 10_000_000, 1_000_000_000  # a point further from its sweep is of another clock

UNITS_IN_NAMES: Mapping[str, TimeUnit] = {
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanoseconds"), "ns"),
    **dict.fromkeys(("us", "usec", "usecs", "microsec", "microseconds"), "us"),
    **dict.fromkeys(("ms", "msec", "msecs", "millisec", "milliseconds"), "ms"),
}
_UNITS = "|".join((*UNITS_IN_NAMES, "secs", "sec", "seconds", "s"))
_BEFORE = "offset|point|gps|relative|rel|delta|scan|sweep|lidar|laser|firing|fire|return|pulse|beam|packet|d"
_AFTER = f"offsets?|from|since|scan|start|sweep|relative|rel|{_UNITS}"
# The words of a name without what is between them: point_time_offset, timeStamp, offset_ns, ts.
TIME_NAME = re.compile(
    rf"(?:{_BEFORE})*(?:timestamps?|tstamps?|stamps?|times?|t)(?:{_AFTER})*|(?:{_BEFORE})*offsets?(?:{_UNITS})"
)
UNIT_OF_NAME = re.compile(rf".*?({'|'.join(sorted(UNITS_IN_NAMES, key=len, reverse=True))})")

GPS_EPOCH_S, ADJUSTED_S, WEEK_S = 315_964_800, 1_000_000_000, 604_800  # adjusted GPS time, as LAS files have it
LEAP_SECONDS = ((1_483_228_800, 18), (1_435_708_800, 17), (1_341_100_800, 16), (1_230_768_000, 15), (0, 14))
CLOCKS: Mapping[str, Callable[[int], int]] = {  # zero of a clock, ns since 1970, for a sweep at a time
    "the sweep's clock": lambda _: 0,
    "GPS seconds less 1e9": lambda ns: (GPS_EPOCH_S + ADJUSTED_S) * SECOND_NS - _leap_ns(ns),
    "GPS seconds": lambda ns: GPS_EPOCH_S * SECOND_NS - _leap_ns(ns),
    "seconds of the GPS week": lambda ns: ns - (ns + _leap_ns(ns) - GPS_EPOCH_S * SECOND_NS) % (WEEK_S * SECOND_NS),
    "seconds of the hour": lambda ns: ns - ns % (3600 * SECOND_NS),
}


def is_time(field: str) -> bool:
    """Return True for a field with the times of points, by its name."""
    return TIME_NAME.fullmatch(_letters(field)) is not None


def sweep_of(
    points: NDArray[np.floating],
    fields: Mapping[str, NDArray[Any]],
    timestamp_ns: int,
    *,
    name: Path,
    stamp_ns: int | None = None,
    time_field: str | None = None,
    time_unit: TimeUnit | None = None,
    drop_origin: bool = False,
    time_hint: str = "",
) -> LidarSweep:
    """The points of a cloud that have a position, with their times.

    Returns without a position are left out, and the sweep says which rows of the cloud the others were.

    Args:
        points: (M, 3), m; a lost return has no finite position.
        fields: (M,) each, by the names that the cloud has for them.
        timestamp_ns: the sweep's reference time.
        name: of the cloud, for messages.
        stamp_ns: the same in the clock of points that have times of a clock; None for `timestamp_ns`.
        time_field: the field with times; None for the first with a name of one.
        time_unit: its unit; None for the one by which the sweep lasts 10 ms to a second, which only one can be.
        drop_origin: leave out points at the lidar itself, too, which some drivers store for lost returns.
        time_hint: the remedy where times cannot be used.

    Raises:
        DataError: a field of times that is missing, or times that are none of this sweep.
    """
    kept = np.isfinite(points).all(axis=1)
    if drop_origin:
        kept &= (points != 0).any(axis=1)
    rows = None if kept.all() else np.flatnonzero(kept)
    if time_field is not None and time_field not in fields:
        raise DataError(name, field="fields", expected=f"the time field {time_field}", got=", ".join(fields) or "none")
    named = time_field or next((field for field in fields if is_time(field)), None)
    offsets_ns = None
    if named is not None:
        offsets_ns = point_times(
            fields[named] if rows is None else fields[named][rows],
            timestamp_ns if stamp_ns is None else stamp_ns,
            unit=time_unit or _unit_in(named),
            name=name,
            field=named,
            hint=time_hint,
        )
    read = () if named is None or offsets_ns is None else (named,)
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=np.ascontiguousarray(points if rows is None else points[rows]),
        time_offset_ns=offsets_ns,
        stored_rows=rows,
        stored_count=len(points),
        read_fields=read,
        unread_fields=tuple(field for field in fields if field not in read),
    )


def point_times(
    times: NDArray[Any],
    stamp_ns: int,
    *,
    unit: TimeUnit | None = None,
    name: Path,
    field: str,
    hint: str = "",
) -> NDArray[np.int64] | None:
    """(N,) int64, ns from the sweep's time; None where all times are equal, as where a tool had none.

    Arguments and errors are those of `sweep_of`.
    """
    finite = np.isfinite(times) if times.dtype.kind == "f" else np.ones(len(times), dtype=bool)
    if not finite.all():
        got = f"NaN or infinity in {int((~finite).sum())} rows, the first is {int(np.argmin(finite))}"
        raise DataError(name, field=field, expected="finite times", got=got)
    if not len(times) or times.min() == times.max():
        return None
    first, last = times.min(), times.max()
    span = float(last) - float(first)
    fits = [each for each, ns in UNITS_NS.items() if SHORTEST_SWEEP_NS <= span * ns < FARTHEST_TIME_NS]
    if unit is None and not fits:
        expected = "times of points that are 10 ms to a second apart, in s, ms, us or ns"
        raise DataError(name, field=field, expected=expected, got=f"{first} to {last}", hint=hint)
    unit_ns = UNITS_NS[unit or fits[0]]
    if not max(abs(float(first)), abs(float(last))) * unit_ns < LATEST_NS:
        expected = f"times within a second of the sweep at {stamp_ns} ns, or of 0"
        raise DataError(name, field=field, expected=expected, got=f"{first} to {last}", hint=hint)
    whole = times.dtype.kind != "f"  # nanoseconds since 1970 have more digits than a float
    first_ns = int(first) * unit_ns if whole else round(float(first) * unit_ns)
    since_first_ns = np.rint((times - first).astype(np.float64) * unit_ns).astype(np.int64)
    middle_ns = first_ns + int(since_first_ns.max()) // 2
    origins = {"the sweep's time": stamp_ns} | {clock: zero(stamp_ns) for clock, zero in CLOCKS.items()}
    away_ns = {origin: middle_ns + zero_ns - stamp_ns for origin, zero_ns in origins.items()}
    nearest = min(away_ns, key=lambda origin: abs(away_ns[origin]))
    offsets_ns = np.asarray(since_first_ns + (first_ns + origins[nearest] - stamp_ns))
    if max(abs(int(offsets_ns.min())), abs(int(offsets_ns.max()))) >= FARTHEST_TIME_NS:
        expected = f"times within a second of the sweep at {stamp_ns} ns, or of 0"
        got = f"{first} to {last}, in {unit or fits[0]} {abs(away_ns[nearest]) / SECOND_NS:.6g} s from it by {nearest}"
        raise DataError(name, field=field, expected=expected, got=got, hint=hint)
    return offsets_ns


def _leap_ns(unix_ns: int) -> int:
    """How far GPS time was ahead."""
    return next(leap for since_s, leap in LEAP_SECONDS if unix_ns >= since_s * SECOND_NS or not since_s) * SECOND_NS


def _unit_in(field: str) -> TimeUnit | None:
    """The unit that a name ends with."""
    unit = UNIT_OF_NAME.fullmatch(_letters(field))
    return UNITS_IN_NAMES[unit[1]] if unit is not None else None


def _letters(field: str) -> str:
    return re.sub(r"[^a-z0-9]", "", field.lower())

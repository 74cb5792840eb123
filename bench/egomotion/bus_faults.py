"""Everything that is wrong with a file of bus signals."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path

from bench.egomotion.odometry import LARGEST_SIGNAL
from bench.errors import DataError

COLUMNS = ("timestamp_ns", "speed_mps", "yaw_rate_radps")
MOST_FAULTS = 200
LARGEST_TIME_NS = 2**63 - 1


def bus_signal_faults(path: Path) -> tuple[DataError, ...]:
    """All that `read_bus_signals` would refuse of a file with the usual columns; at most 200 rows are told.

    The file is read row by row.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader((line for line in file if not line.startswith("#")), skipinitialspace=True)
            absent = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
            if absent:
                got = ", ".join(rows.fieldnames or ()) or "no columns"
                return tuple(DataError(path, field=n, expected="a column of this name", got=got[:200]) for n in absent)
            return tuple(islice(_row_faults(path, rows), MOST_FAULTS))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return (
            DataError(path, expected="a table with a header, separated by commas", got=" ".join(str(error).split())),
        )


def _row_faults(path: Path, rows: Iterable[Mapping[str, str | None]]) -> Iterator[DataError]:
    last_ns: int | None = None
    count = 0
    for count, row in enumerate(rows, start=1):
        time_ns = _whole(row["timestamp_ns"])
        field = f"timestamp_ns, row {count}"
        if time_ns is None:
            yield DataError(path, field=field, expected="a whole number of nanoseconds", got=repr(row["timestamp_ns"]))
        elif last_ns is not None and time_ns <= last_ns:
            yield DataError(path, field=field, expected="times that increase", got=f"{time_ns} after {last_ns}")
        last_ns = last_ns if time_ns is None else time_ns
        for name in COLUMNS[1:]:
            if not _is_finite(row[name]):
                yield DataError(path, field=f"{name}, row {count}", expected="a finite number", got=repr(row[name]))
            elif abs(float(row[name] or "")) > LARGEST_SIGNAL:
                field, expected = f"{name}, row {count}", f"at most {LARGEST_SIGNAL:g}"
                yield DataError(path, field=field, expected=expected, got=repr(row[name]))
    if count < 2:
        yield DataError(path, expected="at least two rows", got=str(count))


def _whole(text: str | None) -> int | None:
    try:
        value = int(text or "")
    except ValueError:
        return None
    return value if abs(value) <= LARGEST_TIME_NS else None


def _is_finite(text: str | None) -> bool:
    try:
        return math.isfinite(float(text or ""))
    except ValueError:
        return False

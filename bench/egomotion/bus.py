"""Signals of the vehicle's bus: reading, and planar odometry from them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError, refuse
from bench.geometry import advance_twist
from bench.plain_text import parsed_number
from bench.times import SECOND_NS, unit_hint

if TYPE_CHECKING:
    import pandas as pd

LARGEST_SIGNAL = 1e6  # m/s or rad/s; larger ones are no signals, and their sums no numbers
REVERSE_GEAR = re.compile(r"R[0-9]?|REV|REVERSE|-[0-9]+(\.0*)?")
OTHER_GEAR = re.compile(r"[PNDSLMBE]?[0-9]*(\.0*)?|PARK|NEUTRAL|DRIVE|SPORT|LOW|MANUAL|NONE|UNKNOWN")
LARGEST_TIME_NS = 2**63 - 1
SIGNALS = ("speed_mps", "yaw_rate_radps")
Source = str | Sequence[str] | float | None  # of a signal: its column, several whose mean is taken, or a constant


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BusSignals:
    """The vehicle's motion as its bus reports it.

    Attributes:
        source: the file.
        timestamps_ns: (N,) int64.
        speed_mps: (N,) float64, speed of the middle of the rear axle along x; negative backwards, or without sign where
            `gear` is known.
        yaw_rate_radps: (N,) float64, positive to the left.
        gear: (N,) str, "R" or a negative number in reverse; None where the bus does not report it.
    """

    source: str
    timestamps_ns: NDArray[np.int64]
    speed_mps: NDArray[np.float64]
    yaw_rate_radps: NDArray[np.float64]
    gear: NDArray[np.str_] | None = None

    def trajectory(self) -> Trajectory:
        """The path that the signals describe; see `planar_trajectory`."""
        return planar_trajectory(**{field.name: getattr(self, field.name) for field in fields(self)})


def planar_trajectory(
    *,
    source: str,
    timestamps_ns: NDArray[np.int64],
    speed_mps: NDArray[np.float64],
    yaw_rate_radps: NDArray[np.float64],
    gear: Sequence[str | int] | NDArray[Any] | None = None,
) -> Trajectory:
    """Integrate speed and yaw rate; the world's origin is the vehicle's at the first sample.

    Over each interval the vehicle runs an exact arc at the mean of the two samples' speeds and yaw rates.

    Args:
        source: file that the signals come from, for messages.
        timestamps_ns: (N,) int64, strictly increasing, N >= 2.
        speed_mps: (N,) float64, negative backwards.
        yaw_rate_radps: (N,) float64, positive to the left.
        gear: N gears; "R" or a negative number is reverse, and the speed then counts backwards whatever its sign. None
            where the speed has its sign.

    Raises:
        DataError: a word that is no gear, a value that is not finite, times that do not increase, or fewer than two
            samples.
    """
    columns = {"speed_mps": speed_mps, "yaw_rate_radps": yaw_rate_radps}
    for column, values in columns.items():
        if len(values) != len(timestamps_ns):
            raise DataError(source, field=column, expected=f"{len(timestamps_ns)} values", got=str(len(values)))
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise DataError(source, field=f"{column}, row {row + 1}", expected="a finite number", got=str(values[row]))
        if len(values) and np.abs(values).max() > LARGEST_SIGNAL:
            row = int(np.abs(values).argmax())
            expected = f"at most {LARGEST_SIGNAL:g}"
            raise DataError(source, field=f"{column}, row {row + 1}", expected=expected, got=str(values[row]))
    signed_mps = np.asarray(speed_mps, dtype=np.float64)
    if gear is not None:
        signed_mps = np.where(_in_reverse(gear, source), -np.abs(signed_mps), signed_mps)
    steps_s = np.diff(timestamps_ns) / SECOND_NS
    advance_m, turn_rad = np.zeros((len(steps_s), 3)), np.zeros((len(steps_s), 3))
    advance_m[:, 0] = _interval_means(signed_mps) * steps_s
    turn_rad[:, 2] = _interval_means(np.asarray(yaw_rate_radps, dtype=np.float64)) * steps_s
    _, arcs_m = advance_twist(turn_rad, advance_m, np.ones(len(steps_s)))
    yaw_rad = np.concatenate([[0.0], np.cumsum(turn_rad[:, 2])])
    rotations = Rotation.from_rotvec(yaw_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    positions_m = np.zeros((len(timestamps_ns), 3))
    if len(steps_s):
        np.cumsum(rotations[:-1].apply(arcs_m), axis=0, out=positions_m[1:])
    return Trajectory(source=source, timestamps_ns=timestamps_ns, rotations=rotations, positions_m=positions_m)


def _in_reverse(gear: Sequence[str | int] | NDArray[Any], source: str) -> NDArray[np.bool_]:
    """(N,) bool.

    Raises:
        DataError: a word that is no gear, and so perhaps reverse.
    """
    words = [str(word).strip().upper() for word in gear]
    for row, word in enumerate(words, start=1):
        if not (REVERSE_GEAR.fullmatch(word) or OTHER_GEAR.fullmatch(word)):
            expected = "R or a negative number in reverse; P, N, D or another number otherwise"
            raise DataError(source, field=f"gear, row {row}", expected=expected, got=repr(str(gear[row - 1])))
    return np.array([REVERSE_GEAR.fullmatch(word) is not None for word in words], dtype=bool)


def _interval_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def read_bus_signals(path: Path, *, columns: Mapping[str, Source] | None = None) -> BusSignals:
    """Read bus signals from a CSV file; lines that begin with "#" are comments.

    Args:
        path: the file.
        columns: what stands for `timestamp_ns`, `speed_mps`, `yaw_rate_radps` and `gear`: the name of a column, several
            names whose mean is taken, or a constant number. Signals that are not named keep their own names, and
            `gear` may be absent.

    Raises:
        DataError: a file, column or value that is missing or not a number, or times that do not increase.
    """
    table, columns = _read_table(path), columns or {}
    times_name = columns.get("timestamp_ns", "timestamp_ns")
    if not isinstance(times_name, str):
        raise DataError(path, field="timestamp_ns", expected="one column of times", got=repr(times_name))
    sources = [columns.get(name, name) for name in SIGNALS]
    gear_name = columns.get("gear", "gear")
    has_gear = isinstance(gear_name, str) and (gear_name in table or gear_name != "gear")
    refuse(_faults(path, table, times_name, [name for source in sources for name in _names(source)]))
    if has_gear and gear_name not in table:
        raise _absent(path, table, str(gear_name))
    speed_mps, yaw_rate_radps = (_signal(table, source) for source in sources)
    return BusSignals(
        source=str(path),
        timestamps_ns=np.array([int(text) for text in table[times_name]], dtype=np.int64),
        speed_mps=speed_mps,
        yaw_rate_radps=yaw_rate_radps,
        gear=table[gear_name].to_numpy(dtype=object).astype(np.str_) if has_gear else None,
    )


def _read_table(path: Path) -> pd.DataFrame:
    import pandas as pd  # 0.4 s, and only recordings with bus signals need it

    try:
        # As text, so that times of 19 digits do not pass through floating point.
        return pd.read_csv(path, dtype=str, keep_default_na=False, comment="#", skipinitialspace=True)
    except OSError as error:
        raise DataError(path, expected="a readable file", got=error.strerror or str(error)) from error
    except (ValueError, UnicodeDecodeError) as error:
        raise DataError(
            path, expected="a table with a header, separated by commas", got=" ".join(str(error).split())
        ) from error


def _faults(path: Path, table: pd.DataFrame, times_name: str, signal_names: Sequence[str]) -> Iterator[DataError]:
    names = (times_name, *signal_names)
    absent = [name for name in names if name not in table]
    if absent:
        yield from (_absent(path, table, name) for name in absent)
        return
    times = [_number(text) for text in table[times_name]]
    hint = unit_hint(times)
    if hint and not all(before < after and after.is_integer() for before, after in pairwise(times)):
        got = f"{', '.join(table[times_name][:3])} ..."
        yield DataError(path, field=times_name, expected="whole nanoseconds that increase", got=got, hint=hint)
        return
    last_ns: int | None = None
    for row, (time, *signals) in enumerate(zip(*(table[name] for name in names), strict=True), start=1):
        time_ns, field = _whole(time), f"{times_name}, row {row}"
        if time_ns is None:
            yield DataError(path, field=field, expected="a whole number of nanoseconds", got=repr(time))
        elif last_ns is not None and time_ns <= last_ns:
            yield DataError(path, field=field, expected="times that increase", got=f"{time_ns} after {last_ns}")
        last_ns = last_ns if time_ns is None else time_ns
        for name, text in zip(signal_names, signals, strict=True):
            value, field = _number(text), f"{name}, row {row}"
            if not math.isfinite(value):
                yield DataError(path, field=field, expected="a finite number", got=repr(text))
            elif abs(value) > LARGEST_SIGNAL:
                yield DataError(path, field=field, expected=f"at most {LARGEST_SIGNAL:g}", got=repr(text))


def _absent(path: Path, table: pd.DataFrame, name: str) -> DataError:
    got = ", ".join(map(str, table.columns))[:200] or "no columns"
    return DataError(path, field=name, expected="a column of this name", got=got)


def _whole(text: object) -> int | None:
    value = int(str(text)) if re.fullmatch(r"\s*[+-]?[0-9]{1,19}\s*", str(text), re.ASCII) else LARGEST_TIME_NS + 1
    return value if abs(value) <= LARGEST_TIME_NS else None


def _number(text: object) -> float:
    return parsed_number(str(text))


def _names(source: Source) -> Sequence[str]:
    if isinstance(source, int | float) or source is None:
        return ()
    return (source,) if isinstance(source, str) else source


def _signal(table: pd.DataFrame, source: Source) -> NDArray[np.float64]:
    if isinstance(source, int | float):
        return np.full(len(table), float(source))
    return np.asarray(np.mean([[float(text) for text in table[name]] for name in _names(source)], axis=0))

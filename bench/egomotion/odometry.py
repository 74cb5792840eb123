"""Planar odometry from wheel speed and yaw rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import SECOND_NS, Trajectory
from bench.errors import DataError
from bench.geometry import advance_twist

if TYPE_CHECKING:
    import pandas as pd

LARGEST_SIGNAL = 1e6  # m/s or rad/s; larger ones are no signals, and their sums no numbers
REVERSE_GEARS = frozenset({"R", "REVERSE", "-1", "-1.0"})
BUS_COLUMNS: Mapping[str, str | Sequence[str] | float | None] = {
    "timestamp_ns": "timestamp_ns",
    "speed_mps": "speed_mps",
    "yaw_rate_radps": "yaw_rate_radps",
    "gear": "gear",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BusSignals:
    """What the vehicle's bus says of its motion.

    Attributes:
        source: the file.
        timestamps_ns: (N,) int64.
        speed_mps: (N,) float64, speed of the middle of the rear axle along x; negative backwards, or without sign where
            `gear` tells.
        yaw_rate_radps: (N,) float64, positive to the left.
        gear: (N,) str, "R" or "-1" in reverse; None where the bus does not tell.
    """

    source: str
    timestamps_ns: NDArray[np.int64]
    speed_mps: NDArray[np.float64]
    yaw_rate_radps: NDArray[np.float64]
    gear: NDArray[np.str_] | None = None

    def trajectory(self) -> Trajectory:
        """The path that the signals describe; see `planar_trajectory`."""
        return planar_trajectory(
            source=self.source,
            timestamps_ns=self.timestamps_ns,
            speed_mps=self.speed_mps,
            yaw_rate_radps=self.yaw_rate_radps,
            gear=self.gear,
        )


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
        gear: N gears; "R" or -1 is reverse, and the speed then counts backwards whatever its sign. None where the
            speed has its sign.

    Raises:
        DataError: a value that is not finite, times that do not increase, or fewer than two samples.
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
    signed_mps = _signed(np.asarray(speed_mps, dtype=np.float64), gear)
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


def read_bus_signals(
    path: Path, *, columns: Mapping[str, str | Sequence[str] | float | None] | None = None
) -> BusSignals:
    """Read bus signals from a CSV file; lines that begin with "#" are comments.

    Args:
        path: the file.
        columns: what stands for `timestamp_ns`, `speed_mps`, `yaw_rate_radps` and `gear`: the name of a column, several
            names whose mean is taken, or a constant number. Signals that are not named keep their own names, and
            `gear` may be absent.

    Raises:
        DataError: a file, column or value that is missing or not a number, or times that do not increase.
    """
    table = _read_table(path)
    expected = {**BUS_COLUMNS, **(columns or {})}
    times_name = expected["timestamp_ns"]
    if not isinstance(times_name, str):
        raise DataError(path, field="timestamp_ns", expected="one column of times", got=repr(times_name))
    gear_name = expected["gear"]
    has_gear = isinstance(gear_name, str) and (gear_name in table or gear_name != "gear")
    return BusSignals(
        source=str(path),
        timestamps_ns=_times(table, times_name, path),
        speed_mps=_signal(table, expected["speed_mps"], path),
        yaw_rate_radps=_signal(table, expected["yaw_rate_radps"], path),
        gear=_column(table, str(gear_name), path).astype(np.str_) if has_gear else None,
    )


def _signed(speed_mps: NDArray[np.float64], gear: Sequence[str | int] | NDArray[Any] | None) -> NDArray[np.float64]:
    if gear is None:
        return speed_mps
    reverse = np.array([str(g).strip().upper() in REVERSE_GEARS for g in gear], dtype=bool)
    return np.where(reverse, -np.abs(speed_mps), speed_mps)


def _interval_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


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


def _times(table: pd.DataFrame, name: str, path: Path) -> NDArray[np.int64]:
    texts = _column(table, name, path)
    times_ns = np.zeros(len(texts), dtype=np.int64)
    for row, text in enumerate(texts):
        try:
            times_ns[row] = int(text)
        except (ValueError, OverflowError):
            field = f"{name}, row {row + 1}"
            raise DataError(path, field=field, expected="a whole number of nanoseconds", got=repr(text)) from None
        if row and times_ns[row] <= times_ns[row - 1]:
            got = f"{times_ns[row]} after {times_ns[row - 1]}"
            raise DataError(path, field=f"{name}, row {row + 1}", expected="times that increase", got=got)
    return times_ns


def _signal(table: pd.DataFrame, source: str | Sequence[str] | float | None, path: Path) -> NDArray[np.float64]:
    if isinstance(source, int | float):
        return np.full(len(table), float(source))
    names = [source] if isinstance(source, str) else list(source or ())
    return np.asarray(np.mean([_numbers(table, name, path) for name in names], axis=0))


def _numbers(table: pd.DataFrame, name: str, path: Path) -> NDArray[np.float64]:
    texts = _column(table, name, path)
    values = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        with suppress(ValueError):
            values[row] = float(text)
        if not np.isfinite(values[row]):
            raise DataError(path, field=f"{name}, row {row + 1}", expected="a finite number", got=repr(text))
    return values


def _column(table: pd.DataFrame, name: str, path: Path) -> NDArray[Any]:
    if name not in table:
        got = ", ".join(map(str, table.columns))[:200] or "no columns"
        raise DataError(path, field=name, expected="a column of this name", got=got)
    return table[name].to_numpy(dtype=object)

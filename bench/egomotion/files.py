"""Ego-motion in files: signals of the vehicle's bus as CSV, and poses in TUM form, as evo and many tools write them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import open_regular
from bench.egomotion.trajectory import Trajectory, planar_trajectory
from bench.errors import DataError, refuse
from bench.geometry import Floats
from bench.plain_text import parsed_number
from bench.times import SECOND_NS, unit_hint

if TYPE_CHECKING:
    import pandas as pd

WHOLE_NUMBER = re.compile(r"\s*[+-]?[0-9]{1,19}\s*", re.ASCII)
LARGEST_TIME_NS = 2**63 - 1
LARGEST_SIGNAL = 1e6  # m/s or rad/s; larger ones are no signals, and their sums no numbers
Source = str | Sequence[str] | float | None  # of a signal: its column, several whose mean is taken, or a constant


def read_bus_signals(path: Path, *, columns: Mapping[str, Source] | None = None) -> Trajectory:
    """Read the path that bus signals in a CSV file describe, see `planar_trajectory`; "#" begins a line of comment.

    `timestamp_ns` are whole nanoseconds, `speed_mps` is that of the middle of the rear axle along x, negative backwards
    or without sign where `gear` is known, `yaw_rate_radps` is positive to the left, and `gear` is "R" or a negative
    number in reverse; it may be absent.

    Args:
        path: the file.
        columns: what stands for these four: the name of a column, several names whose mean is taken, or a constant
            number. Signals that are not named keep their own names.

    Raises:
        DataError: a file, column or value that is missing or not a number, or as of `planar_trajectory`.
    """
    table = _read_table(path)
    sources = {name: name for name in ("timestamp_ns", "speed_mps", "yaw_rate_radps", "gear")} | dict(columns or {})
    if not isinstance(times := sources["timestamp_ns"], str):
        raise DataError(path, field="timestamp_ns", expected="one column of times", got=repr(times))
    faults: list[DataError] = []
    timestamps_ns = _times(path, table, times, faults)
    speed_mps, yaw_rate_radps = (_signal(path, table, sources[n], faults) for n in ("speed_mps", "yaw_rate_radps"))
    gear = _gear(path, table, sources["gear"])
    refuse(faults)
    return planar_trajectory(
        source=str(path), timestamps_ns=timestamps_ns, speed_mps=speed_mps, yaw_rate_radps=yaw_rate_radps, gear=gear
    )


def _read_table(path: Path) -> pd.DataFrame:
    import pandas as pd  # 0.4 s, and only recordings with bus signals need it

    try:
        # As text, so that times of 19 digits do not pass through floating point.
        with open_regular(path) as file:
            return pd.read_csv(file, dtype=str, keep_default_na=False, comment="#", skipinitialspace=True)
    except OSError as error:
        raise DataError(path, expected="a readable file", got=error.strerror or str(error)) from error
    except (ValueError, UnicodeDecodeError) as error:
        got = " ".join(str(error).split())
        raise DataError(path, expected="a table with a header, separated by commas", got=got) from error


def _column(path: Path, table: pd.DataFrame, name: str) -> list[str]:
    if name not in table:
        got = ", ".join(map(str, table.columns))[:200] or "no columns"
        raise DataError(path, field=name, expected="a column of this name", got=got)
    return [str(text) for text in table[name]]


def _times(path: Path, table: pd.DataFrame, name: str, faults: list[DataError]) -> NDArray[np.int64]:
    texts = _column(path, table, name)
    unfit = [row for row, text in enumerate(texts) if not _is_time(text)]
    hint = unit_hint([parsed_number(text) for text in texts]) if unfit else ""
    for row in unfit:
        expected, field = "a whole number of nanoseconds", f"{name}, row {row + 1}"
        faults.append(DataError(path, field=field, expected=expected, got=repr(texts[row]), hint=hint))
    times_ns = np.array([int(text) for text in texts] if not unfit else [], dtype=np.int64)
    if np.any(np.diff(times_ns) <= 0) and (hint := unit_hint(times_ns)):  # whole seconds stand several times
        got = f"{', '.join(texts[:3])} ..."
        faults.append(DataError(path, field=name, expected="nanoseconds that increase", got=got, hint=hint))
    return times_ns


def _is_time(text: str) -> bool:
    return WHOLE_NUMBER.fullmatch(text) is not None and abs(int(text)) <= LARGEST_TIME_NS


def _signal(path: Path, table: pd.DataFrame, source: Source, faults: list[DataError]) -> Floats:
    if isinstance(source, int | float):
        return np.full(len(table), float(source))
    columns = []
    for name in (source,) if isinstance(source, str) else source or ():
        texts = _column(path, table, name)
        columns.append(np.array([parsed_number(text) for text in texts]))
        for row in np.flatnonzero(~(np.abs(columns[-1]) <= LARGEST_SIGNAL)).tolist():
            expected, field = f"a finite number, at most {LARGEST_SIGNAL:g}", f"{name}, row {row + 1}"
            faults.append(DataError(path, field=field, expected=expected, got=repr(texts[row])))
    return np.asarray(np.mean(columns, axis=0))


def _gear(path: Path, table: pd.DataFrame, source: Source) -> list[str] | None:
    is_usual = source == "gear"
    return _column(path, table, source) if isinstance(source, str) and (source in table or not is_usual) else None


COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
QUATERNION_TOLERANCE = 1e-2
FARTHEST_M = 1e8  # coordinates of any map are below
LATEST_S = 2**62 / SECOND_NS  # in the year 2116
LONGEST_STEP_S, USUAL_STEP_S = 2.0, 0.5  # between poses; nothing is interpolated over more than the second
UNITS = {1_000: "milliseconds", 1_000_000: "microseconds", 1_000_000_000: "nanoseconds"}


def read_tum(path: Path) -> Trajectory:
    """Read poses: `t x y z qx qy qz qw` a line, separated by spaces or commas; "#" begins a comment.

    Times are seconds as decimal text and come out as exact nanoseconds; poses are world_from_vehicle. A line that is
    there twice in a row counts once.

    Raises:
        DataError: missing, a line that is not a pose, times that do not increase, or times in another unit, which it
            names.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, expected="a readable text file", got=str(error)) from error
    times_s, poses, last = list[Decimal](), list[list[float]](), list[str]()
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words or words == last:
            continue
        if len(words) != len(COLUMNS):
            expected = f"{len(COLUMNS)} numbers, {' '.join(COLUMNS)}"
            raise DataError(path, field=f"line {number}", expected=expected, got=f"{len(words)}")
        pose = list(map(parsed_number, words))
        for column, word, value in zip(COLUMNS, words, pose, strict=True):
            if not np.isfinite(value):
                raise DataError(path, field=f"{column}, line {number}", expected="a finite number", got=repr(word))
        times_s.append(_exact(words[0]))
        poses.append(pose[1:])
        last = words
    rows = np.array(poses, dtype=np.float64).reshape(-1, len(COLUMNS) - 1)
    if rows.size and np.abs(rows[:, :3]).max() > FARTHEST_M:
        got = f"{np.abs(rows[:, :3]).max():g} m"
        raise DataError(path, field="x y z", expected=f"positions within {FARTHEST_M:g} m", got=got)
    with np.errstate(over="ignore"):
        off = np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1.0) > QUATERNION_TOLERANCE
    if off.any():
        row = int(np.argmax(off))
        got = f"{rows[row, 3:].tolist()} in pose {row + 1}"
        raise DataError(path, field="qx qy qz qw", expected="a quaternion of length 1", got=got)
    _refuse_other_unit(times_s, path)
    return Trajectory(
        source=str(path),
        timestamps_ns=np.array([int((time_s * SECOND_NS).to_integral_value()) for time_s in times_s], dtype=np.int64),
        rotations=Rotation.from_quat(rows[:, 3:], scalar_first=False),
        positions_m=rows[:, :3],
    )


def _exact(text: str) -> Decimal:
    """Digits that a float would lose."""
    try:
        return Decimal(text)
    except InvalidOperation:  # Python's floats have forms of their own
        return Decimal(float(text))


def _refuse_other_unit(times_s: list[Decimal], path: Path) -> None:
    """Refuse times that are no seconds: too late, or too far apart."""
    latest_s = float(max(map(abs, times_s), default=Decimal(0)))
    step_s = float(np.median(np.abs(np.diff(np.array(times_s, dtype=np.float64))))) if len(times_s) > 1 else 0.0
    if latest_s < LATEST_S and step_s <= LONGEST_STEP_S:
        return
    units = (unit for unit in UNITS if latest_s / unit < LATEST_S and step_s / unit <= USUAL_STEP_S)
    unit = next(units, None)
    hint = "" if unit is None else f"these would be {UNITS[unit]}: divide them by {unit}"
    got = f"times up to {latest_s:g}, {step_s:g} from one to the next"
    raise DataError(path, field="t", expected="seconds, the same clock as the images' nanoseconds", got=got, hint=hint)


def write_tum(
    path: Path,
    *,
    timestamps_ns: NDArray[np.int64],
    rotations: Rotation,
    positions_m: Floats,
    decimals: int | None = None,
) -> None:
    """Write poses in TUM form.

    Args:
        path: the file, overwritten.
        timestamps_ns: (N,) int64.
        rotations: N rotations, world_from_vehicle.
        positions_m: (N, 3) float64, m.
        decimals: of positions and quaternions; None for every digit.
    """
    lines = ["# " + " ".join(COLUMNS)]
    poses = np.hstack([positions_m, rotations.as_quat(canonical=True, scalar_first=False)])
    if decimals is not None:
        poses = np.round(poses, decimals) + 0.0  # 0 has no sign
    for time_ns, pose in zip(map(int, timestamps_ns), poses.tolist(), strict=True):
        seconds, rest_ns = divmod(abs(time_ns), SECOND_NS)
        lines.append(f"{'-' if time_ns < 0 else ''}{seconds}.{rest_ns:09d} {' '.join(map(repr, pose))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")

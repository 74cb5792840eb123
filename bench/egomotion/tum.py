"""Pose files in TUM form, as evo and many odometry tools write them."""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.plain_text import parsed_number
from bench.times import SECOND_NS

COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
QUATERNION_TOLERANCE = 1e-2
FARTHEST_M = 1e8  # coordinates of any map are below
LATEST_S = 2**62 / SECOND_NS  # in the year 2116
LONGEST_STEP_S, USUAL_STEP_S = 2.0, 0.5  # between poses; nothing is interpolated over more than the second
UNITS = {1_000: "milliseconds", 1_000_000: "microseconds", 1_000_000_000: "nanoseconds"}


def read_tum(path: Path) -> Trajectory:
    """Read poses: `t x y z qx qy qz qw` a line, separated by spaces or commas; "#" begins a comment.

    Times are seconds as decimal text and come out as exact nanoseconds; poses are world_from_vehicle. A pose that is
    there twice counts once.

    Raises:
        DataError: missing, a line that is not a pose, two poses at one time, times that do not increase, or times in
            another unit, which it names.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, expected="a readable text file", got=str(error)) from error
    times_s: list[Decimal] = []
    values: list[list[float]] = []
    at: dict[Decimal, tuple[list[float], int]] = {}
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) != len(COLUMNS):
            expected = f"{len(COLUMNS)} numbers, {' '.join(COLUMNS)}"
            raise DataError(path, field=f"line {number}", expected=expected, got=f"{len(words)}")
        time_s = _seconds(words[0], path, number)
        pose = [_number(w, path, number, column) for column, w in zip(COLUMNS[1:], words[1:], strict=True)]
        before, at_line = at.get(time_s, (pose, number))
        if before != pose:
            got = f"others at {words[0]} in the lines {at_line} and {number}"
            raise DataError(path, field=f"line {number}", expected="one pose for each time", got=got)
        if time_s not in at:
            at[time_s] = pose, number
            times_s.append(time_s)
            values.append(pose)
    rows = np.array(values, dtype=np.float64).reshape(-1, len(COLUMNS) - 1)
    if rows.size and np.abs(rows[:, :3]).max() > FARTHEST_M:
        got = f"{np.abs(rows[:, :3]).max():g} m"
        raise DataError(path, field="x y z", expected=f"positions within {FARTHEST_M:g} m", got=got)
    _refuse_other_quaternions(rows[:, 3:], path)
    rotations = Rotation.from_quat(rows[:, 3:], scalar_first=False)
    _refuse_other_unit(times_s, path)
    timestamps_ns = np.array([int((time_s * SECOND_NS).to_integral_value()) for time_s in times_s], dtype=np.int64)
    return Trajectory(source=str(path), timestamps_ns=timestamps_ns, rotations=rotations, positions_m=rows[:, :3])


def write_tum(
    path: Path,
    *,
    timestamps_ns: NDArray[np.int64],
    rotations: Rotation,
    positions_m: NDArray[np.float64],
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
    for time_ns, pose in zip(timestamps_ns, poses.tolist(), strict=True):
        lines.append(f"{_seconds_text(int(time_ns))} {' '.join(map(repr, pose))}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _seconds_text(time_ns: int) -> str:
    seconds, rest_ns = divmod(abs(time_ns), SECOND_NS)
    return f"{'-' if time_ns < 0 else ''}{seconds}.{rest_ns:09d}"


def _seconds(text: str, path: Path, line: int) -> Decimal:
    try:
        time_s = Decimal(text)
    except InvalidOperation:
        time_s = Decimal("nan")
    if not (time_s.is_finite() and math.isfinite(parsed_number(text))):
        raise DataError(path, field=f"t, line {line}", expected="seconds", got=repr(text))
    return time_s


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


def _number(text: str, path: Path, line: int, column: str) -> float:
    value = parsed_number(text)
    if not np.isfinite(value):
        raise DataError(path, field=f"{column}, line {line}", expected="a finite number", got=repr(text))
    return value


def _refuse_other_quaternions(quaternions_xyzw: NDArray[np.float64], path: Path) -> None:
    with np.errstate(over="ignore"):
        off = np.abs(np.linalg.norm(quaternions_xyzw, axis=1) - 1.0) > QUATERNION_TOLERANCE
    if off.any():
        row = int(np.argmax(off))
        got = f"{quaternions_xyzw[row].tolist()} in pose {row + 1}"
        raise DataError(path, field="qx qy qz qw", expected="a quaternion of length 1", got=got)

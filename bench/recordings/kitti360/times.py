"""KITTI-360's clock and poses: frame numbers in, nanoseconds and a trajectory out."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.text_files import number_rows, read_text
from bench.recordings.validation import data_error

STAMP = re.compile(r"(\d{4})-(\d\d)-(\d\d) (\d\d):(\d\d):(\d\d)\.(\d{1,9})")
SECOND_NS = 1_000_000_000
LARGEST_FRAME = 10_000_000
TURN_OVER = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameClock:
    """When each frame was taken. Cameras, scanner and poses share a frame number and thereby an instant.

    Attributes:
        file: the `timestamps.txt` it comes from.
        times_ns: by frame number.
        interval_ns: median time between frames, also one turn of the scanner.
    """

    file: Path
    times_ns: dict[int, int]
    interval_ns: int

    def at(self, frame: int, *, file: Path) -> int:
        """Time of a frame.

        Args:
            frame: number.
            file: what has the number, for the message.

        Raises:
            DataError: the clock does not know the frame.
        """
        if frame not in self.times_ns:
            raise DataError(file, expected=f"a line for frame {frame} in {self.file}", got="none")
        return self.times_ns[frame]


def read_clock(file: Path, frames: list[int]) -> FrameClock:
    """Read a `timestamps.txt`.

    Line n is of frame n - 1. Where the first frames of a drive were cut off together with their lines, the file has as
    many lines as there are images and they belong together in order.

    Args:
        file: lines `YYYY-MM-DD hh:mm:ss.nnnnnnnnn`.
        frames: numbers of the images beside it, increasing.

    Raises:
        DataError: a line that is no time, times that do not increase, or fewer lines than images.
    """
    lines = read_text(file).rstrip().splitlines()
    if len(lines) < 2:
        raise DataError(file, expected="two times at least", got=str(len(lines)))
    numbers: list[int] = list(range(len(lines)))
    if frames and frames[-1] >= len(lines):
        if len(frames) != len(lines):
            raise DataError(file, expected=f"a line for each frame up to {frames[-1]}", got=f"{len(lines)} lines")
        numbers = frames
    times_ns = {
        number: stamp_ns(line, row, file) for row, (number, line) in enumerate(zip(numbers, lines, strict=True), 1)
    }
    steps_ns = np.diff(np.fromiter(times_ns.values(), dtype=np.int64))
    if steps_ns.min() <= 0:
        row = int(np.argmax(steps_ns <= 0)) + 2
        raise DataError(file, field=f"line {row}", expected="times that increase", got=lines[row - 1].strip()[:40])
    return FrameClock(file=file, times_ns=times_ns, interval_ns=int(np.median(steps_ns)))


def stamp_ns(line: str, row: int, file: Path) -> int:
    """Time of a line, counted from 1, of `timestamps.txt`.

    Raises:
        DataError: it is none.
    """
    match = STAMP.fullmatch(line.strip())
    try:
        if match is None:
            raise ValueError
        year, month, day, hour, minute, second = (int(part) for part in match.groups()[:6])
        days = date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()
        if hour > 23 or minute > 59 or second > 59:
            raise ValueError
    except ValueError:
        expected = "a time YYYY-MM-DD hh:mm:ss.nnnnnnnnn"
        raise DataError(file, field=f"line {row}", expected=expected, got=repr(line.strip()[:40])) from None
    seconds = ((days * 24 + hour) * 60 + minute) * 60 + second
    return seconds * SECOND_NS + int(match[7].ljust(9, "0"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """Where the car went.

    Attributes:
        trajectory: of the vehicle frame, in a world with z up that begins near the first pose.
        world_from_global: from the world of the data set, which all sequences share.
    """

    trajectory: Trajectory
    world_from_global: RigidTransform


def read_drive(
    file: Path, clock: FrameClock, vehicle_from_imu: RigidTransform, *, max_gap_s: float, standing_m: float
) -> Drive:
    """Read `poses.txt`.

    Poses are missing where the car had moved too little since the last one (kitti360Scripts #96, #102). Such gaps are
    filled: the car is put evenly between the poses around. Longer gaps over which it did move stay open, and frames
    within them have no ego-motion.

    Args:
        file: rows of frame number and 3 x 4 matrix, global world from IMU.
        clock: times of frames.
        vehicle_from_imu: mounting of the IMU.
        max_gap_s: poses further apart are not interpolated between ...
        standing_m: ... unless the car moved no further than this.

    Raises:
        DataError: a row that is no pose, frames that do not increase or have no time, fewer than two poses.
    """
    rows = number_rows(file, 13)
    frames = rows[:, 0]
    if (frames != frames.round()).any() or frames.min() < 0 or frames.max() > LARGEST_FRAME:
        raise DataError(file, field="frame", expected="whole frame numbers", got=f"{frames.min()} to {frames.max()}")
    if (np.diff(frames) <= 0).any():
        row = int(np.argmax(np.diff(frames) <= 0)) + 2
        got = f"{frames[row - 1]:.0f} after {frames[row - 2]:.0f}"
        raise DataError(file, field=f"row {row}", expected="frames that increase", got=got)
    poses = [read_pose(matrix, file, row) for row, matrix in enumerate(rows[:, 1:].reshape(-1, 3, 4), 1)]
    imu_from_vehicle = vehicle_from_imu.inverse()
    world_from_global = _levelled(poses[0] @ imu_from_vehicle)
    vehicles = [world_from_global @ pose @ imu_from_vehicle for pose in poses]
    times_ns = np.array([clock.at(int(frame), file=file) for frame in frames], dtype=np.int64)
    sparse = Trajectory(
        source=str(file),
        timestamps_ns=times_ns,
        rotations=Rotation.from_matrix(np.stack([pose.rotation for pose in vehicles])),
        positions_m=np.stack([pose.translation_m for pose in vehicles]),
        max_gap_ns=round(max_gap_s * SECOND_NS),
    )
    return Drive(trajectory=_standing_filled(sparse, clock, standing_m), world_from_global=world_from_global)


def _levelled(global_from_vehicle: RigidTransform) -> RigidTransform:
    """Shift the first pose near to the origin and turn z up, whichever way the global world has it."""
    upright = np.eye(3) if global_from_vehicle.rotation[2, 2] > 0 else TURN_OVER
    return RigidTransform(upright, -upright @ global_from_vehicle.translation_m)


def read_pose(matrix: NDArray[np.float64], file: Path, row: int) -> RigidTransform:
    """Global world from IMU, of a row, counted from 1, of `poses.txt`.

    Raises:
        DataError: the (3, 4) matrix is no pose.
    """
    try:
        return RigidTransform.from_matrix(matrix)
    except ShapeError as error:
        raise data_error(error, file=file, field=f"row {row}") from error


def _standing_filled(sparse: Trajectory, clock: FrameClock, standing_m: float) -> Trajectory:
    """Add poses at the frames of gaps in which the car stood or crept."""
    known_ns = sparse.timestamps_ns
    wide = np.diff(known_ns) > sparse.max_gap_ns
    near = np.linalg.norm(np.diff(sparse.positions_m, axis=0), axis=1) <= standing_m
    clock_ns = np.fromiter(clock.times_ns.values(), dtype=np.int64)
    left = np.searchsorted(known_ns, clock_ns, side="right") - 1
    inside = (left >= 0) & (left < len(known_ns) - 1) & ~np.isin(clock_ns, known_ns)
    inside[inside] = (wide & near)[left[inside]]
    if not inside.any():
        return sparse
    between = Trajectory(
        source=sparse.source,
        timestamps_ns=known_ns,
        rotations=sparse.rotations,
        positions_m=sparse.positions_m,
        max_gap_ns=int(known_ns[-1] - known_ns[0]),
    )
    times_ns = np.union1d(known_ns, clock_ns[inside])
    rotations, positions_m, _ = between.at(times_ns)
    return Trajectory(
        source=sparse.source,
        timestamps_ns=times_ns,
        rotations=Rotation.from_matrix(rotations),
        positions_m=positions_m,
        max_gap_ns=sparse.max_gap_ns,
    )

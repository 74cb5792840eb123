"""KITTI-360's files of a sequence: times of frames, poses, and turns of the laser scanner."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.lidar import LidarSweep, read_points
from bench.recordings.error_handlers import STRICT, OnError, at_most, reporting
from bench.recordings.files import number_rows, numbers, read_text
from bench.recordings.validation import MOST_FAULTS, data_error

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


def read_clock(file: Path, frames: list[int], on_error: OnError = STRICT) -> FrameClock | None:
    """Read a `timestamps.txt`.

    Line n is of frame n - 1. Where the first frames of a drive were cut off together with their lines, the file has as
    many lines as there are images and they belong together in order.

    Args:
        file: lines `YYYY-MM-DD hh:mm:ss.nnnnnnnnn`.
        frames: numbers of the images beside it, increasing.
        on_error: takes errors: a line that is no time, times that do not increase, fewer lines than images. At most
            200 lines are told.

    Returns:
        The clock; None after an error.
    """
    lines: list[str] = []
    numbered: list[int] | None = None
    with reporting(on_error):
        lines = read_text(file).rstrip().splitlines()
        numbered = _frame_numbers(file, len(lines), frames)
    on_line_error = at_most(MOST_FAULTS, on_error)
    times_ns: dict[int, int] = {}  # by row
    for row, line in enumerate(lines, start=1):
        try:
            times_ns[row] = _stamp_ns(line, row, file)
        except DataError as error:
            on_line_error(error)
    rows = list(times_ns)
    steps_ns = np.diff(np.fromiter(times_ns.values(), dtype=np.int64))
    late = [rows[i + 1] for i in np.flatnonzero(steps_ns <= 0)]
    for row in late:
        got = lines[row - 1].strip()[:40]
        on_line_error(DataError(file, field=f"line {row}", expected="times that increase", got=got))
    if numbered is None or len(times_ns) < len(lines) or late:
        return None
    return FrameClock(
        file=file,
        times_ns=dict(zip(numbered, times_ns.values(), strict=True)),
        interval_ns=int(np.median(steps_ns)),
    )


def _frame_numbers(file: Path, lines: int, frames: list[int]) -> list[int]:
    if lines < 2:
        raise DataError(file, expected="two times at least", got=str(lines))
    if not frames or frames[-1] < lines:
        return list(range(lines))
    if len(frames) != lines:
        raise DataError(file, expected=f"a line for each frame up to {frames[-1]}", got=f"{lines} lines")
    return frames


def _stamp_ns(line: str, row: int, file: Path) -> int:
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
    poses = [_pose(matrix, file, row) for row, matrix in enumerate(rows[:, 1:].reshape(-1, 3, 4), 1)]
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


def _pose(matrix: NDArray[np.float64], file: Path, row: int) -> RigidTransform:
    """Global world from IMU, of a row, counted from 1, of `poses.txt`.

    Raises:
        DataError: the (3, 4) matrix is no pose.
    """
    try:
        return RigidTransform.from_matrix(matrix)
    except ShapeError as error:
        raise data_error(error, file=file, field=f"row {row}") from error


def pose_faults(file: Path, clock: FrameClock | None) -> tuple[DataError, ...]:
    """Lines of `poses.txt` that `read_drive` would refuse, at most 200; without a clock frames may have any time."""
    try:
        lines = read_text(file).rstrip().splitlines()
    except DataError as error:
        return (error,)
    return tuple(islice(_line_faults(lines, file, clock), MOST_FAULTS))


def _line_faults(lines: list[str], file: Path, clock: FrameClock | None) -> Iterator[DataError]:
    before = -1.0
    for row, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            frame, *matrix = numbers(line.split(), 13, file=file, field=f"line {row}")
            if frame != round(frame) or not 0 <= frame <= LARGEST_FRAME:
                raise DataError(file, field=f"line {row}", expected="a whole frame number", got=f"{frame:g}")
            _pose(np.array(matrix).reshape(3, 4), file, row)
            if clock is not None:
                clock.at(int(frame), file=file)
        except DataError as error:
            yield error
            continue
        if frame <= before:
            got = f"{frame:.0f} after {before:.0f}"
            yield DataError(file, field=f"line {row}", expected="frames that increase", got=got)
        before = frame


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


LARGEST_BYTES = 64_000_000  # four million points; a turn of this scanner has about 120,000


def read_turn(path: Path, timestamp_ns: int, *, period_ns: int) -> LidarSweep:
    """Read one turn and give each point its time by its azimuth.

    The scanner turns clockwise seen from above and passes straight ahead when the cameras are triggered, at the time of
    the frame. A point at azimuth a, positive to the left, was measured a/(2 pi) of a turn earlier. Points just left and
    just right of straight back are thus the first and the last of the turn.

    Args:
        path: `.bin` file of float32 x, y, z, intensity, velodyne frame, as measured (not freed of the car's motion).
        timestamp_ns: of the frame.
        period_ns: duration of a turn.

    Raises:
        DataError: missing, too large, cut short, empty, or points that are not finite.

    Source:
        Deskewing in kitti360Scripts (`curlVelodyneData`): a point is moved by its azimuth's share of the motion between
        the poses of the frame and of the one before.
    """
    if path.is_file() and path.stat().st_size > LARGEST_BYTES:
        raise DataError(path, expected=f"at most {LARGEST_BYTES} bytes", got=str(path.stat().st_size))
    arrays = read_points(path)
    points = arrays["points_lidar"]
    turn = np.arctan2(points[:, 1].astype(np.float64), points[:, 0].astype(np.float64)) / (2 * np.pi)
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=points,
        time_offset_ns=np.rint(-turn * period_ns).astype(np.int64),
        intensity=arrays["intensity"],
    )

"""Files of KITTI's data sets: calibrations, times of frames, turns of the laser scanner, and poses of KITTI-360."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.atomic import refuse_escape
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.files import read_sweep
from bench.lidar.sweep import LidarSweep
from bench.recordings.files import numbers, read_text
from bench.recordings.validation import located
from bench.times import SECOND_NS

STAMP = re.compile(r"(19|20)\d\d-\d\d-\d\d \d\d:\d\d:\d\d\.\d{1,9}", re.ASCII)  # other years do not fit int64
LARGEST_CALIBRATION_BYTES = 100_000
LONGEST_GAP_NS, STATIONARY_M = SECOND_NS, 0.5
TURN_OVER = np.diag([1.0, -1.0, -1.0])  # from y right, z down to y left, z up


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """A text file of numbers, after their names or alone.

    Attributes:
        file: it comes from.
        words: numbers by name, as words; by "" those of a file without names.
    """

    file: Path
    words: Mapping[str, list[str]]

    def numbers(self, name: str, *shape: int) -> NDArray[np.float64]:
        """Numbers of a name, in this shape.

        Raises:
            DataError: there are none of this name, or more or fewer.
        """
        count, field = int(np.prod(shape)), name or self.file.stem
        if name not in self.words:
            raise DataError(self.file, field=field, expected=f"a line with {count} numbers", got="none")
        return np.array(numbers(self.words[name], count, file=self.file, field=field)).reshape(shape)

    def transform(self, name: str, translation_m: NDArray[np.float64] | None = None) -> RigidTransform:
        """The transform of 3 x 3 numbers and a translation, or of 3 x 4 numbers.

        Raises:
            DataError: as of `numbers`, or a matrix that does not only rotate.
        """
        if translation_m is None:
            matrix = self.numbers(name, 3, 4)
        else:
            matrix = np.column_stack([self.numbers(name, 3, 3), translation_m])
        with located(self.file, name or self.file.stem):
            return RigidTransform.from_matrix(matrix)


def calibration_text(root: Path, file: Path) -> str:
    """The text of a calibration file, which no link may lead out of the data set.

    Raises:
        DataError: missing, outside of `root`, too large, empty, or not UTF-8.
    """
    refuse_escape(root, file, file=file)
    return read_text(file, largest_bytes=LARGEST_CALIBRATION_BYTES)


def read_calibration(root: Path, file: Path) -> Calibration:
    """Read numbers in lines `<name>: <numbers>`, or a file of numbers alone; errors as of `calibration_text`."""
    text = calibration_text(root, file)
    lines = [line.partition(":") for line in text.splitlines()]
    named = {name.strip(): words.split() for name, colon, words in lines if colon}
    return Calibration(file=file, words=named or {"": text.split()})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameClock:
    """Times of the frames. Cameras, scanner and poses share a frame number and thereby an instant.

    Attributes:
        file: the `timestamps.txt` it comes from.
        times_ns: by frame number.
        interval_ns: median time between frames, also one turn of the scanner.
    """

    file: Path
    times_ns: dict[int, int]
    interval_ns: int

    def at(self, frame: float, *, file: Path) -> int:
        """Time of a frame.

        Args:
            frame: number.
            file: what has the number, for the message.

        Raises:
            DataError: the clock does not know the frame.
        """
        if frame not in self.times_ns:
            raise DataError(file, expected=f"a line for frame {frame:g} in {self.file}", got="none")
        return self.times_ns[int(frame)]


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
    numbered = _frame_numbers(file, len(lines), frames)
    times_ns = [_stamp_ns(line, row, file) for row, line in enumerate(lines, start=1)]
    steps_ns = np.diff(times_ns)
    for row in np.flatnonzero(steps_ns <= 0):
        got = lines[row + 1].strip()[:40]
        raise DataError(file, field=f"line {row + 2}", expected="times that increase", got=got)
    return FrameClock(
        file=file, times_ns=dict(zip(numbered, times_ns, strict=True)), interval_ns=int(np.median(steps_ns))
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
    try:
        if STAMP.fullmatch(line.strip()) is None:
            raise ValueError
        return int(np.datetime64(line.strip(), "ns").astype(np.int64))
    except ValueError:
        expected = "a time YYYY-MM-DD hh:mm:ss.nnnnnnnnn"
        raise DataError(file, field=f"line {row}", expected=expected, got=repr(line.strip()[:40])) from None


def read_drive(file: Path, clock: FrameClock, vehicle_from_imu: RigidTransform) -> tuple[Trajectory, RigidTransform]:
    """Read `poses.txt`, and the drive through it.

    Poses are missing where the car had moved too little since the last one (kitti360Scripts #96, #102). Gaps of over a
    second in which it moved by half a metre or less are filled: the car is put evenly between the poses around. Others
    stay open, and frames within them have no ego-motion.

    Args:
        file: lines of frame number and 3 x 4 matrix, global world from IMU.
        clock: times of frames.
        vehicle_from_imu: mounting of the IMU.

    Returns:
        trajectory: of the vehicle frame, in a world with z up that begins near the first pose.
        world_from_global: from the world of the data set, which all sequences share.

    Raises:
        DataError: missing, too large, empty, not UTF-8, a line that is no pose, fewer than two poses, or frames that do
            not increase or have no time.
    """
    times_ns, poses = list[int](), list[RigidTransform]()
    for row, line in enumerate(read_text(file).rstrip().splitlines(), start=1):
        number, *matrix = numbers(line.split(), 13, file=file, field=f"line {row}")
        times_ns.append(clock.at(number, file=file))
        with located(file, f"row {row}"):
            poses.append(RigidTransform.from_matrix(np.array(matrix).reshape(3, 4)))
    imu_from_vehicle = vehicle_from_imu.inverse()
    world_from_global = _levelled(poses[0] @ imu_from_vehicle)
    vehicles = [world_from_global @ pose @ imu_from_vehicle for pose in poses]
    sparse = Trajectory(
        source=str(file),
        timestamps_ns=np.array(times_ns, dtype=np.int64),
        rotations=Rotation.from_matrix(np.stack([pose.rotation for pose in vehicles])),
        positions_m=np.stack([pose.translation_m for pose in vehicles]),
        max_gap_ns=LONGEST_GAP_NS,
    )
    return _stationary_filled(sparse, clock), world_from_global


def _levelled(global_from_vehicle: RigidTransform) -> RigidTransform:
    """Shift the first pose near to the origin and turn z up, whichever way the global world has it."""
    upright = np.eye(3) if global_from_vehicle.rotation[2, 2] > 0 else TURN_OVER
    return RigidTransform(upright, -upright @ global_from_vehicle.translation_m)


def _stationary_filled(sparse: Trajectory, clock: FrameClock) -> Trajectory:
    """Add poses at the frames of gaps in which the car was stationary or crept."""
    known_ns = sparse.timestamps_ns
    wide = np.diff(known_ns) > sparse.max_gap_ns
    near = np.linalg.norm(np.diff(sparse.positions_m, axis=0), axis=1) <= STATIONARY_M
    clock_ns = np.fromiter(clock.times_ns.values(), dtype=np.int64)
    left = np.searchsorted(known_ns, clock_ns, side="right") - 1
    inside = (left >= 0) & (left < len(known_ns) - 1) & ~np.isin(clock_ns, known_ns)
    inside[inside] = (wide & near)[left[inside]]
    if not inside.any():
        return sparse
    between = replace(sparse, max_gap_ns=int(known_ns[-1] - known_ns[0]))
    times_ns = np.union1d(known_ns, clock_ns[inside])
    rotations, positions_m, _ = between.at(times_ns)
    return replace(sparse, timestamps_ns=times_ns, rotations=Rotation.from_matrix(rotations), positions_m=positions_m)


def read_turn(path: Path, timestamp_ns: int, *, period_ns: int, to_the_left: bool = False) -> LidarSweep:
    """Read one turn and give each point its time by its azimuth.

    The scanner passes straight ahead when the cameras are triggered, at the time of the frame. KITTI-360's turns
    clockwise seen from above: a point at azimuth a, positive to the left, was measured a/(2 pi) of a turn earlier. That
    of the raw drives turns to the left: later. Points just left and just right of straight back are the first and the
    last of the turn.

    Args:
        path: `.bin` file of float32 x, y, z, intensity, velodyne frame, as measured (not motion-compensated).
        timestamp_ns: of the frame.
        period_ns: duration of a turn.
        to_the_left: the scanner turns counter-clockwise seen from above.

    Raises:
        DataError: missing, too large, cut short, empty, or points that are not finite.

    Source:
        Deskewing in kitti360Scripts (`curlVelodyneData`): a point is moved by its azimuth's share of the motion between
        the poses of the frame and of the one before.
    """
    sweep = read_sweep(path, timestamp_ns, bin_columns=("x", "y", "z", "intensity"))
    points = sweep.points_lidar
    turn = np.arctan2(points[:, 1].astype(np.float64), points[:, 0].astype(np.float64)) / (2 * np.pi)
    return replace(sweep, time_offset_ns=np.rint((turn if to_the_left else -turn) * period_ns).astype(np.int64))

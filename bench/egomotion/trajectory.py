"""Poses of the vehicle over time, also by planar odometry, and the motion of a camera on it between two of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.errors import DataError
from bench.geometry import Bools, Floats, RigidTransform, advance_twist, twist_between
from bench.times import SECOND_NS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """`world_from_vehicle` at times; the world is wherever the first pose puts it.

    Attributes:
        source: file that the poses come from, for messages.
        timestamps_ns: (N,) int64, strictly increasing, N >= 2.
        rotations: N rotations, world_from_vehicle.
        positions_m: (N, 3) float64, m, vehicle origin in the world.
        max_gap_ns: poses further apart than this are not interpolated between.
        max_extrapolation_ns: how far beyond the ends the motion is continued; lidar points and exposures
            lie a little outside of the signals at the ends of a recording.

    Raises:
        DataError: fewer than two poses, times that do not increase, numbers that are not finite.
    """

    source: str
    timestamps_ns: NDArray[np.int64]
    rotations: Rotation
    positions_m: Floats
    max_gap_ns: int = SECOND_NS // 2
    max_extrapolation_ns: int = SECOND_NS // 10
    _matrices: Floats = field(init=False, repr=False)
    _turns_rad: Floats = field(init=False, repr=False)
    _paths_m: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        times_ns, positions_m = self.timestamps_ns, self.positions_m
        if len(times_ns) < 2:
            raise DataError(self.source, expected="at least two poses", got=str(len(times_ns)))
        steps_ns = np.diff(times_ns)
        if steps_ns.min() <= 0:
            row = int(np.argmax(steps_ns <= 0)) + 1
            raise DataError(
                self.source,
                field="timestamp_ns",
                expected="times that increase",
                got=f"{times_ns[row]} after {times_ns[row - 1]} in row {row + 1}",
            )
        if positions_m.shape != (len(times_ns), 3) or len(self.rotations) != len(times_ns):
            raise DataError(
                self.source, expected=f"a pose for each of {len(times_ns)} times", got=f"{len(self.rotations)} poses"
            )
        if not np.isfinite(positions_m).all():
            raise DataError(self.source, expected="finite positions", got="NaN or infinity")
        turns_rad, paths_m = twist_between(self.rotations[:-1], positions_m[:-1], self.rotations[1:], positions_m[1:])
        object.__setattr__(self, "_matrices", self.rotations.as_matrix())
        object.__setattr__(self, "_turns_rad", turns_rad)
        object.__setattr__(self, "_paths_m", paths_m)

    def at(self, timestamps_ns: NDArray[np.int64]) -> tuple[Floats, Floats, Bools]:
        """Poses at any times.

        Args:
            timestamps_ns: (M,) int64.

        Returns:
            rotations: (M, 3, 3) float64, world_from_vehicle; NaN where not valid.
            positions_m: (M, 3) float64, m; NaN where not valid.
            valid: (M,) bool; False in gaps and too far beyond the ends.
        """
        times_ns = np.asarray(timestamps_ns, dtype=np.int64)
        left, fraction, valid = self._intervals(times_ns)
        rotations, advances_m = advance_twist(self._turns_rad[left], self._paths_m[left], fraction)
        start = self._matrices[left]
        matrices = start @ rotations.as_matrix()
        positions_m = self.positions_m[left] + (start @ advances_m[..., None])[..., 0]
        matrices[~valid] = np.nan
        positions_m[~valid] = np.nan
        return matrices, positions_m, valid

    def world_from_vehicle(self, timestamp_ns: int) -> RigidTransform:
        """The pose at one time; `at` computes many in the time of a few.

        Raises:
            DataError: no ego-motion there.
        """
        rotations, positions_m, valid = self.at(np.array([timestamp_ns], dtype=np.int64))
        if not valid[0]:
            raise self._no_motion(timestamp_ns)
        return RigidTransform(rotations[0], positions_m[0])

    def velocity_vehicle_mps(self, timestamp_ns: int) -> Floats:
        """Velocity of the vehicle's origin over the ground in the vehicle's own axes, (3,) float64, m/s.

        That of the constant twist between the poses around the time, so exact on a bend; negative x in reverse gear.
        At a pose it is the interval's that begins there, or the one's that ends there where a gap or nothing follows.

        Raises:
            DataError: no ego-motion there.
        """
        left, _, valid = self._intervals(np.array([timestamp_ns], dtype=np.int64))
        if not valid[0]:
            raise self._no_motion(timestamp_ns)
        i = int(left[0])
        spans_ns = np.diff(self.timestamps_ns[max(i - 1, 0) : i + 2])
        if i and timestamp_ns == self.timestamps_ns[i] and spans_ns[1] > self.max_gap_ns >= spans_ns[0]:
            i -= 1
        return np.asarray(self._paths_m[i] / ((self.timestamps_ns[i + 1] - self.timestamps_ns[i]) / SECOND_NS))

    def _no_motion(self, timestamp_ns: int) -> DataError:
        first_ns, last_ns = int(self.timestamps_ns[0]), int(self.timestamps_ns[-1])
        return DataError(
            self.source,
            field="timestamp_ns",
            expected=f"ego-motion at {timestamp_ns}",
            got=f"poses from {first_ns} to {last_ns}, gaps over {self.max_gap_ns / 1e6:.0f} ms left open",
            hint="give ego-motion that covers every image and sweep",
        )

    def _intervals(self, times_ns: NDArray[np.int64]) -> tuple[NDArray[np.intp], Floats, Bools]:
        known = self.timestamps_ns
        left = np.clip(np.searchsorted(known, times_ns, side="right") - 1, 0, len(known) - 2)
        span_ns = known[left + 1] - known[left]
        fraction = (times_ns - known[left]) / span_ns.astype(np.float64)
        covered = (times_ns >= known[0] - self.max_extrapolation_ns) & (
            times_ns <= known[-1] + self.max_extrapolation_ns
        )
        on_pose = (times_ns == known[left]) | (times_ns == known[left + 1])
        return left, fraction, covered & ((span_ns <= self.max_gap_ns) | on_pose)


REVERSE_GEAR = re.compile(r"R[0-9]?|REV|REVERSE|-[0-9]+(\.0*)?")
OTHER_GEAR = re.compile(r"[PNDSLMBE]?[0-9]*(\.0*)?|PARK|NEUTRAL|DRIVE|SPORT|LOW|MANUAL|NONE|UNKNOWN")


def planar_trajectory(
    *,
    source: str,
    timestamps_ns: NDArray[np.int64],
    speed_mps: Floats,
    yaw_rate_radps: Floats,
    gear: Sequence[str | int] | None = None,
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
    signed_mps = speed_mps if gear is None else np.where(_in_reverse(gear, source), -np.abs(speed_mps), speed_mps)
    steps_s = np.diff(timestamps_ns) / SECOND_NS
    advance_m, turn_rad = np.zeros((len(steps_s), 3)), np.zeros((len(steps_s), 3))
    advance_m[:, 0] = 0.5 * (signed_mps[1:] + signed_mps[:-1]) * steps_s
    turn_rad[:, 2] = 0.5 * (yaw_rate_radps[1:] + yaw_rate_radps[:-1]) * steps_s
    _, arcs_m = advance_twist(turn_rad, advance_m, np.ones(len(steps_s)))
    yaw_rad = np.concatenate([[0.0], np.cumsum(turn_rad[:, 2])])
    rotations = Rotation.from_rotvec(yaw_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    positions_m = np.zeros((len(timestamps_ns), 3))
    if len(steps_s):
        np.cumsum(rotations[:-1].apply(arcs_m), axis=0, out=positions_m[1:])
    return Trajectory(source=source, timestamps_ns=timestamps_ns, rotations=rotations, positions_m=positions_m)


def _in_reverse(gear: Sequence[str | int], source: str) -> Bools:
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


def camera_motion(
    *,
    world_from_vehicle_previous: RigidTransform,
    world_from_vehicle_current: RigidTransform,
    vehicle_from_camera: RigidTransform,
) -> RigidTransform:
    """`current_from_previous` of the camera, lever arm included.

    A camera away from the vehicle's origin translates when the vehicle rotates; the chain of frames includes it:
    camera <- vehicle (current) <- world <- vehicle (previous) <- camera.

    Source:
        Mariotti and Eising 2020, section III: R and t = C - C', expressed in the current camera frame.
    """
    vehicle_current_from_previous = world_from_vehicle_current.inverse() @ world_from_vehicle_previous
    return vehicle_from_camera.inverse() @ vehicle_current_from_previous @ vehicle_from_camera

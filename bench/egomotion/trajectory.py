"""Poses of the vehicle over time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.errors import DataError
from bench.geometry import RigidTransform, advance_twist, twist_between

SECOND_NS = 1_000_000_000
HELD_POSES = 256  # images, their object states and the images after them ask for the same few poses
POSES_AHEAD = 31  # worth asking for along with one, where times come in order


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
    positions_m: NDArray[np.float64]
    max_gap_ns: int = SECOND_NS // 2
    max_extrapolation_ns: int = SECOND_NS // 10
    _matrices: NDArray[np.float64] = field(init=False, repr=False)
    _turns_rad: NDArray[np.float64] = field(init=False, repr=False)
    _paths_m: NDArray[np.float64] = field(init=False, repr=False)
    _held: dict[int, RigidTransform] = field(init=False, repr=False, default_factory=dict)

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

    def at(
        self, timestamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Poses at any times.

        Args:
            timestamps_ns: (M,) int64.

        Returns:
            rotations: (M, 3, 3) float64, world_from_vehicle; NaN where not valid.
            positions_m: (M, 3) float64, m; NaN where not valid.
            valid: (M,) bool; False in gaps and too far beyond the ends.
        """
        times_ns = np.asarray(timestamps_ns, dtype=np.int64)
        left, fraction, valid = self._places(times_ns)
        turns, advances_m = advance_twist(self._turns_rad[left], self._paths_m[left], fraction)
        start = self._matrices[left]
        matrices = start @ turns.as_matrix()
        positions_m = self.positions_m[left] + (start @ advances_m[..., None])[..., 0]
        matrices[~valid] = np.nan
        positions_m[~valid] = np.nan
        return matrices, positions_m, valid

    def world_from_vehicle(self, timestamp_ns: int, *, next_ns: Iterable[int] = ()) -> RigidTransform:
        """The pose at one time.

        Args:
            timestamp_ns: the time.
            next_ns: times that will be asked for soon. Where this one's pose must be computed, theirs are computed
                with it: a dozen cost little more than one. No ego-motion at one of them is no error yet.

        Raises:
            DataError: no ego-motion there.
        """
        if timestamp_ns not in self._held:
            self._hold([timestamp_ns, *next_ns])
        if timestamp_ns not in self._held:
            first_ns, last_ns = int(self.timestamps_ns[0]), int(self.timestamps_ns[-1])
            raise DataError(
                self.source,
                field="timestamp_ns",
                expected=f"ego-motion at {timestamp_ns}",
                got=f"poses from {first_ns} to {last_ns}, gaps over {self.max_gap_ns / 1e6:.0f} ms left open",
                do="give ego-motion that covers every image and sweep",
            )
        return self._held[timestamp_ns]

    def _hold(self, times_ns: Sequence[int]) -> None:
        """Compute the poses at times; those without ego-motion are left out."""
        if len(self._held) + len(times_ns) > HELD_POSES:
            self._held.clear()
        rotations, positions_m, valid = self.at(np.array(times_ns, dtype=np.int64))
        for row in np.flatnonzero(valid).tolist():
            self._held[times_ns[row]] = RigidTransform(rotations[row], positions_m[row])

    def velocity_vehicle_mps(self, timestamp_ns: int) -> NDArray[np.float64]:
        """Velocity of the vehicle's origin over the ground in the vehicle's own axes, (3,) float64, m/s.

        That of the constant twist between the poses around the time, so exact on a bend; negative x in reverse gear.
        At a pose it is the interval's that begins there, or the one's that ends there where a gap or nothing follows.

        Raises:
            DataError: no ego-motion there.
        """
        self.world_from_vehicle(timestamp_ns)
        left, _, _ = self._places(np.array([timestamp_ns], dtype=np.int64))
        i = int(left[0])
        spans_ns = np.diff(self.timestamps_ns[max(i - 1, 0) : i + 2])
        if i and timestamp_ns == self.timestamps_ns[i] and spans_ns[1] > self.max_gap_ns >= spans_ns[0]:
            i -= 1
        return np.asarray(self._paths_m[i] / ((self.timestamps_ns[i + 1] - self.timestamps_ns[i]) / SECOND_NS))

    def _places(self, times_ns: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.bool_]]:
        known = self.timestamps_ns
        left = np.clip(np.searchsorted(known, times_ns, side="right") - 1, 0, len(known) - 2)
        span_ns = known[left + 1] - known[left]
        fraction = (times_ns - known[left]) / span_ns.astype(np.float64)
        covered = (times_ns >= known[0] - self.max_extrapolation_ns) & (
            times_ns <= known[-1] + self.max_extrapolation_ns
        )
        on_pose = (times_ns == known[left]) | (times_ns == known[left + 1])
        return left, fraction, covered & ((span_ns <= self.max_gap_ns) | on_pose)

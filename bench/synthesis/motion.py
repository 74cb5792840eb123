"""Where the host and the actors are at any time.

Everything moves in the plane of the road. Time 0 is the first image; the world is the vehicle frame at that time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.geometry import RigidTransform

SECOND_NS = 1_000_000_000
STEP_NS = 1_000_000  # between the nodes of the host's path: linear in between is off by less than a micrometre


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanarPoses:
    """Poses in the plane at a row of times.

    Attributes:
        positions_m: (N, 2) float64, m, world.
        yaws_rad: (N,) float64, world.
        distances_m: (N,) float64, way travelled since time 0, negative in reverse.
    """

    positions_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    distances_m: NDArray[np.float64]

    def transform(self, index: int = 0, *, height_m: float = 0.0) -> RigidTransform:
        """World from body of one row."""
        return RigidTransform.from_yaw(float(self.yaws_rad[index]), [*self.positions_m[index], height_m])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActorPath:
    """An actor with constant speed and yaw rate: a line or an arc.

    Attributes:
        start_m: (2,) float64, position at time 0.
        heading_rad: direction of travel at time 0.
        speed_mps: along the heading.
        yaw_rate_radps: positive to the left.
    """

    start_m: NDArray[np.float64]
    heading_rad: float
    speed_mps: float
    yaw_rate_radps: float = 0.0

    def at(self, times_ns: ArrayLike) -> PlanarPoses:
        """Exact poses at (N,) int64 times."""
        seconds = np.atleast_1d(np.asarray(times_ns, dtype=np.float64)) / SECOND_NS
        turn = self.yaw_rate_radps * seconds
        way = self.speed_mps * seconds
        # Chord of an arc: length way sinc(turn / 2), direction half way through the turn.
        chord = way * np.sinc(turn / (2 * np.pi))
        middle = self.heading_rad + turn / 2
        positions = self.start_m + chord[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
        return PlanarPoses(positions_m=positions, yaws_rad=self.heading_rad + turn, distances_m=way)

    def velocity_mps(self, time_ns: int) -> NDArray[np.float64]:
        """(3,) float64, over the ground, world axes."""
        yaw = self.heading_rad + self.yaw_rate_radps * time_ns / SECOND_NS
        return self.speed_mps * np.array([np.cos(yaw), np.sin(yaw), 0.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HostPath:
    """The host's path, integrated from its speed and yaw rate.

    Attributes:
        nodes_ns: (K,) int64, 1 ms apart.
        speeds_mps: (K,) float64, negative in reverse gear.
        yaw_rates_radps: (K,) float64.
        poses: at the nodes.
    """

    nodes_ns: NDArray[np.int64]
    speeds_mps: NDArray[np.float64]
    yaw_rates_radps: NDArray[np.float64]
    poses: PlanarPoses

    def at(self, times_ns: ArrayLike) -> PlanarPoses:
        """Poses at (N,) int64 times within the nodes."""
        times = np.atleast_1d(np.asarray(times_ns, dtype=np.int64))
        assert self.nodes_ns[0] <= times.min()
        assert times.max() <= self.nodes_ns[-1]
        return PlanarPoses(
            positions_m=np.stack([self._between(times, self.poses.positions_m[:, k]) for k in (0, 1)], axis=1),
            yaws_rad=self._between(times, self.poses.yaws_rad),
            distances_m=self._between(times, self.poses.distances_m),
        )

    def signals(self, times_ns: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed speed (m/s) and yaw rate (rad/s) at (N,) times."""
        return self._between(times_ns, self.speeds_mps), self._between(times_ns, self.yaw_rates_radps)

    def _between(self, times_ns: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(times_ns.astype(np.float64), self.nodes_ns.astype(np.float64), values)


def host_path(
    *,
    times_s: ArrayLike,
    speeds_mps: ArrayLike,
    yaw_rates_radps: ArrayLike,
    first_ns: int,
    last_ns: int,
) -> HostPath:
    """Integrate a profile that is linear between its entries and constant beyond them.

    Args:
        times_s: (P,), s, increasing.
        speeds_mps: (P,), m/s, negative in reverse gear.
        yaw_rates_radps: (P,), rad/s.
        first_ns: first time wanted, <= 0.
        last_ns: last time wanted, > 0.
    """
    nodes = np.arange(first_ns // STEP_NS, -(-last_ns // STEP_NS) + 1, dtype=np.int64) * STEP_NS
    seconds = nodes / SECOND_NS
    profile_s = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
    speeds = np.interp(seconds, profile_s, np.atleast_1d(speeds_mps))
    yaw_rates = np.interp(seconds, profile_s, np.atleast_1d(yaw_rates_radps))
    zero = int(np.searchsorted(nodes, 0))
    yaws = _integral(seconds, yaw_rates, zero)
    distances = _integral(seconds, speeds, zero)
    middle = (yaws[1:] + yaws[:-1]) / 2
    chords = np.diff(distances) * np.sinc(np.diff(yaws) / (2 * np.pi))
    steps = chords[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    poses = PlanarPoses(positions_m=positions - positions[zero], yaws_rad=yaws, distances_m=distances)
    return HostPath(nodes_ns=nodes, speeds_mps=speeds, yaw_rates_radps=yaw_rates, poses=poses)


def _integral(seconds: NDArray[np.float64], rates: NDArray[np.float64], zero: int) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(np.diff(seconds) * (rates[1:] + rates[:-1]) / 2)])
    return np.asarray(total - total[zero])

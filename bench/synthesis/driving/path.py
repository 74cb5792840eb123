"""Poses of a body on the road, at any time.

Everything drives in the plane of the road. Time 0 is the first image; the world is the vehicle frame of the level ego
vehicle at that time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.geometry import RigidTransform

SECOND_NS = 1_000_000_000
STEP_NS = 1_000_000  # between the nodes of a path: linear in between is off by less than a micrometre


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Poses of a body at a row of times.

    Attributes:
        rotations: (N, 3, 3) float64, world from body.
        positions_m: (N, 3) float64, m, world.
        distances_m: (N,) float64, distance travelled since time 0, negative in reverse.
    """

    rotations: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    distances_m: NDArray[np.float64]

    def transform(self, index: int = 0) -> RigidTransform:
        """World from body of one row."""
        return RigidTransform(self.rotations[index], self.positions_m[index])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Path:
    """A path in the plane, integrated from speed and yaw rate.

    Attributes:
        nodes_ns: (K,) int64, 1 ms apart.
        speeds_mps: (K,) float64, negative in reverse gear.
        yaw_rates_radps: (K,) float64, positive to the left.
        positions_m: (K, 2) float64, m, world.
        yaws_rad: (K,) float64, world.
        distances_m: (K,) float64, distance travelled since time 0, negative in reverse.
        floor_m: height of the ground below the body.
    """

    nodes_ns: NDArray[np.int64]
    speeds_mps: NDArray[np.float64]
    yaw_rates_radps: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    distances_m: NDArray[np.float64]
    floor_m: float = 0.0

    def at(self, times_ns: ArrayLike) -> Poses:
        """Poses at (N,) int64 times within the nodes."""
        times = self._within(times_ns)
        ground = [self._between(times, self.positions_m[:, k]) for k in (0, 1)]
        return Poses(
            rotations=_rotations_about_z(self._between(times, self.yaws_rad)),
            positions_m=np.stack([*ground, np.full(len(times), self.floor_m)], axis=1),
            distances_m=self._between(times, self.distances_m),
        )

    def signals(self, times_ns: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed speed (m/s) and yaw rate (rad/s) at (N,) times within the nodes."""
        times = self._within(times_ns)
        return self._between(times, self.speeds_mps), self._between(times, self.yaw_rates_radps)

    def velocity_mps(self, time_ns: int) -> NDArray[np.float64]:
        """(3,) float64, over the ground, world axes."""
        times = self._within([time_ns])
        yaw, speed = self._between(times, self.yaws_rad)[0], self._between(times, self.speeds_mps)[0]
        return np.array([speed * np.cos(yaw), speed * np.sin(yaw), 0.0])

    def _within(self, times_ns: ArrayLike) -> NDArray[np.int64]:
        times = np.atleast_1d(np.asarray(times_ns, dtype=np.int64))
        assert self.nodes_ns[0] <= times.min()
        assert times.max() <= self.nodes_ns[-1]
        return times

    def _between(self, times_ns: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(times_ns.astype(np.float64), self.nodes_ns.astype(np.float64), values)


def driven_path(
    *,
    times_s: ArrayLike,
    speeds_mps: ArrayLike,
    yaw_rates_radps: ArrayLike,
    first_ns: int,
    last_ns: int,
    through: tuple[float, float, float] = (0.0, 0.0, 0.0),
    through_ns: int = 0,
    floor_m: float = 0.0,
    ramp_s: float = 0.0,
) -> Path:
    """Integrate a profile that is linear between its entries and constant beyond them.

    Args:
        times_s: (P,), s, increasing.
        speeds_mps: (P,) or one for all, m/s, negative in reverse gear.
        yaw_rates_radps: (P,) or one for all, rad/s.
        first_ns: first time wanted, <= 0.
        last_ns: last time wanted, > 0.
        through: x (m), y (m) and yaw (rad) in the world at `through_ns`.
        through_ns: a whole millisecond between the first and the last time.
        floor_m: height of the ground below the body.
        ramp_s: the profile's corners are rounded by a mean over this time.
    """
    nodes = np.arange(first_ns // STEP_NS, -(-last_ns // STEP_NS) + 1, dtype=np.int64) * STEP_NS
    seconds = nodes / SECOND_NS
    profile_s = np.atleast_1d(np.asarray(times_s, dtype=np.float64))
    speeds = _rounded(seconds, profile_s, np.broadcast_to(speeds_mps, len(profile_s)), ramp_s)
    yaw_rates = _rounded(seconds, profile_s, np.broadcast_to(yaw_rates_radps, len(profile_s)), ramp_s)
    zero, here = np.searchsorted(nodes, [0, through_ns])
    distances = _integral(seconds, speeds, int(zero))
    if yaw_rates.any():
        yaws = through[2] + _integral(seconds, yaw_rates, int(here))
        positions = _along_arcs(distances, yaws)
    else:
        yaws = np.full_like(seconds, through[2])
        positions = distances[:, None] * np.array([np.cos(through[2]), np.sin(through[2])])
    return Path(
        nodes_ns=nodes,
        speeds_mps=speeds,
        yaw_rates_radps=yaw_rates,
        positions_m=positions - positions[here] + np.array(through[:2]),
        yaws_rad=yaws,
        distances_m=distances,
        floor_m=floor_m,
    )


def _along_arcs(distances_m: NDArray[np.float64], yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions (K, 2) from the first node on: between nodes, the chord of an arc halfway through the change of yaw."""
    middle = (yaws_rad[1:] + yaws_rad[:-1]) / 2
    chords = np.diff(distances_m) * np.sinc(np.diff(yaws_rad) / (2 * np.pi))  # distance * sinc(yaw change / 2)
    steps = chords[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _rotations_about_z(yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3, 3) rotations about z."""
    rotations = np.zeros((len(yaws_rad), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = np.cos(yaws_rad)
    rotations[:, 1, 0] = np.sin(yaws_rad)
    rotations[:, 0, 1] = -rotations[:, 1, 0]
    rotations[:, 2, 2] = 1.0
    return rotations


def _rounded(
    seconds: NDArray[np.float64], profile_s: NDArray[np.float64], values: NDArray[np.float64], ramp_s: float
) -> NDArray[np.float64]:
    """The profile at times, each value the mean of the profile over a window around its time."""
    if ramp_s == 0.0:
        return np.interp(seconds, profile_s, values)
    nodes_s = np.unique(np.concatenate([profile_s, seconds - ramp_s / 2, seconds + ramp_s / 2]))
    area = _integral(nodes_s, np.interp(nodes_s, profile_s, values), 0)
    low, high = (np.interp(seconds + side * ramp_s / 2, nodes_s, area) for side in (-1, 1))
    return np.asarray((high - low) / ramp_s)


def _integral(seconds: NDArray[np.float64], rates: NDArray[np.float64], zero: int) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(np.diff(seconds) * (rates[1:] + rates[:-1]) / 2)])
    return np.asarray(total - total[zero])

"""How the host moves: its way in the plane, and its body's sway on top of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from bench.synthesis.driving.path import Path, Poses
from bench.synthesis.driving.roughness import road_profile
from bench.synthesis.driving.suspension import Sway, sway
from bench.synthesis.scenario import BumpSpec, SuspensionSpec


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HostMotion:
    """The host, to whose body the sensors are bolted.

    Attributes:
        ground: the way of the level host: of its origin, below the middle of the rear axle, in the plane of the road.
        attitude: of the body at the ground's nodes; None for a rigid car.
        centre_m: (3,) float64, level vehicle frame, what the body pitches and rolls about.
    """

    ground: Path
    attitude: Sway | None
    centre_m: NDArray[np.float64]

    @property
    def nodes_ns(self) -> NDArray[np.int64]:
        """(K,) int64, 1 ms apart; the motion is known between the first and the last."""
        return self.ground.nodes_ns

    def at(self, times_ns: ArrayLike) -> Poses:
        """World from body at (N,) int64 times within the nodes; `distances_m` is the way over the ground."""
        level = self.ground.at(times_ns)
        if self.attitude is None:
            return level
        times = np.atleast_1d(np.asarray(times_ns, dtype=np.int64)).astype(np.float64)
        nodes = self.nodes_ns.astype(np.float64)
        pitch, roll, heave = (
            np.interp(times, nodes, values)
            for values in (self.attitude.pitch_rad, self.attitude.roll_rad, self.attitude.heave_m)
        )
        level_from_body = Rotation.from_euler("YX", np.column_stack([pitch, roll])).as_matrix()
        shifts_level = self.centre_m - level_from_body @ self.centre_m
        shifts_level[:, 2] += heave
        return Poses(
            rotations=level.rotations @ level_from_body,
            positions_m=level.positions_m + np.einsum("nij,nj->ni", level.rotations, shifts_level),
            distances_m=level.distances_m,
        )

    def signals(self, times_ns: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed speed (m/s) and yaw rate (rad/s) of the level host at (N,) times within the nodes."""
        return self.ground.signals(times_ns)

    def velocity_mps(self, time_ns: int) -> NDArray[np.float64]:
        """(3,) float64, of the level host over the ground, world axes; the body's sway adds centimetres per second."""
        return self.ground.velocity_mps(time_ns)


def host_motion(
    ground: Path, suspension: SuspensionSpec | None, *, bumps: Sequence[BumpSpec] = (), rng: np.random.Generator
) -> HostMotion:
    """The motion of the host's body.

    Args:
        ground: the way of the level host.
        suspension: None for a rigid car, which feels no bumps.
        bumps: on the way.
        rng: the unevenness of the road.
    """
    if suspension is None:
        return HostMotion(ground=ground, attitude=None, centre_m=np.zeros(3))
    road = road_profile(suspension.road_class, bumps, rng)
    return HostMotion(ground=ground, attitude=sway(ground, road, suspension), centre_m=np.array(suspension.centre_m))

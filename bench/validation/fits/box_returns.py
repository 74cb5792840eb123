"""Lidar returns and beams in the frame of each box, counted for every reading of the boxes.

A box that is right holds the returns around it, and no beam passes through it to meet something behind. So the share
inside, of all returns in and just outside of a box and of the beams through it, tells readings of the boxes apart:
with full sizes instead of half ones, in another frame, at another time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.geometry import RigidTransform
from bench.lidar.sweep import LidarSweep
from bench.recordings import Cuboid, Recording
from bench.reference.sweeps import pose_sweep
from bench.times import SECOND_NS

RING_M = 0.4  # around the box in which returns count as outside
SLACK_M = 0.03  # scatter of ranges
CORE = 0.6  # of the box's sizes that beams have to pass through
ROAD_M = 0.25  # lower returns are the road's
POROUS = 3.0  # beams that pass between legs, arms and spokes for each that ends there
MARGINS_M = np.arange(11) / 100  # around the box
ROUNDED_M = 0.001  # coordinates are stored to about as much
MOST_RETURNS, MOST_BEAMS = 300, 100  # of each box and sweep; more are thinned out
Vectors = NDArray[np.floating]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boxes:
    """Several boxes around one place.

    Attributes:
        rotations: (H, 3, 3), vehicle_from_object.
        centres_m: (H, 3), vehicle frame.
        sizes_m: (H, 3).
    """

    rotations: Vectors
    centres_m: Vectors
    sizes_m: Vectors

    @classmethod
    def of(cls, boxes: list[Cuboid]) -> Boxes:
        """From single ones."""
        return cls(
            rotations=np.array([box.vehicle_from_object.rotation for box in boxes]),
            centres_m=np.array([box.vehicle_from_object.translation_m for box in boxes]),
            sizes_m=np.array([box.size_m for box in boxes]),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Near:
    """Beams around a place, moved with an object, vehicle frame at the time of its annotation.

    Attributes:
        start_m: (3,), where they start, on average.
        returns_m: (N, 3), returns above the road within reach.
        ends_m: (M, 3), ends of beams that pass the place.
        weights: of each of `returns_m` and each of `ends_m`: more than 1 where they are thinned out.
    """

    start_m: Vectors
    returns_m: Vectors
    ends_m: Vectors
    weights: tuple[float, float]

    def counts(self, boxes: Boxes, *, opaque: bool) -> NDArray[np.float64]:
        """Count for each box.

        Args:
            boxes: H.
            opaque: beams end at bodywork, but pass between legs and spokes.

        Returns:
            (H, 3) float64, returns inside, returns just outside, beams through.
        """
        half = boxes.sizes_m[:, None] / 2
        beyond = np.max(np.abs(_local(self.returns_m, boxes)) - half, axis=2)
        enter, leave = _crossing(_local(self.start_m[None], boxes), _local(self.ends_m, boxes), CORE * half)
        through = (enter > 0) & (enter < leave) & (leave < 1.0)
        inside, outside = beyond <= SLACK_M, (beyond > SLACK_M) & (beyond < RING_M)
        a_return, a_beam = self.weights
        held, passed = a_return * inside.sum(axis=1), a_beam * through.sum(axis=1)
        if not opaque:
            passed = np.maximum(passed - POROUS * held, 0.0)
        return np.column_stack([held, a_return * outside.sum(axis=1), passed])

    def depths_m(self, box: Cuboid) -> NDArray[np.float64]:
        """Distances of its returns and those around it outside of a box, (N,) float64, m; negative inside."""
        local = np.abs(_local(self.returns_m, Boxes.of([box]))[0])
        return np.asarray(np.max(local - box.size_m / 2, axis=1))


def returns_held(outside_m: Vectors) -> NDArray[np.float64]:
    """Number of returns, (11,) float64, in a box with each of `MARGINS_M` around it; `outside_m` as of `depths_m`."""
    return np.asarray((outside_m[:, None] <= MARGINS_M + ROUNDED_M).sum(axis=0), dtype=np.float64)


def _local(points_m: Vectors, boxes: Boxes) -> Vectors:
    """(H, N, 3), points in the frame of each box."""
    return np.asarray(np.einsum("hni,hij->hnj", points_m[None] - boxes.centres_m[:, None], boxes.rotations))


def _crossing(start: Vectors, ends: Vectors, half_m: Vectors) -> tuple[Vectors, Vectors]:
    """Parts of the way from a start to ends, box frame, at which beams enter and leave; enter >= leave if they miss."""
    along = ends - start
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half_m - start) / along, (half_m - start) / along
    return np.fmin(one, other).max(axis=-1), np.fmax(one, other).min(axis=-1)


class Beams:
    """The beams of a sweep, sorted by bearing.

    Args:
        sweep: its points.
        recording: the drive.

    Raises:
        LookupError: there is no ego-motion for it.
    """

    def __init__(self, sweep: LidarSweep, recording: Recording) -> None:
        posed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar)
        rotations, positions_m, valid = recording.trajectory.at(np.array([sweep.timestamp_ns], dtype=np.int64))
        if posed is None or not valid[0]:
            raise LookupError("no ego-motion")
        self._world_from_vehicle = RigidTransform(rotations[0], positions_m[0])
        vehicle_from_world = self._world_from_vehicle.inverse()
        rows = np.clip(np.searchsorted(posed.interpolation_ns, posed.times_ns), 0, len(posed.interpolation_ns) - 1)
        starts = vehicle_from_world.apply(posed.positions_m)
        ends = vehicle_from_world.apply(posed.points_world())
        self._middle = starts.mean(axis=0)
        bearing = np.arctan2(*(ends - self._middle)[:, 1::-1].T)
        order = np.argsort(bearing)
        self._bearing, self._ends, self._starts = bearing[order], ends[order], starts[rows][order]
        self._times_ns, self._time_ns = posed.times_ns[order], sweep.timestamp_ns
        self._road_m = recording.ground_m

    def near(
        self,
        box: Cuboid,
        *,
        time_ns: int,
        vehicle_from_world: RigidTransform,
        velocity_mps: Vectors,
        reach_m: float,
    ) -> Near:
        """Beams around a box.

        Args:
            box: vehicle frame at `time_ns`.
            time_ns: of the annotation.
            vehicle_from_world: then.
            velocity_mps: (3,), of the object over the ground, world axes.
            reach_m: how far around the box returns are looked for.
        """
        now_from_sweep = vehicle_from_world @ self._world_from_vehicle
        centre = now_from_sweep.inverse().apply(box.vehicle_from_object.translation_m)
        rows = self._towards(centre, float(np.hypot(*box.size_m[:2])) / 2 + reach_m)
        seconds = (time_ns - self._times_ns[rows]) / SECOND_NS
        shift = vehicle_from_world.rotate(np.asarray(velocity_mps, dtype=np.float64)) * seconds[:, None]
        ends = now_from_sweep.apply(self._ends[rows]) + shift
        start = (now_from_sweep.apply(self._starts[rows]) + shift).mean(axis=0) if len(rows) else np.zeros(3)
        around = Boxes.of([Cuboid(vehicle_from_object=box.vehicle_from_object, size_m=box.size_m + 2 * reach_m)])
        local, local_start = _local(ends, around)[0], _local(start[None], around)[0]
        half = around.sizes_m[0] / 2
        lowest_m = self._road_m + min(ROAD_M, 0.3 * float(box.size_m[2]))
        close = (np.abs(local) < half).all(axis=1)
        enter, leave = _crossing(local_start, local, half)
        returns, a_return = _thinned(ends[close & (ends[:, 2] > lowest_m)], MOST_RETURNS)
        passing, a_beam = _thinned(ends[(enter < leave) & (leave > 0)], MOST_BEAMS + MOST_RETURNS)
        return Near(start_m=start, returns_m=returns, ends_m=passing, weights=(a_return, a_beam))

    def _towards(self, centre: Vectors, radius_m: float) -> NDArray[np.intp]:
        away = centre - self._middle
        distance_m = float(np.hypot(*away[:2]))
        if distance_m <= radius_m:
            return np.arange(len(self._ends))
        half = float(np.arcsin(radius_m / distance_m)) + 0.02
        middle = float(np.arctan2(away[1], away[0]))
        pieces = [
            np.arange(*np.searchsorted(self._bearing, [middle - half + turn, middle + half + turn]))
            for turn in (-2 * np.pi, 0.0, 2 * np.pi)
        ]
        return np.concatenate(pieces)


def _thinned(points: Vectors, most: int) -> tuple[Vectors, float]:
    step = max(int(np.ceil(len(points) / most)), 1)
    return points[::step], float(step)

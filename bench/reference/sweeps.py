"""A lidar sweep placed in the world, and the choice of the sweep for an exposure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import LidarSweep, deskew, interpolation_timestamps
from bench.records.recording import ObjectShape, PointIndices, Recording
from bench.reference.envelope import Envelope, find_envelope
from bench.reference.grid import Grid, find_grid


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedSweep:
    """A sweep with the lidar's pose over its time, computed once for all objects.

    Attributes:
        sweep: the points.
        times_ns: (N,) int64, time of each point.
        interpolation_ns: (K,) int64, K >= 2.
        rotations: (K, 3, 3) float64, world_from_lidar.
        positions_m: (K, 3) float64, m.
        lidar_from_sensor: `Recording.lidar_from_sensor`, the pose of the sensor in the frame of the points.
        revolution_ns: how long a revolution takes; 0 where unknown.
    """

    sweep: LidarSweep
    times_ns: NDArray[np.int64]
    interpolation_ns: NDArray[np.int64]
    rotations: NDArray[np.float64]
    positions_m: NDArray[np.float64]
    lidar_from_sensor: RigidTransform
    revolution_ns: int

    @cached_property
    def envelope(self) -> Envelope:
        """The lowest beam, which meets the road, and the highest that meets anything."""
        sensor_from_lidar, components = self.lidar_from_sensor.inverse(), self._components
        rotation = sensor_from_lidar.rotation.astype(
            components.dtype
        )  # every point of the sweep, once: in its own type
        points = rotation @ components + sensor_from_lidar.translation_m.astype(components.dtype)[:, None]
        return find_envelope(points.T)

    def rows_between(self, low_lidar: NDArray[np.float64], high_lidar: NDArray[np.float64]) -> NDArray[np.intp]:
        """Rows of the points, as measured, whose x and y lie between those of two corners, lidar frame, m."""
        # Plain numbers: for NumPy's own, every x of a float32 sweep would first be made a float64.
        (x0, y0), (x1, y1) = low_lidar[:2].tolist(), high_lidar[:2].tolist()
        x, y, _ = self._components
        with np.errstate(over="ignore"):  # what float32 cannot hold is as good as infinite
            return np.flatnonzero((x > x0) & (x < x1) & (y > y0) & (y < y1))

    @cached_property
    def azimuths_rad(self) -> NDArray[np.floating]:
        """(N,), of all points, sensor frame at each one's own time, in their own type."""
        rotation = self.lidar_from_sensor.rotation.T.astype(self._components.dtype)
        x, y, _ = rotation @ self._components
        offset_x, offset_y, _ = self.lidar_from_sensor.inverse().translation_m.astype(x.dtype)
        return np.asarray(np.arctan2(y + offset_y, x + offset_x))

    @cached_property
    def _components(self) -> NDArray[np.floating]:
        """x, y and z, (3, N), each in one piece: every object searches them."""
        return np.ascontiguousarray(self.sweep.points_lidar.T)

    def points_world(self, rows: NDArray[np.intp] | slice = slice(None)) -> NDArray[np.float64]:
        """Motion-compensated points, (K, 3) float64, m, world frame; each where it was at its own time."""
        taken = self._components[:, rows] if isinstance(rows, slice) else self._components.take(rows, axis=1)
        return deskew(
            taken.T,
            self.times_ns[rows],
            interpolation_ns=self.interpolation_ns,
            rotations=self.rotations,
            positions_m=self.positions_m,
        )

    def points_sensor(self, rows: NDArray[np.intp] | slice = slice(None)) -> NDArray[np.float64]:
        """Points in the sensor frame at each point's own time, (K, 3) float64, m."""
        return self.lidar_from_sensor.inverse().apply(self.sweep.points_lidar[rows].astype(np.float64))

    def points_from_beams(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """As `points_sensor`, each seen from where its beam starts on the sensor's upright axis."""
        points = self.points_sensor(rows)
        points[:, 2] -= self.envelope.starts_m(points)
        return points

    def grid(self, rows: NDArray[np.intp]) -> Grid | None:
        """Neighbours among these points; cached, since images that share a sweep ask for the same points."""
        key = rows.tobytes()
        if key not in self._grids:
            points = self.points_from_beams(rows)
            self._grids[key] = find_grid(points, starts_apart_m=self.envelope.starts_apart_m)
        return self._grids[key]

    @cached_property
    def _grids(self) -> dict[bytes, Grid | None]:
        return {}


def pose_sweep(
    sweep: LidarSweep,
    trajectory: Trajectory,
    vehicle_from_lidar: RigidTransform,
    lidar_from_sensor: RigidTransform | None = None,
    revolution_ns: int = 0,
) -> PosedSweep | None:
    """Find the lidar's poses during a sweep.

    Args:
        sweep: the points.
        trajectory: ego-motion.
        vehicle_from_lidar: mounting of the frame of the points.
        lidar_from_sensor: pose of the sensor in that frame; None for its origin and axes.
        revolution_ns: how long a revolution takes; 0 where unknown.

    Returns:
        None where the sweep has no points or ego-motion is missing for part of it.
    """
    times_ns = sweep.times_ns
    interpolation_ns = interpolation_timestamps(times_ns)
    rotations, positions_m, valid = trajectory.at(interpolation_ns)
    if not (len(interpolation_ns) and valid.all()):
        return None
    return PosedSweep(
        sweep=sweep,
        times_ns=times_ns,
        interpolation_ns=interpolation_ns,
        rotations=rotations @ vehicle_from_lidar.rotation,
        positions_m=rotations @ vehicle_from_lidar.translation_m + positions_m,
        lidar_from_sensor=lidar_from_sensor or RigidTransform.identity(),
        revolution_ns=revolution_ns,
    )


class SweepCache:
    """Reads the sweep for an exposure; caches the last one, since neighbouring images share it.

    Args:
        recording: the drive.
        max_gap_ns: a sweep further from the exposure is not used.
    """

    def __init__(self, recording: Recording, max_gap_ns: int) -> None:
        self._recording, self._max_gap_ns = recording, max_gap_ns
        self._times_ns = np.array([ref.timestamp_ns for ref in recording.sweeps], dtype=np.int64)
        self._revolution_ns = int(np.median(np.diff(self._times_ns))) if len(self._times_ns) > 1 else 0
        self._held: tuple[int, PosedSweep | None] | None = None

    def nearest(self, shape: ObjectShape | None, exposure_ns: int) -> PosedSweep | None:
        """The sweep nearest to the exposure; for point indices the one that they count in.

        Returns:
            None where there is no sweep near enough, or no ego-motion for it.

        Raises:
            DataError: point indices of a sweep that does not exist, or a file that cannot be read.
        """
        counted_ns = shape.sweep_timestamp_ns if isinstance(shape, PointIndices) else None
        away_ns = np.abs(self._times_ns - (exposure_ns if counted_ns is None else counted_ns))
        if counted_ns is not None and not (away_ns == 0).any():
            raise DataError(
                self._recording.root,
                field="annotations",
                expected=f"a lidar sweep at {counted_ns}, in which point indices count",
                got="no sweep of that time",
            )
        if not away_ns.size or away_ns.min() > (self._max_gap_ns if counted_ns is None else 0):
            return None
        nearest = int(np.argmin(away_ns))
        if self._held is None or self._held[0] != nearest:
            self._held = nearest, self._placed(self._recording.sweeps[nearest].read())
        return self._held[1]

    def _placed(self, sweep: LidarSweep) -> PosedSweep | None:
        drive = self._recording
        return pose_sweep(
            sweep, drive.trajectory, drive.vehicle_from_lidar, drive.lidar_from_sensor, self._revolution_ns
        )

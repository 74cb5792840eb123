"""One revolution of a lidar, and the compensation of the lidar's own motion (de-skew)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, ShapeError
from bench.geometry import Floats

Arrays = dict[str, NDArray[Any]]  # of a point cloud, by name
LARGEST_BYTES = 1 << 28  # of an unpacked sweep: ten million points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LidarSweep:
    """The points of one revolution.

    Attributes:
        timestamp_ns: the sweep's reference time, at which `time_offset_ns` is 0.
        points_lidar: (N, 3) float32 or float64, m, lidar frame at each point's own time; finite.
        time_offset_ns: (N,) int64, each point's time minus `timestamp_ns`; None where it is not known, then
            every point counts as taken at `timestamp_ns`.
        intensity: (N,) float32 in [0, 1], or None.
        ring: (N,) uint8, index of the laser, or None.
        stored_rows: (N,) int64, increasing, which rows of the stored cloud the points are, where returns without a
            position were left out; None for all of them.
        stored_count: rows of the stored cloud; None for N.
        read_fields: of the stored cloud, beside the positions.
        unread_fields: of the stored cloud, that nothing here is made of.

    Raises:
        ShapeError: arrays that do not fit together.
    """

    timestamp_ns: int
    points_lidar: NDArray[np.floating]
    time_offset_ns: NDArray[np.int64] | None = None
    intensity: NDArray[np.float32] | None = None
    ring: NDArray[np.uint8] | None = None
    stored_rows: NDArray[np.int64] | None = None
    stored_count: int | None = None
    read_fields: tuple[str, ...] = ()
    unread_fields: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.points_lidar.ndim != 2 or self.points_lidar.shape[1] != 3:
            raise ShapeError(f"points_lidar: expected (N, 3), got {self.points_lidar.shape}")
        for name in ("time_offset_ns", "intensity", "ring"):
            values = getattr(self, name)
            if values is not None and values.shape != (len(self.points_lidar),):
                raise ShapeError(f"{name}: expected one per point ({len(self.points_lidar)},), got {values.shape}")

    @property
    def rows_stored(self) -> int:
        """Rows of the stored cloud, lost returns among them: what labels of points count."""
        return len(self.points_lidar) if self.stored_count is None else self.stored_count

    def rows_of(self, stored: NDArray[np.integer]) -> NDArray[np.intp]:
        """Rows of the points that rows of the stored cloud are; those of lost returns are left out.

        Raises:
            DataError: numbers that are no rows of the cloud.
        """
        rows = np.asarray(stored, dtype=np.intp)
        if rows.size and not 0 <= rows.min() <= rows.max() < self.rows_stored:
            raise DataError(
                f"annotations at the sweep of {self.timestamp_ns} ns",
                field="point_indices",
                expected=f"rows of its cloud, 0 to {self.rows_stored - 1}",
                got=f"{rows.min()} to {rows.max()}",
            )
        if self.stored_rows is None:
            return rows
        places = np.full(self.rows_stored, -1, dtype=np.intp)
        places[self.stored_rows] = np.arange(len(self.stored_rows))
        return places[rows][places[rows] >= 0]

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """(N,) int64, absolute time of each point."""
        if self.time_offset_ns is None:
            return np.full(len(self.points_lidar), self.timestamp_ns, dtype=np.int64)
        return np.asarray(self.timestamp_ns + self.time_offset_ns.astype(np.int64))


INTERPOLATION_STEP_NS = 5_000_000  # at 1 rad/s linear interpolation over it is off by 3e-6 of the range


def interpolation_timestamps(times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Times, at most 5 ms apart, that span the times of points.

    Args:
        times_ns: (N,) int64.

    Returns:
        (K,) int64, increasing, K >= 2, the first at or before and the last after every point; empty for no points.
    """
    if not times_ns.size:
        return np.empty(0, dtype=np.int64)
    first, last = int(times_ns.min()), int(times_ns.max())
    intervals = max(1, -(-(last + 1 - first) // INTERPOLATION_STEP_NS))
    # From 0 on: times since 1970 have more digits than a float, and neighbours would become equal.
    return np.asarray(first + np.linspace(0, max(last - first, 1), intervals + 1).round().astype(np.int64))


def deskew(
    points_lidar: NDArray[np.floating],
    times_ns: NDArray[np.int64],
    *,
    interpolation_ns: NDArray[np.int64],
    rotations: Floats,
    positions_m: Floats,
) -> Floats:
    """Apply to each point the sensor's pose at the point's own time.

    Poses are interpolated linearly, which is exact to second order in the few milliseconds between them.

    Args:
        points_lidar: (N, 3), m, lidar frame at each point's own time.
        times_ns: (N,) int64, within `interpolation_ns`.
        interpolation_ns: (K,) int64, timestamps of the poses, increasing, K >= 2.
        rotations: (K, 3, 3) float64, reference_from_lidar.
        positions_m: (K, 3) float64, m, position of the lidar in the reference frame.

    Returns:
        (N, 3) float64, m, in the reference frame; each component contiguous in memory.
    """
    moved = np.empty((3, len(points_lidar)))
    if (times_ns[1:] < times_ns[:-1]).any():
        order = np.argsort(times_ns, kind="stable")
        moved[:, order] = deskew(
            points_lidar[order],
            times_ns[order],
            interpolation_ns=interpolation_ns,
            rotations=rotations,
            positions_m=positions_m,
        ).T
        return moved.T
    poses = np.concatenate([rotations, positions_m[:, :, None]], axis=2)
    poses_and_changes = np.concatenate([poses[:-1], np.diff(poses, axis=0)], axis=1)
    homogeneous = np.ones((4, len(points_lidar)))
    homogeneous[:3] = points_lidar.T
    bounds = [0, *np.searchsorted(times_ns, interpolation_ns[1:-1]).tolist(), len(times_ns)]
    for k, (first, last) in enumerate(pairwise(bounds)):  # all points between two timestamps at once
        if first < last:
            points = homogeneous[:, first:last]
            span_ns = float(interpolation_ns[k + 1] - interpolation_ns[k])
            part = (times_ns[first:last] - interpolation_ns[k]) / span_ns
            both = poses_and_changes[k] @ points
            moved[:, first:last] = both[:3] + part * both[3:]
    return moved.T

"""One revolution of a lidar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LidarSweep:
    """The points of one revolution.

    Attributes:
        timestamp_ns: the sweep's reference time, at which `time_offset_ns` is 0.
        points_lidar: (N, 3) float32 or float64, m, lidar frame at each point's own time; finite.
        time_offset_ns: (N,) int64, each point's time minus `timestamp_ns`; None where the sensor does not tell, then
            every point counts as taken at `timestamp_ns`.
        intensity: (N,) float32 in [0, 1], or None.
        ring: (N,) uint8, index of the laser, or None.

    Raises:
        ShapeError: arrays that do not fit together.
    """

    timestamp_ns: int
    points_lidar: NDArray[np.floating]
    time_offset_ns: NDArray[np.int64] | None = None
    intensity: NDArray[np.float32] | None = None
    ring: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        if self.points_lidar.ndim != 2 or self.points_lidar.shape[1] != 3:
            raise ShapeError(f"points_lidar: expected (N, 3), got {self.points_lidar.shape}")
        for name in ("time_offset_ns", "intensity", "ring"):
            values = getattr(self, name)
            if values is not None and values.shape != (len(self.points_lidar),):
                raise ShapeError(f"{name}: expected one per point ({len(self.points_lidar)},), got {values.shape}")

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """(N,) int64, absolute time of each point."""
        if self.time_offset_ns is None:
            return np.full(len(self.points_lidar), self.timestamp_ns, dtype=np.int64)
        return np.asarray(self.timestamp_ns + self.time_offset_ns.astype(np.int64))

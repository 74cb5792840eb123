"""Scans of KITTI-360's Velodyne HDL-64E, whose points have no time of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.errors import DataError
from bench.lidar import LidarSweep, read_points

LARGEST_BYTES = 64_000_000  # four million points; a turn of this scanner has about 120,000


def read_turn(path: Path, timestamp_ns: int, *, period_ns: int) -> LidarSweep:
    """Read one turn and give each point its time by its azimuth.

    The scanner turns clockwise seen from above and passes straight ahead when the cameras are triggered, at the time of
    the frame. A point at azimuth a, positive to the left, was measured a/(2 pi) of a turn earlier. Points just left and
    just right of straight back are thus the first and the last of the turn.

    Args:
        path: `.bin` file of float32 x, y, z, intensity, velodyne frame, as measured (not freed of the car's motion).
        timestamp_ns: of the frame.
        period_ns: duration of a turn.

    Raises:
        DataError: missing, too large, cut short, empty, or points that are not finite.

    Source:
        Deskewing in kitti360Scripts (`curlVelodyneData`): a point is moved by its azimuth's share of the motion between
        the poses of the frame and of the one before.
    """
    if path.is_file() and path.stat().st_size > LARGEST_BYTES:
        raise DataError(path, expected=f"at most {LARGEST_BYTES} bytes", got=str(path.stat().st_size))
    arrays = read_points(path)
    points = arrays["points_lidar"]
    turn = np.arctan2(points[:, 1].astype(np.float64), points[:, 0].astype(np.float64)) / (2 * np.pi)
    return LidarSweep(
        timestamp_ns=timestamp_ns,
        points_lidar=points,
        time_offset_ns=np.rint(-turn * period_ns).astype(np.int64),
        intensity=arrays["intensity"],
    )

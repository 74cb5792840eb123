"""Lidar sweeps: the record, the point-cloud files and the removal of the sensor's own motion (de-skew).

A sweep is one revolution. Its points stand in the lidar frame as it was at each point's own time. The lidar room
knows nothing of vehicles: whoever de-skews hands in the poses (`bench.egomotion` has them).
"""

from bench.lidar.cloud_files import open3d
from bench.lidar.files import read_points, read_sweep, write_points, write_sweep
from bench.lidar.sweep import LidarSweep, deskew, knot_times

__all__ = [
    "LidarSweep",
    "deskew",
    "knot_times",
    "open3d",
    "read_points",
    "read_sweep",
    "write_points",
    "write_sweep",
]

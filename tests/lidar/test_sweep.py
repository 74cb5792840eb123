"""What a sweep says of its points: their times, and their rows in the stored cloud."""

import numpy as np

from bench.lidar import LidarSweep


def sweep(**fields) -> LidarSweep:
    return LidarSweep(timestamp_ns=1000, points_lidar=np.zeros((3, 3), np.float32), **fields)


def test_a_point_is_as_much_later_than_its_sweep_as_its_offset_says():
    assert sweep().times_ns.tolist() == [1000, 1000, 1000]
    assert sweep(time_offset_ns=np.array([-5, 0, 7])).times_ns.tolist() == [995, 1000, 1007]


def test_rows_of_the_stored_cloud_are_those_of_its_points_without_lost_returns():
    assert sweep().rows_of(np.array([2, 0])).tolist() == [2, 0]
    lossy = sweep(stored_rows=np.array([0, 2, 5]), stored_count=7)
    assert lossy.rows_stored == 7
    assert lossy.rows_of(np.array([0, 1, 2, 5, 6])).tolist() == [0, 1, 2]

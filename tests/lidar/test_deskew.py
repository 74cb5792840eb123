"""Points from a moving sensor."""

import numpy as np
import pytest

from bench.lidar import LidarSweep, deskew, knot_times

SECOND_NS = 1_000_000_000


def test_knots_span_the_points_at_most_five_milliseconds_apart():
    knots_ns = knot_times(np.array([3, 11_000_003], dtype=np.int64))
    assert knots_ns[0] <= 3
    assert knots_ns[-1] >= 11_000_003
    assert np.diff(knots_ns).min() > 0
    assert np.diff(knots_ns).max() <= 5_000_001
    assert len(knot_times(np.empty(0, dtype=np.int64))) == 0
    assert len(knot_times(np.array([7], dtype=np.int64))) == 2


def test_a_wall_stays_a_wall_when_the_car_drives_at_it():
    # 30 m/s for 0.1 s: a wall 50 m away is measured at 50 m first and at 47 m last.
    times_ns = np.linspace(0, SECOND_NS // 10, 11).astype(np.int64)
    measured = np.zeros((11, 3))
    measured[:, 0] = 50.0 - 30.0 * times_ns / 1e9
    knots_ns = knot_times(times_ns)
    positions_m = np.zeros((len(knots_ns), 3))
    positions_m[:, 0] = 30.0 * knots_ns / 1e9
    rotations = np.tile(np.eye(3), (len(knots_ns), 1, 1))
    straight = deskew(measured, times_ns, knots_ns=knots_ns, rotations=rotations, positions_m=positions_m)
    assert straight[:, 0] == pytest.approx(50.0, abs=1e-9)


def test_a_turning_sensor_sees_a_point_stand_still():
    times_ns = np.linspace(0, SECOND_NS // 10, 21).astype(np.int64)

    def turned(angles_rad):
        cosine, sine, zero = np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad))
        rows = [cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1]
        return np.stack(rows, axis=1).reshape(-1, 3, 3)

    point = np.array([20.0, 5.0, 1.0])
    measured = np.einsum("nji,j->ni", turned(times_ns / 1e9), point)
    knots_ns = knot_times(times_ns)
    still = deskew(
        measured,
        times_ns,
        knots_ns=knots_ns,
        rotations=turned(knots_ns / 1e9),
        positions_m=np.zeros((len(knots_ns), 3)),
    )
    assert np.abs(still - point).max() < 3.2e-6 * np.linalg.norm(point)


def test_times_of_points_default_to_that_of_the_sweep():
    sweep = LidarSweep(timestamp_ns=5, points_lidar=np.zeros((2, 3), np.float32))
    assert sweep.times_ns.tolist() == [5, 5]


def test_knots_of_times_since_1970_stay_apart():
    """Such times have more digits than a float holds; a sweep without times of its points is one instant."""
    time_ns = 1_700_000_000_000_000_001
    knots_ns = knot_times(np.array([time_ns, time_ns], dtype=np.int64))
    assert knots_ns.tolist() == [time_ns, time_ns + 1]

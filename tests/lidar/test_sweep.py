"""Points of a sweep, seen from where their sensor was at their times."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.lidar.sweep import deskew, interpolation_timestamps
from bench.times import SECOND_NS

SINCE_1970_NS = 1_700_000_000_000_000_001  # more digits than a float holds


@pytest.mark.parametrize(
    ("times_ns", "expected_ns"),
    [
        ([], []),
        ([7], [7, 8]),
        ([3, 2_000_003], [3, 2_000_003]),
        ([3, 5_000_002], [3, 5_000_002]),  # with the time after the last point 5 ms: one step
        ([3, 5_000_003], [3, 2_500_003, 5_000_003]),
        ([11_000_003, 3], [3, 3_666_670, 7_333_336, 11_000_003]),
        ([SINCE_1970_NS] * 2, [SINCE_1970_NS, SINCE_1970_NS + 1]),  # a sweep without times of its points is one instant
    ],
)
def test_timestamps_span_the_points_in_the_fewest_even_steps_of_at_most_five_milliseconds(times_ns, expected_ns):
    assert interpolation_timestamps(np.array(times_ns, dtype=np.int64)).tolist() == expected_ns


def test_a_turning_sensor_sees_a_point_stand_still():
    def rotated(times_ns):
        return Rotation.from_euler("z", (times_ns / 1e9)[:, None]).as_matrix()

    times_ns = np.linspace(0, SECOND_NS // 10, 21).astype(np.int64)
    point = np.array([20.0, 5.0, 1.0])
    measured = np.einsum("nji,j->ni", rotated(times_ns), point)
    interpolation_ns = interpolation_timestamps(times_ns)
    poses = {"rotations": rotated(interpolation_ns), "positions_m": np.zeros((len(interpolation_ns), 3))}
    still = deskew(measured, times_ns, interpolation_ns=interpolation_ns, **poses)
    assert np.abs(still - point).max() < 3.2e-6 * np.linalg.norm(point)


times = st.lists(st.integers(0, 40_000_000), min_size=0, max_size=30)


@given(times, st.integers(0, 1_700_000_000_000_000_000), st.booleans())
def test_each_point_is_moved_by_the_blend_of_the_two_poses_around_its_time_in_whatever_order_they_come(
    offsets_ns, start_ns, ordered
):
    times_ns = start_ns + np.array(sorted(offsets_ns) if ordered else offsets_ns, dtype=np.int64)
    rng = np.random.default_rng(len(times_ns))
    points = rng.uniform(-50, 50, (len(times_ns), 3)).astype(np.float32)
    interpolation_ns = start_ns + np.array([0, 4_999_999, 10_000_000, 25_000_000, 40_000_001], dtype=np.int64)
    rotations = Rotation.from_rotvec(rng.uniform(-1, 1, (len(interpolation_ns), 3))).as_matrix()
    positions_m = rng.uniform(-1000, 1000, (len(interpolation_ns), 3))

    moved = deskew(points, times_ns, interpolation_ns=interpolation_ns, rotations=rotations, positions_m=positions_m)

    assert moved.shape == (len(times_ns), 3)
    assert moved.T.flags.c_contiguous
    for point, time_ns, found in zip(points, times_ns, moved, strict=True):
        after = next(
            (k for k in range(1, len(interpolation_ns)) if time_ns < interpolation_ns[k]), len(interpolation_ns) - 1
        )
        part = int(time_ns - interpolation_ns[after - 1]) / int(interpolation_ns[after] - interpolation_ns[after - 1])
        start, end = (rotations[k] @ point.astype(float) + positions_m[k] for k in (after - 1, after))
        np.testing.assert_allclose(found, start + part * (end - start), atol=1e-9)

"""Pose files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.egomotion import read_tum, write_tum
from bench.errors import DataError


def poses(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    return path


def test_a_pose_by_hand(tmp_path):
    # A quarter turn to the left at (1, 2, 3), at a time that float64 seconds cannot hold.
    half = 0.5**0.5
    path = poses(
        tmp_path, f"# t x y z qx qy qz qw\n1700000000.123456789 1 2 3 0 0 {half} {half}\n1700000001 1 2 3 0 0 0 1\n"
    )
    trajectory = read_tum(path)
    assert trajectory.timestamps_ns.tolist() == [1_700_000_000_123_456_789, 1_700_000_001_000_000_000]
    assert trajectory.positions_m[0].tolist() == [1.0, 2.0, 3.0]
    assert trajectory.rotations[0].apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 1.0, 0.0])


def test_scientific_notation_as_evo_writes_it(tmp_path):
    path = poses(tmp_path, "1.305031102175300000e+09 0 0 0 0 0 0 1\n1.305031102275300000e+09 0 0 0 0 0 0 1\n")
    assert read_tum(path).timestamps_ns.tolist() == [1_305_031_102_175_300_000, 1_305_031_102_275_300_000]


@given(
    start_ns=st.integers(-(10**18), 2 * 10**18),
    values=st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6),
    turn=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)),
)
def test_writing_and_reading_gives_the_same(tmp_path_factory, start_ns, values, turn):
    path = tmp_path_factory.mktemp("tum") / "poses.csv"
    times_ns = np.array([start_ns, start_ns + 1], dtype=np.int64)
    positions_m = np.array(values).reshape(2, 3)
    rotations = Rotation.from_rotvec([turn, (0.0, 0.0, 0.0)])
    write_tum(path, timestamps_ns=times_ns, rotations=rotations, positions_m=positions_m)
    trajectory = read_tum(path)
    assert trajectory.timestamps_ns.tolist() == times_ns.tolist()
    assert np.array_equal(trajectory.positions_m, positions_m)
    assert (trajectory.rotations.inv() * rotations).magnitude() == pytest.approx([0.0, 0.0], abs=1e-12)


LINE = "0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize("start_s", [0, 1_700_000_000])
@pytest.mark.parametrize("step_ms", [5, 100, 400])
@pytest.mark.parametrize(("unit", "factor"), [("milli", 10**3), ("micro", 10**6), ("nano", 10**9)])
def test_times_in_another_unit_are_refused_with_the_factor(tmp_path, start_s, step_ms, unit, factor):
    lines = [f"{start_s * factor + i * step_ms * factor // 1000} 0 0 0 0 0 0 1\n" for i in range(5)]
    with pytest.raises(
        DataError, match=rf"t: expected seconds.*these would be {unit}seconds: divide them by {factor}$"
    ):
        read_tum(poses(tmp_path, "".join(lines)))


@pytest.mark.parametrize("time", ["1e300", "-1e30", "1e12"])
def test_times_that_no_unit_explains_are_refused(tmp_path, time):
    with pytest.raises(DataError, match="t: expected seconds, the same clock"):
        read_tum(poses(tmp_path, f"{time} 0 0 0 0 0 0 1\n" + LINE))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LINE + "1 0 0 0 0 0 1\n", "line 2: expected 8 numbers, t x y z qx qy qz qw, got 7"),
        (LINE + "1 0 nan 0 0 0 0 1\n", "y, line 2: expected a finite number, got 'nan'"),
        (LINE + "1 0 1_000 0 0 0 0 1\n", "y, line 2: expected a finite number, got '1_000'"),
        (LINE + "1_0 0 0 0 0 0 0 1\n", "t, line 2: expected a finite number, got '1_0'"),
        (LINE + "one 0 0 0 0 0 0 1\n", "t, line 2: expected a finite number, got 'one'"),
        (LINE + "1 0 0 0 0 0 0 2\n", "qx qy qz qw: expected a quaternion of length 1"),
        ("1 0 0 0 0 0 0 1\n" + LINE, "timestamp_ns: expected times that increase"),
        (LINE + "0 1 0 0 0 0 0 1\n", "timestamp_ns: expected times that increase, got 0 after 0 in row 2"),
        ("# nothing\n", "expected at least two poses, got 0"),
    ],
)
def test_faults_name_file_and_line(tmp_path, text, message):
    with pytest.raises(DataError, match=r"poses\.csv") as caught:
        read_tum(poses(tmp_path, text))
    assert message in str(caught.value)

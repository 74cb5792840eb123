"""Bus signals, odometry from them by hand and by law, and pose files."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.egomotion.files import read_bus_signals, read_tum, write_tum
from bench.egomotion.trajectory import planar_trajectory
from bench.errors import DataError
from bench.times import SECOND_NS

START_NS = 1_700_000_000_123_456_789  # more digits than float64 holds


def drive(speed_mps, yaw_rate_radps, gear=None, step_ns=SECOND_NS // 10):
    times_ns = START_NS + step_ns * np.arange(len(speed_mps), dtype=np.int64)
    return planar_trajectory(
        source="drive.csv",
        timestamps_ns=times_ns,
        speed_mps=np.array(speed_mps, dtype=float),
        yaw_rate_radps=np.array(yaw_rate_radps, dtype=float),
        gear=gear,
    )


def test_the_path_by_hand():
    assert drive([10.0] * 11, [0.0] * 11).positions_m[-1] == pytest.approx([10.0, 0.0, 0.0])
    assert drive([0.0, 10.0], [0.0, 0.0]).positions_m[-1] == pytest.approx([0.5, 0.0, 0.0])  # the mean of the ends
    # Radius 10 m to the left: after a quarter of it the vehicle is 10 m ahead and 10 m to the left, heading left.
    quarter_s = 10 * np.pi / 2 / 5.0
    path = drive([5.0, 5.0], [0.5, 0.5], step_ns=round(quarter_s * SECOND_NS))
    assert path.positions_m[-1] == pytest.approx([10.0, 10.0, 0.0], abs=1e-6)
    assert path.rotations[-1].apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    back = drive([-2.0] * 11, [0.0] * 11)  # a signed speed without a gear
    assert back.positions_m[-1, 0] == pytest.approx(-2.0)
    assert back.velocity_vehicle_mps(START_NS + SECOND_NS // 2) == pytest.approx([-2.0, 0.0, 0.0])


@pytest.mark.parametrize("speed_mps", [2.0, -2.0])
def test_reverse_gear_drives_backwards_whatever_the_sign_of_the_speed_and_others_leave_it(speed_mps):
    for gears, expected_m in (
        (["R", "r", "Reverse", " rev ", "R2", -1, "-1", -2, "-1.0"], -2.0),
        (["D", "n", "P", 1, "3.0", "", "Drive", "M2"], speed_mps),
    ):
        ends_m = [drive([speed_mps] * 11, [0.0] * 11, gear=[gear] * 11).positions_m[-1, 0] for gear in gears]
        assert ends_m == pytest.approx([expected_m] * len(gears))


@pytest.mark.parametrize("word", ["backwards", "Rückwärts", "true", "1_0"])
def test_words_that_may_be_reverse_are_refused(word):
    with pytest.raises(DataError, match=r"drive.csv: gear, row 2: expected R or a negative number in reverse"):
        drive([2.0] * 2, [0.0] * 2, gear=["D", word])


@given(speed=st.floats(-30, 30), rate=st.floats(-1, 1), samples=st.integers(2, 30))
def test_constant_signals_do_not_depend_on_the_sampling(speed, rate, samples):
    whole = drive([speed] * 2, [rate] * 2, step_ns=(samples - 1) * 100_000_000)
    parts = drive([speed] * samples, [rate] * samples)
    assert parts.positions_m[-1] == pytest.approx(whole.positions_m[-1], abs=1e-6)


def csv(tmp_path, text, name="egomotion.csv"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_times_of_nineteen_digits_stay_exact_and_gears_and_comments_are_read(tmp_path):
    rows = f"{START_NS},1,0\n{START_NS + 100_000_001},3,0.5\n"
    path = read_bus_signals(csv(tmp_path, f"timestamp_ns,speed_mps,yaw_rate_radps\n{rows}"))
    assert path.timestamps_ns.tolist() == [START_NS, START_NS + 100_000_001]
    assert np.linalg.norm(path.positions_m[1]) == pytest.approx(0.2, rel=1e-4)
    assert path.rotations[1].as_rotvec() == pytest.approx([0.0, 0.0, 0.025])
    rows = "timestamp_ns,speed_mps,yaw_rate_radps,gear\n0,2,0,R\n1000000000,2,0,R\n"
    path = read_bus_signals(csv(tmp_path, f"# from the bus\n{rows}"))
    assert path.positions_m[-1] == pytest.approx([-2.0, 0.0, 0.0])


def test_columns_of_other_names_means_and_constants(tmp_path):
    path = csv(tmp_path, "t,front,rear\n0,10.0,20.0\n1000000000,12.0,12.0\n")
    columns = {"timestamp_ns": "t", "speed_mps": ["front", "rear"], "yaw_rate_radps": 0.0}
    assert read_bus_signals(path, columns=columns).positions_m[-1] == pytest.approx([13.5, 0.0, 0.0])


HEAD = "timestamp_ns,speed_mps,yaw_rate_radps\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "0,1,0\n10,nan,0\n", "speed_mps, row 2: expected a finite number, at most 1e+06, got 'nan'"),
        (HEAD + "0,1,0\n10,1,fast\n", "yaw_rate_radps, row 2: expected a finite number, at most 1e+06, got 'fast'"),
        (HEAD + "0,1,0\n10,1_000,0\n", "speed_mps, row 2: expected a finite number, at most 1e+06, got '1_000'"),
        (HEAD + "0,1,0\n10,1e7,0\n", "speed_mps, row 2: expected a finite number, at most 1e+06, got '1e7'"),
        (HEAD + f"0,1,0\n{2**63},1,0\n", "timestamp_ns, row 2: expected a whole number of nanoseconds, got '9223"),
        (HEAD + "0.1,1,0\n0.2,1,0\n", "got '0.1'; these would be seconds: multiply them by 1000000000"),
        (HEAD + "0,1,0\n1.5e1,1,0\n", "timestamp_ns, row 2: expected a whole number of nanoseconds, got '1.5e1'"),
        (HEAD + "10,1,0\n10,1,0\n", "timestamp_ns: expected times that increase, got 10 after 10 in row 2"),
        ("timestamp_ns,speed\n0,1\n", "speed_mps: expected a column of this name, got timestamp_ns, speed"),
        ("", "expected a table with a header"),
        (HEAD + "0,1,0\n", "expected at least two poses, got 1"),
        (None, "expected a readable file, got No such file"),
    ],
)
def test_faults_name_file_column_and_row(tmp_path, text, message):
    path = tmp_path / "egomotion.csv" if text is None else csv(tmp_path, text)
    with pytest.raises(DataError, match=r"egomotion\.csv: ") as caught:
        read_bus_signals(path)
    assert message in str(caught.value)


def poses(tmp_path, text):
    return csv(tmp_path, text, "poses.csv")


def test_a_pose_by_hand(tmp_path):
    # A quarter turn to the left at (1, 2, 3), at a time that float64 seconds cannot hold.
    half = 0.5**0.5
    first = f"# t x y z qx qy qz qw\n1700000000.123456789 1 2 3 0 0 {half} {half}\n"
    trajectory = read_tum(poses(tmp_path, first + 2 * "1700000001 1 2 3 0 0 0 1\n"))  # a line twice counts once
    assert trajectory.timestamps_ns.tolist() == [1_700_000_000_123_456_789, 1_700_000_001_000_000_000]
    assert trajectory.positions_m[0].tolist() == [1.0, 2.0, 3.0]
    assert trajectory.rotations[0].apply([1.0, 0.0, 0.0]) == pytest.approx([0.0, 1.0, 0.0])
    of_evo = poses(tmp_path, "1.305031102175300000e+09 0 0 0 0 0 0 1\n1.305031102275300000e+09 0 0 0 0 0 0 1\n")
    assert read_tum(of_evo).timestamps_ns.tolist() == [1_305_031_102_175_300_000, 1_305_031_102_275_300_000]


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


def test_times_in_nanoseconds_may_be_floats(tmp_path):
    path = tmp_path / "poses.csv"
    write_tum(path, timestamps_ns=np.array([1.5e9, 2e9]), rotations=Rotation.identity(2), positions_m=np.zeros((2, 3)))
    assert read_tum(path).timestamps_ns.tolist() == [1_500_000_000, 2_000_000_000]


LINE = "0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize("start_s", [0, 1_700_000_000])
@pytest.mark.parametrize("step_ms", [5, 100, 400])
@pytest.mark.parametrize(("unit", "factor"), [("milli", 10**3), ("micro", 10**6), ("nano", 10**9)])
def test_times_in_another_unit_are_refused_with_the_factor(tmp_path, start_s, step_ms, unit, factor):
    lines = [f"{start_s * factor + i * step_ms * factor // 1000} 0 0 0 0 0 0 1\n" for i in range(5)]
    told = rf"t: expected seconds.*these would be {unit}seconds: divide them by {factor}$"
    with pytest.raises(DataError, match=told):
        read_tum(poses(tmp_path, "".join(lines)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LINE + "1 0 0 0 0 0 1\n", "line 2: expected 8 numbers, t x y z qx qy qz qw, got 7"),
        (LINE + "1 0 nan 0 0 0 0 1\n", "y, line 2: expected a finite number, got 'nan'"),
        (LINE + "1 0 1_000 0 0 0 0 1\n", "y, line 2: expected a finite number, got '1_000'"),
        (LINE + "one 0 0 0 0 0 0 1\n", "t, line 2: expected a finite number, got 'one'"),
        (LINE + "1 0 0 0 0 0 0 2\n", "qx qy qz qw: expected a quaternion of length 1"),
        (LINE + "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "increase, got 1000000000 after 2000000000 in row 3"),
        (LINE + "0 1 0 0 0 0 0 1\n", "timestamp_ns: expected times that increase, got 0 after 0 in row 2"),
        ("# nothing\n", "expected at least two poses, got 0"),
        *(
            (f"{time} 0 0 0 0 0 0 1\n" + LINE, "t: expected seconds, the same clock")
            for time in ("1e300", "-1e30", "1e12")
        ),
    ],
)
def test_faults_name_file_and_line(tmp_path, text, message):
    with pytest.raises(DataError, match=r"poses\.csv") as caught:
        read_tum(poses(tmp_path, text))
    assert message in str(caught.value)

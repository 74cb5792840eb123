import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from bench.geometry import advance_twist, twist_between

angles = st.floats(-3.0, 3.0)


def one(rotation, position):
    return Rotation.concatenate([rotation]), np.array([position], dtype=float)


def interpolate_poses(rotations_from, positions_from, rotations_to, positions_to, fraction):
    turn, path = twist_between(rotations_from, positions_from, rotations_to, positions_to)
    part, advance = advance_twist(turn, path, fraction)
    return rotations_from * part, positions_from + rotations_from.apply(advance)


def test_car_on_a_circle_stays_on_the_circle():
    # Radius 10 m, a quarter turn to the left: after a third of it the car has turned 30 degrees.
    start, end = one(Rotation.identity(), [0, 0, 0]), one(Rotation.from_euler("z", 90, degrees=True), [10, 10, 0])
    rotation, position = interpolate_poses(*start, *end, np.array([1 / 3]))
    np.testing.assert_allclose(position[0], [10 * np.sin(np.pi / 6), 10 * (1 - np.cos(np.pi / 6)), 0], atol=1e-12)
    np.testing.assert_allclose(rotation.as_euler("zyx", degrees=True)[0], [30, 0, 0], atol=1e-9)


def test_without_rotation_it_is_the_straight_line():
    start, end = one(Rotation.identity(), [1, 2, 3]), one(Rotation.identity(), [3, 2, 1])
    _, position = interpolate_poses(*start, *end, np.array([0.25]))
    np.testing.assert_allclose(position[0], [1.5, 2.0, 2.5], atol=1e-15)


@given(angles, angles, st.floats(-1.4, 1.4), st.floats(0, 1))
def test_rotation_is_the_slerp_and_ends_are_met(yaw, roll, pitch, fraction):
    a, b = Rotation.from_euler("zyx", [0.3, 0.1, -0.2]), Rotation.from_euler("zyx", [yaw, pitch, roll])
    start, end = one(a, [0, 0, 0]), one(b, [1, -2, 0.5])
    rotation, _ = interpolate_poses(*start, *end, np.array([fraction]))
    expected = Slerp([0, 1], Rotation.concatenate([a, b]))(fraction)
    assert (rotation.inv() * expected).magnitude()[0] < 1e-7
    for at, (known, position) in ((0.0, start), (1.0, end)):
        got_rotation, got_position = interpolate_poses(*start, *end, np.array([at]))
        assert (got_rotation.inv() * known).magnitude()[0] < 1e-7
        np.testing.assert_allclose(got_position, position, atol=1e-6)

"""Laws of rigid motion, of its interpolation, of the road plane and of the unit sphere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from bench.errors import ShapeError
from bench.geometry import RigidTransform, RoadPlane, advance_twist, angle_between, cross, dot, normalise, twist_between
from tests.support.worlds import FORWARD

numbers = st.floats(-100, 100, allow_nan=False)
quaternions = arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
transforms = st.builds(RigidTransform.from_quaternion, quaternions, arrays(np.float64, 3, elements=numbers))


def close(a: RigidTransform, b: RigidTransform) -> None:
    np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-9)


@given(transforms, transforms, transforms, arrays(np.float64, (5, 3), elements=numbers))
def test_group_axioms(a, b, c, points):
    close((a @ b) @ c, a @ (b @ c))
    close(a @ a.inverse(), RigidTransform.identity())
    close(a.inverse() @ a, RigidTransform.identity())
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-9)
    close(RigidTransform.from_quaternion(a.quaternion_wxyz, a.translation_m), a)
    close(RigidTransform.from_matrix(a.matrix), a)


@given(transforms, arrays(np.float64, (2, 4, 3), elements=numbers))
def test_points_of_any_shape_and_layout_move_alike(a, points):
    row_by_row = [[a.rotation @ point + a.translation_m for point in row] for row in points]
    np.testing.assert_allclose(a.apply(points), row_by_row, atol=1e-9)
    np.testing.assert_allclose(a.apply(points[0]), row_by_row[0], atol=1e-9)
    np.testing.assert_allclose(a.apply(np.asfortranarray(points[0])), row_by_row[0], atol=1e-9)
    np.testing.assert_allclose(a.apply(points[0, 0]), row_by_row[0][0], atol=1e-9)
    assert a.apply(points[0]).T.flags.c_contiguous
    np.testing.assert_allclose(a.rotate(points), a.apply(points) - a.translation_m, atol=1e-9)


def test_rows_of_nan_stay_and_spoil_no_other():
    points = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [4.0, 5.0, 6.0]])
    with np.errstate(invalid="ignore"):
        moved = RigidTransform.from_yaw(0.3, (1.0, 2.0, 3.0)).apply(points)
    assert np.isfinite(moved).all(axis=1).tolist() == [True, False, False, True]
    assert RigidTransform.identity().apply(np.empty((0, 3))).shape == (0, 3)


def test_quarter_turn_to_the_left_by_hand():
    world_from_vehicle = RigidTransform.from_yaw(np.pi / 2, (10.0, 0.0, 0.0))
    np.testing.assert_allclose(world_from_vehicle.apply(np.array([[2.0, 1.0, 0.5]])), [[9.0, 2.0, 0.5]], atol=1e-12)


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3)),
        (2 * np.eye(3), np.zeros(3)),
        (np.eye(3), np.array([0.0, np.nan, 0.0])),
        (np.eye(2), np.zeros(3)),
    ],
)
def test_what_is_no_rigid_transform_is_refused(rotation, translation):
    with pytest.raises(ShapeError, match="expected"):
        RigidTransform(rotation, translation)


def test_printed_calibration_is_mended_but_a_scaled_one_refused():
    assert RigidTransform.from_matrix(np.round(RigidTransform.from_yaw(0.3).matrix, 4)).rotation[2, 2] == 1.0
    with pytest.raises(ShapeError, match="without scale"):
        RigidTransform.from_matrix(np.diag([1.1, 1.1, 1.1, 1.0]))


def test_many_at_once_are_those_made_one_by_one_and_as_strict():
    rotations = Rotation.from_euler("xyz", [[0.1, 0.2, 0.3], [1.0, -1.0, 2.0]]).as_matrix()
    places = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    for made, rotation, place in zip(RigidTransform.each(rotations, places), rotations, places, strict=True):
        np.testing.assert_array_equal(made.matrix, RigidTransform(rotation, place).matrix)
    with pytest.raises(ShapeError, match="proper orthonormal rotation"):
        RigidTransform.each(rotations * [[[1.0]], [[1.1]]], places)
    with pytest.raises(ShapeError, match="finite numbers"):
        RigidTransform.each(rotations, places * np.nan)
    assert RigidTransform.each(np.empty((0, 3, 3)), np.empty((0, 3))) == []


angles = st.floats(-3.0, 3.0)


def one(rotation, position):
    return Rotation.concatenate([rotation]), np.array([position], dtype=float)


def interpolate_poses(rotations_from, positions_from, rotations_to, positions_to, fraction):
    turn, path = twist_between(rotations_from, positions_from, rotations_to, positions_to)
    part, advance = advance_twist(turn, path, fraction)
    return rotations_from * part, positions_from + rotations_from.apply(advance)


def test_a_car_stays_on_its_circle_and_without_rotation_on_the_straight_line():
    # Radius 10 m, a quarter turn to the left: after a third of it the car has turned 30 degrees.
    start, end = one(Rotation.identity(), [0, 0, 0]), one(Rotation.from_euler("z", 90, degrees=True), [10, 10, 0])
    rotation, position = interpolate_poses(*start, *end, np.array([1 / 3]))
    np.testing.assert_allclose(position[0], [10 * np.sin(np.pi / 6), 10 * (1 - np.cos(np.pi / 6)), 0], atol=1e-12)
    np.testing.assert_allclose(rotation.as_euler("zyx", degrees=True)[0], [30, 0, 0], atol=1e-9)
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


def test_road_below_a_level_camera():
    """Its z is the vehicle's x, its x the vehicle's -y, its y the vehicle's -z."""
    road = RoadPlane.below(RigidTransform(FORWARD.T, np.array([3.7, 0.0, 0.66])))
    np.testing.assert_allclose(road.down, [0, 1, 0], atol=1e-15)
    assert road.height_m == pytest.approx(0.66)
    assert RoadPlane.below(RigidTransform(FORWARD.T, np.array([0, 0, 1.4])), ground_height_m=-0.1).height_m == 1.5


def test_an_inverse_mounting_is_named_in_the_error():
    mounting = RigidTransform(FORWARD.T, np.array([3.7, 0.0, 0.66]))
    with pytest.raises(ShapeError, match=r"-3.70 m; the inverse .* 0.66 m above it: give vehicle_from_camera"):
        RoadPlane.below(mounting.inverse())


@pytest.mark.parametrize(
    ("ray", "distance_m"),
    [
        ([0.0, np.sin(np.pi / 6), np.cos(np.pi / 6)], 1.32),  # 30 degrees down
        ([0.0, 0.0, 1.0], np.inf),
        ([0.0, -1.0, 0.0], np.inf),
        ([0.0, 1e-320, 1.0], np.inf),  # a hair below the horizon
    ],
)
def test_distance_along_a_ray(ray, distance_m):
    assert RoadPlane(np.array([0.0, 1.0, 0.0]), 0.66).distance_m(np.array(ray)) == pytest.approx(distance_m)


@pytest.mark.parametrize(("down", "height_m"), [([0, 0, 0], 1.0), ([0, 1], 1.0), ([0, 1, 0], 0.0), ([0, 1, 0], -1.0)])
def test_impossible_roads_are_refused(down, height_m):
    with pytest.raises(ShapeError, match="RoadPlane"):
        RoadPlane(np.array(down, dtype=float), height_m)


vectors = arrays(np.float64, (4, 3), elements=st.floats(-10, 10))


@given(vectors, vectors)
def test_cross_and_dot_are_numpys(a, b):
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-12)
    np.testing.assert_allclose(dot(a, b), (a * b).sum(axis=-1), atol=1e-12)


def test_small_angles_survive_and_a_zero_vector_has_no_direction():
    a, b = np.array([0.0, 0.0, 1.0]), np.array([1e-9, 0.0, 1.0])
    assert abs(angle_between(a, b) - 1e-9) < 1e-20
    assert angle_between(a, -a) == np.pi
    assert np.isnan(normalise(np.zeros(3))).all()
    np.testing.assert_allclose(normalise(np.array([0.0, 3.0, 4.0])), [0, 0.6, 0.8])

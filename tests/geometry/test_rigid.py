import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from bench.errors import ShapeError
from bench.geometry import RigidTransform

numbers = st.floats(-100, 100, allow_nan=False)
quaternions = arrays(np.float64, 4, elements=st.floats(-1, 1)).filter(lambda q: np.linalg.norm(q) > 1e-3)
transforms = st.builds(RigidTransform.from_quaternion, quaternions, arrays(np.float64, 3, elements=numbers))


def close(a: RigidTransform, b: RigidTransform) -> None:
    np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-9)


@given(transforms, transforms, transforms)
def test_composition_is_associative(a, b, c):
    close((a @ b) @ c, a @ (b @ c))


@given(transforms)
def test_inverse_undoes(a):
    close(a @ a.inverse(), RigidTransform.identity())
    close(a.inverse() @ a, RigidTransform.identity())


@given(transforms, transforms, arrays(np.float64, (5, 3), elements=numbers))
def test_apply_of_a_product_is_apply_twice(a, b, points):
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-9)


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


@given(transforms)
def test_quaternion_and_matrix_round_trip(a):
    close(RigidTransform.from_quaternion(a.quaternion_wxyz, a.translation_m), a)
    close(RigidTransform.from_matrix(a.matrix), a)


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

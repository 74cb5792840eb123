"""What holds for every camera model."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.cameras.model import ray_grid
from bench.cameras.stored import CAMERA_MODELS, camera_from_parameters, camera_parameters
from bench.errors import ShapeError, UnknownNameError
from tests.support.lenses import LENSES, real_kannala_brandt, real_unified, real_woodscape
from tests.support.real import needs_real

every_lens = pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)


def corner_to_corner(camera, count=101):
    u = np.linspace(-0.5, camera.width - 0.5, count)
    v = np.linspace(-0.5, camera.height - 0.5, count)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def assert_round_trip(camera):
    pixels = corner_to_corner(camera)
    rays, valid = camera.unproject(pixels)
    assert valid.mean() > 0.5
    np.testing.assert_allclose(np.linalg.norm(rays[valid], axis=1), 1.0, atol=1e-12)
    back, again = camera.project(rays[valid])
    assert again.all()
    assert np.abs(back - pixels[valid]).max() < 1e-6


def test_every_registered_model_is_tested():
    assert set(LENSES) == set(CAMERA_MODELS)


@every_lens
def test_inverse_is_accurate_to_a_millionth_of_a_pixel(camera):
    assert_round_trip(camera)


@needs_real
def test_inverse_of_the_real_lenses():
    lenses = [*real_woodscape(), *real_unified(), *(camera for camera, _, _ in real_kannala_brandt())]
    assert len(lenses) == 4 + 2 + 4
    for camera in lenses:
        assert_round_trip(camera)


@every_lens
@given(st.floats(0, 1), st.floats(0, 2 * np.pi), st.floats(1e-3, 1e3))
def test_rays_of_any_length_round_trip_up_to_the_limit(camera, share, around, length):
    angle = share * min(camera.limit_angle_rad, np.pi) * 0.98
    ray = np.array([[np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]])
    pixels, valid = camera.project(length * ray)
    assert valid.all()
    rays, back = camera.unproject(pixels)
    assert back.all()
    np.testing.assert_allclose(rays, ray, atol=1e-6)


@every_lens
def test_beyond_the_limit_and_at_zero_nothing_is_valid_and_the_axis_is_the_principal_point(camera):
    limit = camera.limit_angle_rad
    beyond = [[np.sin(a), 0.0, np.cos(a)] for a in (limit + 0.01, (limit + np.pi) / 2) if limit < a < np.pi]
    rays = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], *beyond])
    pixels, valid = camera.project(rays)
    assert not valid.any()
    assert np.isnan(pixels).all()
    axis, valid = camera.project(np.array([[0.0, 0.0, 2.0]]))
    assert valid.all()
    np.testing.assert_allclose(axis[0], camera.principal_point, atol=1e-12)


@every_lens
def test_scaled_camera_sees_the_same_rays(camera):
    half = camera.scaled(camera.width // 2, camera.height // 2)
    pixels = corner_to_corner(camera, 21)
    rays, valid = camera.unproject(pixels)
    smaller, valid_smaller = half.project(rays[valid])
    assert valid_smaller.all()
    # The outer borders coincide: -0.5 stays -0.5, the last border becomes the last border.
    np.testing.assert_allclose(smaller, (pixels[valid] + 0.5) / 2 - 0.5, atol=1e-7)
    assert half.limit_angle_rad == pytest.approx(camera.limit_angle_rad, abs=1e-9)


@every_lens
def test_ray_grid_is_the_unprojection_of_cell_centres(camera):
    grid = ray_grid(camera, 5)
    assert grid.pixels[0, 0].tolist() == [2.0, 2.0]
    assert grid.pixels.shape[:2] == (-(-camera.height // 5), -(-camera.width // 5))
    rays, valid = camera.unproject(grid.pixels[3])
    np.testing.assert_array_equal(grid.rays_camera[3], rays)
    np.testing.assert_array_equal(grid.valid[3], valid)
    stored = camera_from_parameters(**camera_parameters(camera))
    assert stored == camera
    assert ray_grid(stored, 5) is grid


@every_lens
def test_an_image_ends_half_a_pixel_beyond_the_centres_of_its_outer_pixels(camera):
    right, bottom = camera.width - 0.5, camera.height - 0.5
    inside = np.array([[-0.5, -0.5], [np.nextafter(right, 0), np.nextafter(bottom, 0)]])
    outside = np.array([[-0.51, 0], [0, -0.51], [right, 0], [0, bottom], [np.nan, 0]])
    assert camera.contains(inside).all()
    assert not camera.contains(outside).any()


@every_lens
def test_wrong_shapes_are_refused(camera):
    with pytest.raises(ShapeError, match=r"points_camera: expected \(N, 3\)"):
        camera.project(np.zeros((4, 2)))
    with pytest.raises(ShapeError, match=r"pixels: expected \(N, 2\)"):
        camera.unproject(np.zeros(3))


def test_unknown_model_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'kannala_brandt'"):
        camera_from_parameters("kanala_brandt", width=1, height=1)
    with pytest.raises(ShapeError, match="expected the parameters width, height, principal_point, focal"):
        camera_from_parameters("pinhole", width=1, height=1, fx=3)

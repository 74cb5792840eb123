"""Rotation and direction of travel from rays, on exact worlds."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import camera_motion
from bench.egomotion.visual import VisualOdometry
from bench.errors import ShapeError, UsageError
from bench.flow.tracks import LucasKanadeTracker
from bench.geometry import angle_between, normalise
from bench.recordings import load_card, open_dataset, read_image
from tests.support.real import needs_real

ODOMETRY = VisualOdometry()


def around(number=600, seed=0):
    """Points on all sides of the camera, behind it too, 2 to 30 m away."""
    rng = np.random.default_rng(seed)
    return normalise(rng.normal(size=(number, 3))) * rng.uniform(2, 30, (number, 1))


def road(number=600):
    """Points on a plane 0.7 m below a level camera: a degenerate scene for eight points."""
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-6, 6, number), np.full(number, 0.7), rng.uniform(-6, 12, number)])


def views(points, turn_rad, t_m, noise_rad=0.0):
    """Rays of static points in the previous and the current camera frame; X' = R X + t."""
    rng = np.random.default_rng(7)
    rotation = Rotation.from_rotvec(turn_rad).as_matrix()
    previous, current = normalise(points), normalise(points @ rotation.T + np.asarray(t_m))
    return (
        normalise(previous + noise_rad * rng.normal(size=points.shape)),
        normalise(current + noise_rad * rng.normal(size=points.shape)),
        rotation,
        np.asarray(t_m) / max(np.linalg.norm(t_m), 1e-12),
    )


def off_deg(found, rotation, direction):
    turn_rad = Rotation.from_matrix(found.rotation @ rotation.T).magnitude()
    return np.degrees([turn_rad, angle_between(found.direction, direction)])


small, step = st.floats(-0.03, 0.03), st.floats(-1, 1)


def assert_exact(points, turn_rad, t_m):
    previous, current, rotation, direction = views(points, turn_rad, t_m)
    found = ODOMETRY(previous, current)
    turn_deg, direction_deg = off_deg(found, rotation, direction)
    assert turn_deg < 1e-4
    assert direction_deg < 1e-3  # also its sign: what is seen lies in front of its own ray
    assert found.inliers.all()


@hypothesis_settings(max_examples=25, deadline=None)
@given(small, small, small, step, step, step)
def test_exact_rays_give_the_exact_motion_in_every_direction(x, y, z, a, b, c):
    assume(np.linalg.norm([a, b, c]) > 0.2)
    assert_exact(around(), (x, y, z), 0.3 * np.array([a, b, c]))


@hypothesis_settings(max_examples=25, deadline=None)
@given(small, small, small, st.floats(-np.pi, np.pi))
def test_a_bare_road_is_enough_for_a_vehicle_that_drives_on_it(x, y, z, course_rad):
    assert_exact(road(), (x, y, z), 0.3 * np.array([np.sin(course_rad), 0.0, np.cos(course_rad)]))


@pytest.mark.parametrize("share", [0.2, 0.4])
def test_what_moves_is_left_out(share):
    points = around()
    previous, current, rotation, direction = views(points, (0.0, 0.01, 0.0), (0.05, 0.0, -0.4), noise_rad=3e-4)
    moving = np.arange(len(points)) < share * len(points)
    elsewhere = views(points + np.array([1.0, 0.3, 0.2]), (0.0, 0.01, 0.0), (0.05, 0.0, -0.4))[1]
    current[moving] = elsewhere[moving]
    found = ODOMETRY(previous, current)
    turn_deg, direction_deg = off_deg(found, rotation, direction)
    assert turn_deg < 0.03
    assert direction_deg < 0.5
    assert found.inliers[~moving].mean() > 0.98
    assert found.inliers[moving].mean() < 0.2


@pytest.mark.parametrize("turn_rad", [(0, 0, 0), (0.01, 0.08, -0.02)])
def test_a_camera_that_stands_or_only_turns_has_no_direction_even_if_a_fifth_moves(turn_rad):
    previous, current, rotation, _ = views(around(), turn_rad, (0, 0, 0), noise_rad=3e-4)
    current[:120] = normalise(current[:120] + np.array([0.05, 0.0, 0.02]))
    found = ODOMETRY(previous, current)
    assert not found.moves
    assert np.isnan(found.direction).all()
    assert off_deg(found, rotation, found.direction)[0] < 0.02
    assert found.inliers[120:].mean() > 0.99
    assert found.inliers[:120].mean() < 0.05  # all but those whose ray lies along their own way


def test_the_length_of_the_way_has_no_part_in_it():
    one, ten = (
        ODOMETRY(*views(scale * around(), (0, 0.01, 0), scale * np.array([0, 0.02, -0.3]))[:2]) for scale in (1, 10)
    )
    np.testing.assert_allclose(one.direction, ten.direction, atol=1e-6)
    np.testing.assert_allclose(one.rotation, ten.rotation, atol=1e-6)


def test_too_little_says_nothing():
    previous, current, _, _ = views(around(), (0, 0, 0), (0, 0, -0.3))
    assert ODOMETRY(previous[:49], current[:49]) is None
    gone = previous.copy()
    gone[40:] = np.nan
    assert ODOMETRY(gone, current) is None
    chaos = np.random.default_rng(3)
    nothing = normalise(chaos.normal(size=(60, 3))), normalise(chaos.normal(size=(60, 3)))
    assert ODOMETRY(*nothing) is None  # hardly any of 60 agrees with anything


def test_rays_without_value_are_no_inliers_and_change_nothing():
    previous, current, _, _ = views(around(), (0, 0.01, 0), (0, 0, -0.3), noise_rad=2e-4)
    whole = ODOMETRY(previous, current)
    lost = np.full((5, 3), np.nan)
    more = ODOMETRY(np.vstack([lost, previous]), np.vstack([current[:5], current]))
    np.testing.assert_array_equal(more.inliers, np.concatenate([np.zeros(5, bool), whole.inliers]))
    np.testing.assert_array_equal(more.direction, whole.direction)


def test_bad_calls_are_refused():
    with pytest.raises(ShapeError, match=r"two arrays \(N, 3\)"):
        ODOMETRY(np.zeros((4, 3)), np.zeros((5, 3)))
    for bad in ({"tolerance_rad": 0}, {"draws": 0}, {"min_tracks": 7}):
        with pytest.raises(UsageError, match="visual odometry: expected"):
            VisualOdometry(**bad)


@needs_real
def test_direction_and_turn_of_a_car_that_drives_straight_on():
    """A real fisheye camera on a motorway at night, passed vehicles in view."""
    recording = open_dataset(load_card("datasets/aimotive-sample.yaml"))[0].open()
    camera, images = recording.cameras["M_FISHEYE_R"], recording.images["M_FISHEYE_R"]
    errors_deg = []
    for previous, current in zip(images[0:-1:6], images[1::6], strict=False):
        pair = [read_image(image, camera, colour=False) for image in (current, previous)]
        tracks = LucasKanadeTracker()(pair, valid=None if camera.ego_body is None else ~camera.ego_body)
        rays = [camera.model.unproject(pixels[tracks.followed[1]])[0] for pixels in tracks.pixels]
        found = VisualOdometry()(rays[1], rays[0])
        poses = [recording.trajectory.world_from_vehicle(image.timestamp_ns) for image in (previous, current)]
        driven = camera_motion(
            world_from_vehicle_previous=poses[0],
            world_from_vehicle_current=poses[1],
            vehicle_from_camera=camera.vehicle_from_camera,
        ).translation_m
        errors_deg.append(off_deg(found, np.eye(3), driven))
    assert len(errors_deg) >= 8
    turn_deg, direction_deg = np.median(errors_deg, axis=0)
    assert turn_deg < 0.2
    assert direction_deg < 2  # single images, filled by a passing van, may take its motion for the camera's

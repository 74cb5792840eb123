"""Baselines that look at flow or grey values alone, on pictures whose answer is known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.cameras.model import ray_grid
from bench.geometry import RigidTransform
from bench.methods import build_method
from tests.support.board_scene import CAMERA, HEIGHT, STEP, WIDTH, crossing, frame, render

INNER = np.s_[8:-8, 8:-8]  # cells that were in the image before, too


def rotated_pair(rotation_rad):
    """Images of a camera that only rotated, and its motion."""
    motion = RigidTransform(Rotation.from_rotvec(rotation_rad).as_matrix(), np.zeros(3))
    previous, _ = render(np.zeros(3))
    rays = np.nan_to_num(ray_grid(CAMERA).rays_camera.reshape(-1, 3), nan=1.0)
    pixels, _ = CAMERA.project(motion.inverse().rotate(rays))
    u, v = np.nan_to_num(pixels, nan=-1).reshape(HEIGHT, WIDTH, 2).astype(np.float32).transpose(2, 0, 1)
    current = cv2.remap(previous, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return replace(frame(previous, current, STEP), current_from_previous=(motion,))


def test_the_turn_of_the_camera_moves_all_flow_but_not_what_is_compensated():
    given = rotated_pair([0.0, 0.02, 0.0])
    plain, compensated = (build_method(name).segment(given) for name in ("flow-magnitude", "rotation-compensated-flow"))
    assert plain.mask[INNER].mean() > 0.95
    assert compensated.mask[INNER].mean() < 0.1
    # What turns is an angle, the same all over the image but for the poles of the turn.
    level = np.abs(ray_grid(CAMERA, 5).rays_camera[..., 1]) < 0.1
    assert np.median(plain.likelihood[level]) == pytest.approx(0.02, rel=0.02)


def test_flow_baselines_agree_for_a_camera_that_does_not_turn():
    given, board = crossing()
    plain, compensated = (build_method(name).segment(given) for name in ("flow-magnitude", "rotation-compensated-flow"))
    np.testing.assert_array_equal(plain.mask, compensated.mask)
    assert plain.mask_at(WIDTH, HEIGHT)[board].mean() > 0.95
    np.testing.assert_array_equal(plain.mask, plain.likelihood > 6e-4 * 2.4)


def grey_frame(*images, valid=None):
    given = frame(images[0], images[-1], STEP, valid)
    steps = given.current_from_previous * (len(images) - 1)
    return replace(given, images=images, timestamps_ns=tuple(range(len(images))), current_from_previous=steps)


def square(left, background=100, grey=200):
    image = np.full((HEIGHT, WIDTH), background, np.uint8)
    image[100:140, left : left + 40] = grey
    return image


def test_frame_difference_by_hand():
    previous, current = np.full((HEIGHT, WIDTH), 100, np.uint8), np.full((HEIGHT, WIDTH), 100, np.uint8)
    current[0, :4] = [115, 116, 85, 84]  # 4 sqrt(15) is 15.49
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[1] = False
    current[1] = 255
    found = build_method("frame-difference").segment(grey_frame(previous, current, valid=valid))
    assert found.mask[0, :5].tolist() == [False, True, False, True, False]
    assert found.mask.sum() == 2
    assert found.likelihood_is_score
    assert found.likelihood[0, 1] == pytest.approx(16 / 255)


def test_background_subtraction_marks_what_is_new():
    images = [square(100 + 10 * i) for i in range(8)]
    method = build_method("background-subtraction")
    found = method.segment(grey_frame(*images))
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[100:140, 170:210] = True
    new = np.zeros_like(expected)
    new[100:140, 200:210] = True  # no earlier square has reached it
    assert found.mask[new].all()
    assert not found.mask[~expected].any()


def test_background_subtraction_looks_back_as_far_as_it_says_and_makes_do_with_one_image():
    images = [square(140), square(100), square(100), square(140)]  # the oldest knows what the newest shows
    far, near = (build_method("background-subtraction", {"images": n}) for n in (3, 2))
    assert (far.longest_history, near.longest_history) == (3, 2)
    region = np.s_[100:140, 140:180]
    assert not far.segment(grey_frame(*images)).mask[region].any()
    assert near.segment(grey_frame(*images)).mask[region].all()
    one = far.segment(grey_frame(square(100), square(150))).mask
    assert one[100:140, 150:190].mean() == 1.0

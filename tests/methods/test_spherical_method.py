"""The paper's method on images: what moves is found where it is now, and what is static is not."""

import cv2
import numpy as np
import pytest

from bench.cameras import ray_grid
from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.methods import build_method
from bench.methods.spherical.method import SphericalMethod
from tests.support.board_scene import CAMERA, HEIGHT, LOOK, MOUNT_M, STEP, WIDTH, crossing, frame, render, scene, share


def test_a_crossing_board_is_found_where_it_is_now_and_the_world_is_static():
    previous, current, board = crossing()
    found = build_method("spherical").segment(frame(previous, current, STEP))
    mask = found.mask_at(WIDTH, HEIGHT)
    inner = cv2.erode(board.astype(np.uint8), np.ones((9, 9))).astype(bool)
    far = ~cv2.dilate(board.astype(np.uint8), np.ones((41, 41))).astype(bool)
    assert share(mask, inner) > 0.9
    assert share(mask, far & (np.indices(mask.shape)[0] < 460)) < 0.08


class ExactFlow(SphericalMethod):
    """The method with the flow that the scene really has."""

    def mean_flow(self, frame):  # noqa: ARG002 - it knows the scene
        before, now = np.array([3.0, -0.6, 0.0]), np.array([3.0, -0.3, 0.0])
        hit, _, board = scene(STEP, now)
        was = np.where(board[..., None], hit - (now - before), hit)[2::5, 2::5]
        camera_from_world = RigidTransform(LOOK, -LOOK @ MOUNT_M)
        pixels, _ = CAMERA.project(camera_from_world.apply(was.reshape(-1, 3)))
        cells = ray_grid(CAMERA, 5)
        return (pixels.reshape(cells.pixels.shape) - cells.pixels).astype(np.float32)


def test_with_exact_flow_the_mask_is_the_board_in_the_current_image():
    previous, current, board = crossing()
    method = ExactFlow(weights={"anti_parallel": 0.0})  # which fires on the wall below camera height, by design
    found = method.segment(frame(previous, current, STEP))
    expected = board[2::5, 2::5] & ~found.undefined
    np.testing.assert_array_equal(found.mask, expected)
    assert expected.sum() > 100


def test_a_stationary_camera_takes_the_static_branch():
    previous, _ = render(np.zeros(3), np.array([3.0, -0.6, 0.0]))
    current, board = render(np.zeros(3), np.array([3.0, -0.3, 0.0]))
    found = build_method("spherical").segment(frame(previous, current, np.zeros(3)))
    assert found.causes == ("static_camera",)
    mask = found.mask_at(WIDTH, HEIGHT)
    far = ~cv2.dilate(board.astype(np.uint8), np.ones((61, 61))).astype(bool)
    assert share(mask, cv2.erode(board.astype(np.uint8), np.ones((9, 9))).astype(bool)) > 0.9
    assert share(mask, far) < 0.02


@pytest.mark.parametrize("flow", ["farneback", "dis"])
def test_static_world_stays_static(flow):
    previous, _ = render(np.zeros(3))
    current, _ = render(STEP)
    found = build_method("spherical", {"flow": flow}).segment(frame(previous, current, STEP))
    assert found.mask.mean() < 0.1
    assert found.cause.max() < len(found.causes)


def test_where_the_ego_vehicle_sees_itself_nothing_is_detected():
    previous, current, _ = crossing()
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[:, 200:] = False
    found = build_method("spherical").segment(frame(previous, current, STEP, valid))
    assert not found.mask[:, 40:].any()
    assert found.undefined[:, 40:].all()


def test_parameters_from_a_file_and_bad_ones():
    method = build_method("spherical", {"weights": {"anti_parallel": 0.0}, "variants": {"geodesic": True}})
    assert method.settings()["weights"]["anti_parallel"] == 0.0
    with pytest.raises(UsageError, match=r"takes cell_size_px, .*, flow, flow_parameters"):
        build_method("spherical", {"treshold": 1})
    with pytest.raises(UsageError, match="thresholds > 0"):
        build_method("spherical", {"threshold": 0})

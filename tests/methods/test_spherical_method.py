"""The paper's method on images: what moves is found where it is now, and what is static is not."""

import cv2
import numpy as np
import pytest

from bench.cameras import RadialPolynomialCamera, ray_grid
from bench.errors import UsageError
from bench.geometry import RigidTransform, RoadPlane
from bench.methods import MethodInput, build_method
from bench.methods.spherical.method import SphericalMethod
from tests.methods.worlds import pitched_down

WIDTH, HEIGHT = 640, 480
CAMERA = RadialPolynomialCamera(
    width=WIDTH, height=HEIGHT, coefficients=(170.0, -16.0, 24.0, -3.6), principal_point=(319.5, 239.5)
)
MOUNT_M = np.array([0.0, 0.0, 0.66])
LOOK = pitched_down(np.deg2rad(20))


def texture(seed, size=1024):
    """Periodic noise with detail at every scale, so that near and far surfaces both carry flow."""
    u, v = np.meshgrid(np.fft.rfftfreq(size), np.fft.fftfreq(size))
    frequency = np.maximum(np.hypot(u, v), 1 / size)
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(size, size)))
    pattern = np.fft.irfft2(noise / frequency * (frequency < 0.25), s=(size, size))
    return np.clip(128 + 40 * pattern / pattern.std(), 5, 250).astype(np.float32)


ROAD, WALL, BOX = texture(1), texture(2), texture(3)


def sample(pattern, x, y, pixels_per_m):
    size = pattern.shape[0]
    return cv2.remap(
        pattern,
        ((x * pixels_per_m) % size).astype(np.float32),
        ((y * pixels_per_m) % size).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )


def scene(position_m, box_m=None):
    """What every pixel of a camera at `position_m` hits: world points, and whether it is road or board.

    A road, a wall all around at 12 m, and an upright board of 1.2 m at `box_m` that faces the camera.
    """
    rays = np.nan_to_num(ray_grid(CAMERA).rays_camera @ LOOK, nan=0.0)  # world axes: LOOK is camera_from_world
    origin = MOUNT_M + position_m
    around = np.hypot(rays[..., 0], rays[..., 1]) + 1e-9
    depth = (12.0 - origin[0] * rays[..., 0] / around) / around
    to_road = np.where(rays[..., 2] < -1e-3, -origin[2] / np.minimum(rays[..., 2], -1e-3), np.inf)
    road = to_road < depth
    depth = np.where(road, to_road, depth)
    board = np.zeros(road.shape, dtype=bool)
    if box_m is not None:
        to_board = (box_m[0] - origin[0]) / np.where(np.abs(rays[..., 0]) < 1e-6, 1e-6, rays[..., 0])
        offset = origin + rays * to_board[..., None] - box_m
        board = (to_board > 0) & (to_board < depth) & (np.abs(offset[..., 1]) < 0.6)
        board &= (offset[..., 2] > 0) & (offset[..., 2] < 1.2)
        depth = np.where(board, to_board, depth)
    return origin + rays * depth[..., None], road & ~board, board


def render(position_m, box_m=None):
    """The scene with texture, and the board's mask."""
    hit, road, board = scene(position_m, box_m)
    image = sample(WALL, np.arctan2(hit[..., 1], hit[..., 0]) * 12.0, hit[..., 2], 40.0)
    image[road] = sample(ROAD, hit[..., 0], hit[..., 1], 150.0)[road]
    if box_m is not None:
        image[board] = sample(BOX, hit[..., 1] - box_m[1], hit[..., 2], 80.0)[board]
    return image.astype(np.uint8), board


def frame(previous, current, step_m, valid=None):
    before, now = (RigidTransform(LOOK, -LOOK @ (MOUNT_M + p)) for p in ((0.0, 0.0, 0.0), step_m))
    return MethodInput(
        images=(previous, current),
        timestamps_ns=(0, 66_666_667),
        camera=CAMERA,
        road=RoadPlane(LOOK @ np.array([0.0, 0.0, -1.0]), 0.66),
        current_from_previous=(now @ before.inverse(),),
        valid=np.ones((HEIGHT, WIDTH), bool) if valid is None else valid,
    )


def share(mask, region):
    return mask[region].mean()


STEP = np.array([0.06, 0.0, 0.0])


def crossing():
    previous, _ = render(np.zeros(3), np.array([3.0, -0.6, 0.0]))
    current, mask = render(STEP, np.array([3.0, -0.3, 0.0]))
    return previous, current, mask


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

"""A board that crosses in front of a wall and on a road, as a camera that goes straight on sees it."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from bench.cameras.angular import RadialPolynomialCamera
from bench.cameras.model import ray_grid
from bench.geometry import RigidTransform, RoadPlane
from bench.methods import MethodInput
from tests.support.worlds import pitched_down

WIDTH, HEIGHT = 640, 480
CAMERA = RadialPolynomialCamera(
    width=WIDTH, height=HEIGHT, coefficients=(170.0, -16.0, 24.0, -3.6), principal_point=(319.5, 239.5)
)
MOUNT_M = np.array([0.0, 0.0, 0.66])
LOOK = pitched_down(np.deg2rad(20))


@cache
def texture(seed, size=1024):
    """Periodic noise with detail at every scale, so that near and far surfaces both carry flow."""
    u, v = np.meshgrid(np.fft.rfftfreq(size), np.fft.fftfreq(size))
    frequency = np.maximum(np.hypot(u, v), 1 / size)
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(size, size)))
    pattern = np.fft.irfft2(noise / frequency * (frequency < 0.25), s=(size, size))
    return np.clip(128 + 40 * pattern / pattern.std(), 5, 250).astype(np.float32)


ROAD, WALL, BOX = 1, 2, 3  # seeds of their textures


def sample(pattern, x, y, pixels_per_m):
    u, v = ((place_m * pixels_per_m % len(pattern)).astype(np.float32) for place_m in (x, y))
    return cv2.remap(pattern, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


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
    image = sample(texture(WALL), np.arctan2(hit[..., 1], hit[..., 0]) * 12.0, hit[..., 2], 40.0)
    image[road] = sample(texture(ROAD), hit[..., 0], hit[..., 1], 150.0)[road]
    if box_m is not None:
        image[board] = sample(texture(BOX), hit[..., 1] - box_m[1], hit[..., 2], 80.0)[board]
    return image.astype(np.uint8), board


def camera_from_world(position_m):
    return RigidTransform(LOOK, -LOOK @ (MOUNT_M + position_m))


def frame(previous, current, step_m, valid=None):
    before, now = camera_from_world(np.zeros(3)), camera_from_world(step_m)
    return MethodInput(
        images=(previous, current),
        timestamps_ns=(0, 66_666_667),
        camera=CAMERA,
        road=RoadPlane(LOOK @ np.array([0.0, 0.0, -1.0]), 0.66),
        current_from_previous=(now @ before.inverse(),),
        valid=np.ones((HEIGHT, WIDTH), bool) if valid is None else valid,
    )


def scaled(given, width, height):
    """What a method is given, at another size."""
    images = tuple(cv2.resize(image, (width, height)) for image in given.images)
    valid = np.ones((height, width), dtype=bool)
    return replace(given, images=images, camera=given.camera.scaled(width, height), valid=valid)


STEP = np.array([0.06, 0.0, 0.0])


@cache
def crossing():
    """What a method is given of two images of a board that crosses, and the board's mask; nobody changes them."""
    given, (_, mask) = drive(range(2), (3.0, -0.6, 0.0), sideways_m=0.3)
    for image in (*given.images, mask):
        image.flags.writeable = False
    return given, mask


def drive(numbers, board_m, sideways_m, step=STEP):
    """Images of a camera that goes on by a step, on which a board crosses, and the board in each of them.

    Image 0 is taken at the origin, with the board at `board_m`, if there is one; image by image it moves to the left by
    `sideways_m`.
    """
    places = [None if board_m is None else np.add(board_m, [0.0, sideways_m * number, 0.0]) for number in numbers]
    rendered = [render(step * number, place) for number, place in zip(numbers, places, strict=True)]
    given = frame(rendered[-2][0], rendered[-1][0], step)
    found = replace(
        given,
        images=tuple(image for image, _ in rendered),
        timestamps_ns=tuple(66_666_667 * number for number in numbers),
        current_from_previous=given.current_from_previous * (len(numbers) - 1),
    )
    return found, [board for _, board in rendered]


def inner(board):
    return cv2.erode(board.astype(np.uint8), np.ones((9, 9))).astype(bool)


def far(board):
    return ~cv2.dilate(board.astype(np.uint8), np.ones((61, 61))).astype(bool) & (np.indices(board.shape)[0] < 440)

"""A rigid scene in two images: where each pixel's content was, if it lies at a given depth, and flow that starts there.

For a point of the static world at inverse depth `rho` along the unit ray p' of the current camera, the previous camera
saw it along `R^T (p' - rho t)`: for rho = 0, infinitely far, only the rotation counts; for growing rho the point moves
along the epipolar curve. On the road rho is `(p' . h) / eta_C`. Nothing here assumes a lens: curves are projected with
the camera's own model.

The near road moves by tens of pixels an image, further than a flow finds without help. So the previous image is warped
as if everything below the horizon lay on the road and everything above it infinitely far away; what is left to find is
small wherever the world is static. Where either image shows the ego vehicle's own body, or nothing, both are made
equal: nothing is to be found there, and nothing leaks out of there into the flow around.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, RayGrid, ray_grid
from bench.flow.dense import DenseFlow
from bench.geometry import Bools, Floats, RigidTransform, RoadPlane, dot
from bench.methods.contract import MethodInput
from bench.methods.two_views import RowTimes, seen_before

Scalar = TypeVar("Scalar", bound=np.generic)
FINE_PX = 640  # width about which outlines are drawn, and twice that on which all else is computed
GRID_PX = 4  # the motion of a rigid scene is smooth: computed on every fourth pixel, interpolated between
ROW_STEPS = 2  # to the row of the previous image that shows a point
OUTSIDE_PX = -1e4  # a displacement that surely ends outside of the image, where a NaN would spread


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidScene:
    """A static world as a moving camera sees it twice.

    Attributes:
        camera: the lens.
        current_from_previous: motion of the camera.
        road: the road below the current camera.
        row_times: when the rows of the two images were exposed; None for all at once.
    """

    camera: CameraModel
    current_from_previous: RigidTransform
    road: RoadPlane
    row_times: RowTimes | None = None

    @classmethod
    def of(cls, frame: MethodInput, *, back: int = 1, known: RigidScene | None = None) -> RigidScene:
        """The scene of the current image and the one `back` before it, by the motion that a method is told of.

        Args:
            frame: images, lens, road and motions.
            back: how many images.
            known: the scene of the last two images, whose motion is better than the recorded one; None for that one.
        """
        *earlier, last = frame.current_from_previous[-back:]
        motion, road = (last, frame.road) if known is None else (known.current_from_previous, known.road)
        for step in reversed(earlier):
            motion = motion @ step
        row_times = RowTimes.of(frame, back=back)
        return cls(camera=frame.camera, current_from_previous=motion, road=road, row_times=row_times)

    @property
    def grid(self) -> RayGrid:
        """The rays on which motion is computed."""
        return ray_grid(self.camera, GRID_PX)

    def fall(self) -> Floats:
        """Cosine of the angle of each ray of the grid to straight down, > 0 below the horizon; 0 without a ray."""
        return np.nan_to_num(dot(self.grid.rays_camera, self.road.down))

    def road_inverse_depth(self, fall: NDArray[np.floating], *, tilt_rad: float = 0.0) -> NDArray[np.floating]:
        """Inverse distance of the road along rays, 1/m, 0 from the horizon on up; shape and type of `fall`.

        Args:
            fall: cosine of the angle of each ray to straight down.
            tilt_rad: by so much the road may fall away from the plane: a lower bound of the inverse distance.

        Source:
            Mariotti and Eising, equation 13, with an uncertain plane.
        """
        return np.asarray(np.maximum(fall - tilt_rad, 0) / self.road.height_m)

    def previous_pixels(self, rays_camera: Floats, inverse_depth: NDArray[np.floating] | float) -> Floats:
        """Find where the previous image shows static points, (N, 2) float64, px; NaN where it cannot.

        Args:
            rays_camera: (N, 3) float64, unit rays of the current camera.
            inverse_depth: 1/m along each ray, (N,) or one number.
        """
        motion, depths = self.current_from_previous, np.broadcast_to(np.ravel(inverse_depth), len(rays_camera))
        if self.row_times is None:
            points = rays_camera - depths[:, None] * motion.translation_m  # p' - rho t
            return self.camera.project(points @ motion.rotation)[0]
        extra = self.extra_motion(rays_camera, depths)
        points = seen_before(rays_camera, depths, current_from_previous=motion, extra_motion=extra)
        return self.camera.project(points)[0]

    def extra_motion(self, rays_camera: Floats, inverse_depth: NDArray[np.floating]) -> Floats:
        """x of `bench.methods.two_views`, (N,) float64, of static points; arguments as of `previous_pixels`."""
        assert self.row_times is not None, "only of a rolling shutter"
        now, extra = self.camera.project(rays_camera)[0], np.zeros(len(rays_camera))
        for _ in range(ROW_STEPS):
            points = seen_before(
                rays_camera, inverse_depth, current_from_previous=self.current_from_previous, extra_motion=extra
            )
            extra = self.row_times.extra_motion(now, self.camera.project(points)[0], self.camera)
        return extra

    def flow_at(self, inverse_depth: NDArray[np.floating] | float) -> NDArray[np.float32]:
        """Motion of static points, from the current to the previous image.

        Args:
            inverse_depth: 1/m along each unit ray of the grid, (rows, columns) or one number.

        Returns:
            (rows, columns, 2) float32, px; NaN where the lens has no ray, now or then.
        """
        grid = self.grid
        pixels = self.previous_pixels(grid.rays_camera.reshape(-1, 3), inverse_depth)
        return shortened(pixels.reshape(grid.pixels.shape) - grid.pixels).astype(np.float32)

    def dense_flow_at(self, inverse_depth: NDArray[np.floating] | float) -> NDArray[np.float32]:
        """Motion of static points at every pixel, (H, W, 2) float32, px; far outside of the image without a ray."""
        return at_every_pixel(np.nan_to_num(self.flow_at(inverse_depth), nan=OUTSIDE_PX), self.camera)

    def road_flow(self) -> NDArray[np.float32]:
        """Motion of the road below the horizon and of what is infinitely far above it; as `dense_flow_at`."""
        return self.dense_flow_at(self.road_inverse_depth(self.fall()))


def shortened(displacements: Floats) -> Floats:
    """Displacements, (..., 2), px, of the same direction, but none longer than one that surely ends outside the image.

    A lens's polynomial is fitted within the image. Rays far outside of it may go to 1e17 px, whose squares overflow.
    """
    if not (np.abs(displacements) > -OUTSIDE_PX / 2).any():
        return displacements
    length = np.linalg.norm(displacements, axis=-1, keepdims=True)
    return np.asarray(displacements * (-OUTSIDE_PX / np.maximum(length, -OUTSIDE_PX)))


def at_every_pixel(values: NDArray[np.float32], camera: CameraModel) -> NDArray[np.float32]:
    """Values on the grid, bilinearly interpolated at every pixel; (rows, columns[, C]) -> (H, W[, C]) float32."""
    rows, columns = values.shape[:2]
    full = cv2.resize(values, (columns * GRID_PX, rows * GRID_PX), interpolation=cv2.INTER_LINEAR)
    return np.asarray(full[: camera.height, : camera.width], dtype=np.float32)


@lru_cache(maxsize=4)
def pixel_positions(width: int, height: int) -> NDArray[np.float32]:
    """(H, W, 2) float32: u and v of every pixel."""
    positions = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float32)
    positions.flags.writeable = False
    return positions


def remapped(
    image: NDArray[np.float32], positions: NDArray[np.float32], *, outside: float | None = 0.0
) -> NDArray[np.float32]:
    """An image at (H, W, 2) float32 positions, bilinear; (H, W[, C]) float32.

    Args:
        image: (H, W) or (H, W, C) float32.
        positions: u and v, px.
        outside: value beyond the border; None for that of the nearest pixel.
    """
    border, value = (cv2.BORDER_REPLICATE, 0.0) if outside is None else (cv2.BORDER_CONSTANT, outside)
    no_second_map: Any = None
    moved = cv2.remap(image, positions, no_second_map, cv2.INTER_LINEAR, borderMode=border, borderValue=value)
    return np.asarray(moved, dtype=np.float32)


def sampled(image: NDArray[np.float32], flow: NDArray[np.float32], *, outside: float = 0.0) -> NDArray[np.float32]:
    """An image at the ends of a flow, (H, W) float32, bilinear; `outside` where a flow leaves it."""
    height, width = flow.shape[:2]
    return remapped(image, pixel_positions(width, height) + flow, outside=outside)


def spread(values: NDArray[Scalar], shape: tuple[int, ...]) -> NDArray[Scalar]:
    """Small whole numbers, or a mask, at another size (H, W), nearest."""
    resized = cv2.resize(values.astype(np.uint8), shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(resized).astype(values.dtype)


def box_mean(values: NDArray[np.float32], side_px: int) -> NDArray[np.float32]:
    """Mean over a square around every pixel; (H, W[, C]) float32."""
    return np.asarray(cv2.boxFilter(values, -1, (side_px, side_px)), dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """The images at the two sizes that are worked on.

    Attributes:
        fine: (H, W) uint8 each, of the size of the answer, oldest first.
        given: all that the method is given, with images, lens and valid region at half of that size, rounded down.
        cell_size_px: pixels of the given images for one of the fine ones.
    """

    fine: tuple[NDArray[np.uint8], ...]
    given: MethodInput
    cell_size_px: int

    @classmethod
    def of(cls, frame: MethodInput) -> Views:
        """Those of what a method is given; its images are grey."""
        height, width = frame.valid.shape
        cell = fine_cell_px(width)
        fine_size = -(-width // cell), -(-height // cell)
        size = max(fine_size[0] // 2, 1), max(fine_size[1] // 2, 1)
        fine = tuple(image if cell == 1 else resized(image, fine_size) for image in frame.images)
        given = replace(
            frame,
            images=tuple(resized(image, size) for image in fine),
            camera=frame.camera.scaled(*size),
            valid=resized(frame.valid.astype(np.uint8) * 255, size) > 250,
        )
        return cls(fine=fine, given=given, cell_size_px=cell)


def fine_cell_px(width: int) -> int:
    """Pixels of images of a width for one of those that are worked on."""
    return max(round(width / FINE_PX), 1)


def resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """An image at a smaller size (width, height), each pixel the mean of those that it stands for."""
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuidedFlow:
    """Flow from the current to the previous image, and what it started from.

    Attributes:
        flow: (H, W, 2) float32, px; the first guess and what was found beyond it, composed.
        guess: (H, W, 2) float32, px, the first guess; far outside of the image where the lens saw nothing.
        warped: (H, W) uint8, the previous image at the ends of the guess; the current one where `neutral`.
        neutral: (H, W) bool; one of the images shows nothing of the world there.
    """

    flow: NDArray[np.float32]
    guess: NDArray[np.float32]
    warped: NDArray[np.uint8]
    neutral: Bools


def guided_flow(
    current: NDArray[np.uint8],
    previous: NDArray[np.uint8],
    *,
    valid: Bools,
    scene: RigidScene | None,
    flow: DenseFlow,
) -> GuidedFlow:
    """Find dense flow from the motion of a rigid scene on.

    Args:
        current: (H, W) uint8, grey.
        previous: (H, W) uint8, grey.
        valid: (H, W) bool; inside the lens's field and off the ego vehicle's body, in both images alike.
        scene: whose road and horizon the first guess shows, at the images' size; None for no first guess.
        flow: finds the rest.
    """
    guess, warped, neutral = warp(current, previous, valid=valid, scene=scene)
    rest = flow(current, warped)
    # The rest ends at x + rest in the warped image, which shows the previous one at x + rest + guess(x + rest).
    height, width = current.shape
    start = remapped(guess, pixel_positions(width, height) + rest, outside=None)
    return GuidedFlow(flow=rest + start, guess=guess, warped=warped, neutral=neutral)


def warp(
    current: NDArray[np.uint8], previous: NDArray[np.uint8], *, valid: Bools, scene: RigidScene | None
) -> tuple[NDArray[np.float32], NDArray[np.uint8], Bools]:
    """`guess`, `warped` and `neutral` of `GuidedFlow`; arguments as of `guided_flow`."""
    height, width = current.shape
    guess = np.zeros((height, width, 2), np.float32) if scene is None else scene.road_flow()
    neutral = (sampled((~valid).astype(np.float32), guess, outside=1.0) > 0.01) | ~valid
    warped = np.rint(sampled(previous.astype(np.float32), guess)).astype(np.uint8)
    warped[neutral] = current[neutral]
    return guess, warped, neutral

"""Edges of what stands still as the lidar sees them, and edges of the image: with a right calibration they coincide.

The lidar's returns jump in range from the side of a pole, a parked car or a house to what is behind. Moved to the
exposure and projected, such a jump has to lie on an edge of the image that runs the same way. This tells the camera's
rotation against the lidar to a fraction of a degree, on a straight road and at night, too, where flow cannot; it needs
no motion. After Levinson and Thrun, "Automatic online calibration of cameras and lasers", 2013.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import ray_grid
from bench.recordings import MountedCamera
from bench.reference.grid import DOWN, LEFT, RIGHT, UP, find_grid
from bench.reference.sweeps import PosedSweep

JUMP_M, JUMP = 0.7, 0.05  # in range from a return to its neighbour behind: in m, and as a part of its range
SPAN_M = (1.5, 30.0)  # of the lidar; the edges of what is further are few and small
ABOVE_ROAD_M = 0.3  # the road ends in no edge, it is hidden
SECTORS = 4  # of the directions of an image's edges
SECTOR_RAD = np.radians(33.0)  # an edge belongs to sectors whose middle is so near to its direction
FARTHEST_PX = 8.0  # of an image's edge: beyond there is none
MARGIN_PX = 9  # around the own body and the end of the lens, which are edges, too
OVER_NOISE = 4.0  # an edge's gradient over the median of the image's
LEAST_GRADIENT = 4.0  # grey levels per pixel
SMOOTH_PX = 1.2  # sigma
CANNY_STEPS = 16  # of a grey level


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """Edges of a sweep, and those of an image taken at about that time.

    Attributes:
        points_world: (N, 3) float64, m, halfway between a return and the beam that passes it.
        ends_world: (N, 3) float64, m, 5 cm further along the edge: the two give its direction in the image.
        offsets: (4, H, W, 2) int16, px, from each pixel to the nearest edge of the image of each direction, right and
            down; `FARTHEST_PX` or more where there is none.
    """

    points_world: NDArray[np.float64]
    ends_world: NDArray[np.float64]
    offsets: NDArray[np.int16]


def lidar_edges(
    placed: PosedSweep, heights_m: NDArray[np.float64], usable: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the edges of what a sweep saw.

    Only edges that go on for five beams count: leaves and most fences have none, and their jumps lie on nothing that an
    image shows.

    Args:
        placed: the sweep.
        heights_m: (N,) float64, m, of its returns above the road.
        usable: (N,) bool, returns that stand still and that the camera sees, too.

    Returns:
        points_world and ends_world of `Edges`.
    """
    points, nothing = placed.points_sensor(), np.empty((0, 3))
    grid = find_grid(points)
    if grid is None:
        return nothing, nothing
    ranges_m, world = np.linalg.norm(points, axis=1), placed.points_world()
    possible = usable & (ranges_m > SPAN_M[0]) & (ranges_m < SPAN_M[1])
    found, ends = [nothing], [nothing]
    for side, beyond in enumerate(grid.neighbours):
        jumps = (beyond >= 0) & (ranges_m[beyond] - ranges_m > np.maximum(JUMP_M, JUMP * ranges_m))
        along = [UP, DOWN] if side in (LEFT, RIGHT) else [LEFT, RIGHT]
        one, other = grid.neighbours[along]
        goes_on = jumps & grid.linked[along].all(axis=0) & jumps[one] & jumps[other]
        goes_on &= goes_on[one] & goes_on[other]
        rows = np.flatnonzero(goes_on & possible & (heights_m > ABOVE_ROAD_M))
        # Halfway to the next beam, at the range of the return: the edge lies somewhere between the two.
        ahead = points[rows] / ranges_m[rows, None] + points[beyond[rows]] / ranges_m[beyond[rows], None]
        ahead *= (ranges_m[rows] / np.linalg.norm(ahead, axis=1))[:, None]
        found.append(world[rows] + _turned(placed, ahead - points[rows]))
        direction = world[one[rows]] - world[other[rows]]
        ends.append(found[-1] + 0.05 * direction / np.linalg.norm(direction, axis=1)[:, None])
    return np.concatenate(found), np.concatenate(ends)


def _turned(placed: PosedSweep, vectors_sensor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Short vectors from the sensor's axes into those of the world, with the pose in the middle of the sweep."""
    rotation = placed.rotations[len(placed.rotations) // 2] @ placed.lidar_from_sensor.rotation
    return np.asarray(vectors_sensor @ rotation.T)


def image_edges(image: NDArray[np.uint8], camera: MountedCamera) -> NDArray[np.int16]:
    """Offsets to the nearest edge of an image, `Edges.offsets`.

    Args:
        image: (H, W) uint8.
        camera: it is of.
    """
    height, width = image.shape
    scene = _scene(camera)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTH_PX)
    right, down = (cv2.Sobel(smooth, cv2.CV_32F, *way, scale=1 / 8) for way in ((1, 0), (0, 1)))
    noise = float(np.median(np.hypot(right, down)[scene])) if scene.any() else 0.0
    strong = CANNY_STEPS * max(LEAST_GRADIENT, OVER_NOISE * noise)
    # Canny takes whole numbers.
    right_steps, down_steps = ((CANNY_STEPS * slope).round().astype(np.int16) for slope in (right, down))
    edges = (cv2.Canny(right_steps, down_steps, strong / 2, strong, L2gradient=True) > 0) & scene
    direction = np.arctan2(down, right)
    v, u = np.indices((height, width), dtype=np.int32)
    places = np.dstack([u, v])
    offsets = np.full((SECTORS, height, width, 2), int(FARTHEST_PX), np.int16)
    for sector in range(SECTORS):
        away = np.abs((direction - sector * np.pi / SECTORS + np.pi / 2) % np.pi - np.pi / 2)
        chosen = edges & (away < SECTOR_RAD)
        if chosen.any():
            _, labels = cv2.distanceTransformWithLabels(
                (~chosen).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
            )
            nearest = np.zeros((int(labels.max()) + 1, 2), np.int32)
            nearest[labels[chosen]] = places[chosen]
            offsets[sector] = nearest[labels] - places
    return offsets


def _scene(camera: MountedCamera) -> NDArray[np.bool_]:
    """Pixels, (H, W), that show the scene, not near the own body or the end of the lens."""
    shown = ray_grid(camera.model).valid
    if camera.ego_body is not None:
        shown = shown & ~camera.ego_body
    return np.asarray(cv2.erode(shown.astype(np.uint8), np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)) > 0)

"""What images show of the static world: flow and edges at its lidar returns, against which calibration is tried.

A return of what stands still, moved by ego-motion and projected into two images, must be where the flow between them
leads. Flow is computed once; a calibration then costs two projections of a few thousand points.

The lidar's returns jump in range from the side of a pole, a parked car or a house to what is behind. Moved to the
exposure and projected, such a jump has to lie on an edge of the image that runs the same way. This tells the camera's
rotation against the lidar to a fraction of a degree, on a straight road and at night, too, where flow cannot; it needs
no motion. After Levinson and Thrun, "Automatic online calibration of cameras and lasers", 2013.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import ray_grid
from bench.errors import DataError
from bench.flow.dense import DisFlow
from bench.recordings import MountedCamera, Recording, read_image
from bench.reference.grid import DOWN, LEFT, RIGHT, UP, find_grid
from bench.reference.sweeps import PosedSweep, pose_sweep
from bench.validation.findings import distance_to, on_objects, sweep_times, times_of
from bench.validation.fits.scan_matching import MeasuredMotion

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


def lidar_edges(placed: PosedSweep, heights_m: NDArray[np.float64], usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Find the edges of what a sweep saw.

    Only edges that go on for five beams count: leaves and most fences have none, and their jumps lie on nothing that an
    image shows.

    Args:
        placed: the sweep.
        heights_m: (N,) float64, m, of its returns above the road.
        usable: (N,) bool, returns that stand still and that the camera sees, too.

    Returns:
        `edges_world` of `SeenFlow`.
    """
    points, nothing = placed.points_sensor(), np.empty((0, 3))
    grid = find_grid(points)
    if grid is None:
        return np.stack([nothing, nothing])
    ranges_m, world = np.linalg.norm(points, axis=1), placed.points_world()
    possible = usable & (ranges_m > SPAN_M[0]) & (ranges_m < SPAN_M[1])
    edges, ends = [nothing], [nothing]
    # Short ways turn into the world's axes with the pose in the middle of the sweep.
    world_from_sensor = placed.rotations[len(placed.rotations) // 2] @ placed.lidar_from_sensor.rotation
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
        edges.append(world[rows] + (ahead - points[rows]) @ world_from_sensor.T)
        direction = world[one[rows]] - world[other[rows]]
        ends.append(edges[-1] + 0.05 * direction / np.linalg.norm(direction, axis=1)[:, None])
    return np.stack([np.concatenate(edges), np.concatenate(ends)])


def image_edges(image: NDArray[np.uint8], camera: MountedCamera) -> NDArray[np.int16]:
    """Offsets to the nearest edge of an image, `edge_offsets` of `SeenFlow`.

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


# How much is looked at, and flow that counts as seen.
PAIRS = 16  # of neighbouring images, spread over the drive
MEASURED = 10  # of pairs whose motion the lidar measures; with fewer all pairs are taken, and ego-motion as stated
POINTS = 6000  # returns of each pair, before a camera sees some of them
LARGEST_WIDTH_PX = 640  # larger images are reduced to this: flow takes 50 ms a pair then
# Of returns from the camera: nearer ones are hidden from it by the car itself, farther ones hardly move.
FLOW_SPAN_M = (1.5, 40.0)
HIDDEN = 0.8  # of the range of a return, seen from the camera: one that is so much nearer hides it, see `_in_sight`
NEAREST_SWEEP_NS = 60_000_000  # of a sweep to an image, half a revolution at 10 Hz
RETURN_PX = 0.4  # flow there and back ends at most so far from its start
TEXTURE = 1e-4  # smaller eigenvalue of the structure tensor of a patch, as `cornerMinEigenVal` scales it, at least
FLOW_OVER_NOISE = 4.0  # the same over that of a quarter of the pixels, which are sky, or noise at night
MOVED_M = 0.1  # path of a pair, plus 10 m times its turn in radians, at least: else what moves is not the camera
MOVED_PX = 1.0  # median flow of a pair, at least: with less there is nothing to tell
FOLLOWED = 0.2  # share of the textured pixels whose flow must lead back
PATCH_PX = 9  # as DIS matches
FLOW = DisFlow(preset="fast", finest_scale=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenFlow:
    """Flow from an image to the one before it.

    Attributes:
        current_ns: time of the image.
        previous_ns: time of the one before it.
        flow: (H, W, 2) float32, px, from the image to the one before it; NaN where it is not seen.
        points_world: (N, 3) float64, m, returns of the static world.
        edges_world: (2, M, 3) float64, m, edges of the sweep: halfway between a return and the beam that passes it, and
            5 cm further along the edge, which gives its direction in the image.
        edge_offsets: (4, H, W, 2) int16, px, from each pixel to the nearest edge of the image of each direction, right
            and down; `FARTHEST_PX` or more where there is none.
    """

    current_ns: int
    previous_ns: int
    flow: NDArray[np.float32]
    points_world: NDArray[np.float64]
    edges_world: NDArray[np.float64]
    edge_offsets: NDArray[np.int16]


def mirrored(flows: Sequence[SeenFlow]) -> list[SeenFlow]:
    """Flow and edges as images show them that are mirrored left to right."""
    mirror = np.array([-1, 1])
    return [
        replace(
            seen,
            flow=seen.flow[:, ::-1] * mirror.astype(np.float32),
            edge_offsets=seen.edge_offsets[[0, 3, 2, 1], :, ::-1] * mirror.astype(np.int16),
        )
        for seen in flows
    ]


def reduced(camera: MountedCamera) -> MountedCamera:
    """The camera at the size at which flow is computed."""
    width, height = camera.model.width, camera.model.height
    if width <= LARGEST_WIDTH_PX:
        return camera
    size = LARGEST_WIDTH_PX, round(height * LARGEST_WIDTH_PX / width)
    body = None if camera.ego_body is None else cv2.resize(camera.ego_body.astype(np.uint8), size) > 0
    return replace(camera, model=camera.model.scaled(*size), ego_body=body)


def seen_flows(recording: Recording, camera: MountedCamera, measured: MeasuredMotion) -> Iterator[SeenFlow]:
    """Flow of the chosen pairs of a camera's images.

    Args:
        recording: the drive.
        camera: one of its cameras, `reduced`.
        measured: what the lidar says of the ego-motion.
    """
    for row in chosen_pairs(recording, camera.name, measured):
        with suppress(DataError):  # reported by the checks of images and sweeps
            flow = seen_flow(recording, camera, row)
            if flow is not None:
                yield flow


def seen_flow(recording: Recording, camera: MountedCamera, row: int) -> SeenFlow | None:
    """Flow from an image to the one before it; None where too little moves or has texture, or no sweep is near.

    Args:
        recording: the drive.
        camera: one of its cameras, `reduced`.
        row: index of the image, at least 1.

    Raises:
        DataError: an image or the sweep cannot be read.
    """
    previous, current = recording.images[camera.name][row - 1 : row + 1]
    image = read_image(current, camera)
    flow = _seen(image, read_image(previous, camera), camera)
    static = None if flow is None else _static_world(recording, current.timestamp_ns, camera)
    if flow is None or static is None:
        return None
    points_world, edges_world = static
    return SeenFlow(
        current_ns=current.timestamp_ns,
        previous_ns=previous.timestamp_ns,
        flow=flow,
        points_world=points_world,
        edges_world=edges_world,
        edge_offsets=image_edges(image, camera),
    )


def chosen_pairs(recording: Recording, camera: str, measured: MeasuredMotion) -> list[int]:
    """Indices of images, not the first, in whose time the camera moves: the middle one of each part of the drive.

    Where the lidar measures the motion of enough of them, only those.
    """
    times_ns, sweeps_ns = times_of(recording, camera), sweep_times(recording)
    if len(times_ns) < 2 or not len(sweeps_ns):
        return []
    rotations, positions_m, valid = recording.trajectory.at(times_ns)
    steps_ns = np.diff(times_ns)
    usable = valid[1:] & valid[:-1] & (steps_ns < 1.5 * recording.frame_interval_ns)
    usable &= distance_to(times_ns[1:], sweeps_ns) < NEAREST_SWEEP_NS
    moved = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    turned = np.linalg.norm(np.diff(rotations, axis=0), axis=(1, 2))
    usable &= moved + 10.0 * turned > MOVED_M
    known = usable & measured.at((times_ns[1:] + times_ns[:-1]) // 2)
    rows = np.flatnonzero(known if known.sum() >= MEASURED else usable) + 1
    parts = np.linspace(0, len(rows), min(PAIRS, len(rows)) + 1).astype(int)
    return [int(rows[(first + last) // 2]) for first, last in pairwise(parts)]


def _seen(current: NDArray[np.uint8], previous: NDArray[np.uint8], camera: MountedCamera) -> NDArray[np.float32] | None:
    """Flow where there is texture and the way back ends where it began, NaN elsewhere; None where too little is."""
    smooth, smooth_previous = (np.asarray(cv2.GaussianBlur(i, (3, 3), 0), np.uint8) for i in (current, previous))
    contrast = cv2.cornerMinEigenVal(smooth, PATCH_PX)
    textured = contrast > max(TEXTURE, FLOW_OVER_NOISE * float(np.quantile(contrast, 0.25)))
    if camera.ego_body is not None:
        textured &= ~camera.ego_body
    flow, back = FLOW(smooth, smooth_previous), FLOW(smooth_previous, smooth)
    v, u = np.indices(current.shape, dtype=np.float32)
    returned = cv2.remap(back, u + flow[..., 0], v + flow[..., 1], cv2.INTER_LINEAR, borderValue=(1e3, 1e3))
    followed = textured & (np.linalg.norm(flow + returned, axis=2) < RETURN_PX)
    if followed.sum() < max(FOLLOWED * textured.sum(), 1):
        return None
    if np.median(np.linalg.norm(flow[followed], axis=1)) < MOVED_PX:
        return None
    return np.where(followed[..., None], flow, np.float32(np.nan))


def _static_world(
    recording: Recording, time_ns: int, camera: MountedCamera
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Returns of the nearest sweep that lie on no annotated object and that the camera sees, too, and their edges.

    Returns:
        (N, 3), m, world frame, some of the returns, and `lidar_edges` of all; None where no sweep is near.
    """
    sweeps_ns = sweep_times(recording)
    if not len(sweeps_ns) or np.abs(sweeps_ns - time_ns).min() > NEAREST_SWEEP_NS:
        return None
    sweep = recording.sweeps[int(np.argmin(np.abs(sweeps_ns - time_ns)))].read()
    placed = pose_sweep(sweep, recording.trajectory, recording.vehicle_from_lidar, recording.lidar_from_sensor)
    if placed is None:
        return None
    points_vehicle = recording.vehicle_from_lidar.apply(sweep.points_lidar.astype(np.float64))
    away_m = np.linalg.norm(points_vehicle, axis=1)
    points_world = placed.points_world()
    place_m = recording.trajectory.world_from_vehicle(time_ns).apply(camera.vehicle_from_camera.translation_m)
    usable = _in_sight(points_world - place_m) & (away_m > FLOW_SPAN_M[0]) & (away_m < FLOW_SPAN_M[1])
    usable[usable] = ~on_objects(points_vehicle[usable], sweep.timestamp_ns, recording)
    rows = np.flatnonzero(usable)
    # Some at random, or the beams' pattern would choose.
    rows = np.random.default_rng(0).permutation(rows)[:POINTS]
    heights_m = points_vehicle[:, 2] - recording.ground_m
    return (points_world[rows], lidar_edges(placed, heights_m, usable)) if len(rows) else None


def _in_sight(points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Points, (N, 3), m, from the camera, level, that no others hide: none within a degree or two is much nearer.

    The lidar looks over what the camera stands before: without this, cars would have the flow of the wall behind them.
    """
    ranges_m = np.linalg.norm(points_m, axis=1)
    azimuth = np.degrees(np.arctan2(points_m[:, 1], points_m[:, 0])).astype(int) % 360
    elevation = 90 + np.degrees(np.arctan2(points_m[:, 2], np.hypot(points_m[:, 0], points_m[:, 1]))).astype(int)
    nearest_m = np.full((181, 360), np.inf)
    np.minimum.at(nearest_m, (elevation, azimuth), ranges_m)
    around_m = cv2.erode(np.pad(nearest_m, ((0, 0), (1, 1)), mode="wrap"), np.ones((3, 3), np.uint8))[:, 1:-1]
    return np.asarray(around_m[elevation, azimuth] > HIDDEN * ranges_m)

"""Sweeps, images and lenses of a drive, as the review page draws them."""

from __future__ import annotations

import struct

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel
from bench.lidar import LidarSweep
from bench.lidar.sweep import deskew, interpolation_timestamps
from bench.recordings import ImageRef, MountedCamera, Recording, read_image
from bench.reference.regions import Region

MOST_POINTS, MOST_GROUND = 30_000, 6_000  # of a sweep; the others are left out evenly
GROUND_M, GROUND_SLOPE = 0.2, 0.01  # above the road by less than this and this part of the range
FARTHEST_M = 120.0
CM = 100.0
LARGEST_SIDE_PX = 1280
JPEG_QUALITY = 85
GRID = 129  # of the table of a lens, in both directions
WIDEST_RAD = 2.2


def sweep_points_world(
    sweep: LidarSweep, recording: Recording
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.bool_]]:
    """The points of a sweep in the world, each taken from where the lidar was at its own time.

    Returns:
        points: (N, 3) float64, m, world frame.
        times_ns: (N,) int64, of each point.
        ground: (N,) bool, True near the road as the vehicle stands on it.

    Raises:
        DataError: no ego-motion at the time of the sweep.
    """
    times_ns = sweep.times_ns
    if not len(times_ns):
        return np.empty((0, 3)), times_ns, np.empty(0, dtype=bool)
    sampled_ns = interpolation_timestamps(times_ns)
    rotations, positions_m, valid = recording.trajectory.at(sampled_ns)
    if not valid.all():
        recording.trajectory.world_from_vehicle(int(sampled_ns[~valid][0]))  # raises, with what is there
    mounting = recording.vehicle_from_lidar
    points = deskew(
        sweep.points_lidar,
        times_ns,
        interpolation_ns=sampled_ns,
        rotations=rotations @ mounting.rotation,
        positions_m=positions_m + rotations @ mounting.translation_m,
    )
    above_m = (points - positions_m[0]) @ rotations[0][:, 2]
    range_m = np.hypot(*(points - positions_m[0]).T[:2])
    near = range_m < 15.0
    road_m = np.percentile(above_m[near], 5) if near.any() else 0.0
    return points, times_ns, above_m - road_m < GROUND_M + GROUND_SLOPE * range_m


def packed_sweep(sweep: LidarSweep, recording: Recording) -> bytes:
    """A sweep in few bytes: what stands on the road, then some of the road.

    Returns:
        Little-endian: int32 points, int32 of them on the road (the last), float64 x, y, z of the origin in the world
        (m), int16 x, y, z of each point from there (cm), int8 time of each point minus that of the sweep (ms).

    Raises:
        DataError: as `sweep_points_world`.
    """
    points, times_ns, ground = sweep_points_world(sweep, recording)
    origin_m = recording.trajectory.world_from_vehicle(sweep.timestamp_ns).translation_m
    near = np.abs(points - origin_m).max(axis=1, initial=0.0) < FARTHEST_M
    standing = _thinned(np.flatnonzero(near & ~ground), MOST_POINTS)
    road = _thinned(np.flatnonzero(near & ground), MOST_GROUND)
    rows = np.concatenate([standing, road])
    cm = ((points[rows] - origin_m) * CM).round().astype("<i2")
    ms = np.clip(np.round((times_ns[rows] - sweep.timestamp_ns) / 1e6), -127, 127).astype("i1")
    return b"".join((struct.pack("<iiddd", len(rows), len(road), *origin_m), cm.tobytes(), ms.tobytes()))


def _thinned(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    return rows if len(rows) <= most else rows[np.linspace(0, len(rows) - 1, most).astype(np.intp)]


def encoded_image(image: ImageRef, camera: MountedCamera) -> bytes:
    """An image as JPEG, made smaller where it is large.

    Raises:
        DataError: it cannot be read.
    """
    pixels = read_image(image, camera, colour=True)
    scale = LARGEST_SIDE_PX / max(pixels.shape[:2])
    if scale < 1:
        pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    written, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert written
    return encoded.tobytes()


def region_outlines(region: Region | None, camera: CameraModel) -> dict[str, list[list[list[float]]]]:
    """Outlines of a region's pixels: `core`, which is certain, and `possible`, the core and the band around it.

    Returns:
        Closed lines of u and v as parts of the image's width and height; none where the region has no such pixels.
    """
    if region is None:
        return {"core": [], "possible": []}
    rows, columns = region.window
    corner, size = np.array([columns.start, rows.start]) + 0.5, np.array([camera.width, camera.height])
    return {
        name: [
            ((line[:, 0] + corner) / size).round(4).tolist()
            for line in cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
        ]
        for name, mask in (("core", region.core), ("possible", region.possible))
    }


def lens_limit_rad(camera: CameraModel) -> float:
    """Largest angle to the optical axis of the table of a lens."""
    return min(camera.limit_angle_rad, WIDEST_RAD)


def lens_table(camera: CameraModel) -> bytes:
    """Pixels of rays on a grid, to look up between its nodes: any lens in a page that knows none.

    A node (a, b) of the grid, both from -1 to 1, is the ray at the angle r * `lens_limit_rad` from the optical axis in
    the direction (a, b), with r their length.

    Returns:
        (129, 129, 2) float32, little-endian, rows by b: u and v as parts of the image's width and height; NaN where
        the lens maps nothing.
    """
    a, b = np.meshgrid(np.linspace(-1, 1, GRID), np.linspace(-1, 1, GRID))
    radius = np.hypot(a, b)
    angle = radius * lens_limit_rad(camera)
    sideways = np.where(radius > 0, np.sin(angle) / np.where(radius > 0, radius, 1.0), 0.0)
    rays = np.stack([a * sideways, b * sideways, np.cos(angle)], axis=-1).reshape(-1, 3)
    pixels, valid = camera.project(rays)
    pixels[~valid] = np.nan
    parts = (pixels + 0.5) / np.array([camera.width, camera.height])
    return bytes(parts.astype("<f4").data)

"""Pixels that show an annotated shape: the projection of its whole surface, exact at every pixel's centre.

A pixel shows a convex body where its ray lies in the cone that the body spans at the camera. The cone is bounded by
planes through the camera and two corners, so no surface is sampled, and the borders of the image and of the lens's
field cut it where they are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.cameras.model import CameraModel, ray_grid
from bench.geometry import Floats, cross, dot, normalise
from bench.records.recording import Annotated, Cuboid, GroundPolygon, MountedCamera, ObjectShape
from bench.reference.raster import Raster

TALLEST_M = 4.5  # road users in areas that are left out: lorries of 4 m (Directive 96/53/EC) and slack
BLOCK_PX = 16  # side of the blocks of pixels that are decided together where they can be
ON_PLANE = 1e-9  # sine of the angle up to which a corner lies on a plane
BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def convex_parts(shape: ObjectShape) -> Floats:
    """Corners of convex bodies that together are the shape.

    Returns:
        (P, K, 3) float64, m, vehicle frame: one body of eight corners for a cuboid, triangular prisms for a ground
        polygon, none for point indices.
    """
    match shape:
        case Cuboid():
            return shape.vehicle_from_object.apply(BOX_CORNERS * shape.size_m)[None]
        case GroundPolygon():
            triangles = shapely.constrained_delaunay_triangles(shapely.make_valid(shapely.Polygon(shape.outline_m)))
            floors_m = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]  # the fourth closes the ring
            parts = np.empty((len(floors_m), 6, 3))
            parts[:, :3, :2] = parts[:, 3:, :2] = floors_m
            parts[:, :3, 2], parts[:, 3:, 2] = shape.bottom_m, shape.top_m
            return parts
    return np.empty((0, 8, 3))


class Prism(NamedTuple):
    """The upright prism over the convex ground of a shape; a point x lies within where n x <= h for all sides.

    Attributes:
        normals: (F, 3) float64, n, outwards, of any length.
        heights: (F,) float64, h.
    """

    normals: Floats
    heights: Floats

    @classmethod
    def around(cls, parts: Floats, *, clearance_m: float = 0.0) -> Prism | None:
        """The prism around bodies.

        Args:
            parts: (P, K, 3) float64, m, corners of the bodies, z upwards.
            clearance_m: above the lowest corner, where the prism begins.

        Returns:
            None without bodies, or where their ground has no area.
        """
        corners = parts.reshape(-1, 3)
        ring = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(corners[:, :2])))  # clockwise
        if len(ring) < 4:
            return None
        (along_x, along_y), (low_m, high_m) = np.diff(ring, axis=0).T, (corners[:, 2].min(), corners[:, 2].max())
        sides = np.column_stack([-along_y, along_x, np.zeros(len(along_x))])
        return cls(
            normals=np.concatenate([sides, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]),
            heights=np.concatenate([(sides[:, :2] * ring[:-1]).sum(axis=1), [-low_m - clearance_m, high_m]]),
        )

    def ways_m(self, starts: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return the distances at which rays enter and leave.

        Args:
            starts: (N, 3) float64, m.
            directions: (N, 3) float64, unit.

        Returns:
            enter: (N,) float64, m from the start, negative where that lies within or beyond.
            leave: (N,) float64, m, less than `enter` where the ray's line misses.
        """
        room, speeds = self.heights - starts @ self.normals.T, directions @ self.normals.T
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = room / speeds
        alongside = np.where(room < 0.0, np.inf, -np.inf)
        enter = np.where(speeds < 0.0, ways, np.where(speeds > 0.0, -np.inf, alongside)).max(axis=1)
        return enter, np.where(speeds > 0.0, ways, np.inf).min(axis=1)


def silhouette(parts_camera: Iterable[Floats], camera: CameraModel) -> Raster:
    """The pixels whose centre's ray meets one of several convex bodies.

    Args:
        parts_camera: corners of each body, (K, 3) float64, m, camera frame; a body may hold the camera.
        camera: the lens.
    """
    blocks = _blocks(camera)
    covered = np.zeros((camera.height, camera.width), dtype=bool)
    reached = np.zeros(len(blocks.sines), dtype=bool)
    for corners in parts_camera:
        planes = _bounding_planes(corners)
        if planes is not None:
            reached |= blocks.mark(covered.reshape(-1), planes)
    window = blocks.window(reached, covered.shape)
    return Raster(window, covered[window])


def left_out_ground(annotated: Annotated) -> BaseGeometry:
    """The areas as one, x and y in the vehicle frame, m; empty without any."""
    return shapely.union_all([shapely.make_valid(shapely.Polygon(outline)) for outline in annotated.left_out_m])


def left_out_pixels(annotated: Annotated, camera: MountedCamera) -> NDArray[np.bool_]:
    """Pixels whose ray meets something that may stand in one of the areas, whatever is in front of it.

    Args:
        annotated: of the recording.
        camera: on the vehicle.

    Returns:
        (H, W) bool.
    """
    covered = np.zeros((camera.model.height, camera.model.width), dtype=bool)
    for outline in annotated.left_out_m:
        body = GroundPolygon(outline_m=np.array(outline), bottom_m=camera.ground_m, top_m=camera.ground_m + TALLEST_M)
        parts_camera = camera.vehicle_from_camera.inverse().apply(convex_parts(body))
        window, inside = silhouette(parts_camera, camera.model)
        covered[window] |= inside
    return covered


def _bounding_planes(corners_camera: Floats) -> Floats | None:
    """Planes through the camera that bound the cone of a convex body.

    Returns:
        (F, 3) float64, unit normals; a ray is in the cone where none of its products with them is negative. No rows
        where the camera is inside of the body; None where all corners lie on one line through the camera.
    """
    largest_m = np.abs(corners_camera).max()  # corners of any size: their squares neither overflow nor vanish
    rays = normalise(corners_camera / (largest_m or 1.0))
    rays = rays[np.isfinite(rays).all(axis=1)]  # a corner in the camera's centre spans nothing
    first, second = np.triu_indices(len(rays), k=1)
    normals = cross(rays[first], rays[second])
    sines = np.sqrt(dot(normals, normals))
    apart = sines > ON_PLANE
    if not apart.any():
        return None
    normals = normals[apart] / sines[apart, None]
    heights = normals @ rays.T
    return np.concatenate([normals[heights.min(axis=1) >= -ON_PLANE], -normals[heights.max(axis=1) <= ON_PLANE]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Blocks:
    """The pixels of a camera in square blocks, without the blocks that the lens does not reach.

    Attributes:
        rays: (H * W, 3) float64, unit rays of all pixels, camera frame; NaN where not valid.
        corners: (B, 2) intp, row and column of each block's first pixel.
        pixels: (B, BLOCK_PX ** 2) intp, which rays are a block's; at the image's border the last ones repeat.
        axes: (3, B) float64, unit, middle of each block's rays, camera frame; zero where there is none.
        sines: (B,) float64, of the largest angle between the axis and a ray; 1 from 90 degrees on.
    """

    rays: Floats
    corners: NDArray[np.intp]
    pixels: NDArray[np.intp]
    axes: Floats
    sines: Floats

    def mark(self, covered: NDArray[np.bool_], planes: Floats) -> NDArray[np.bool_]:
        """Set the pixels of `covered`, (H * W,), whose rays lie on the inner side of all planes; the blocks reached."""
        lowest = (planes @ self.axes).min(axis=0, initial=1.0)
        whole, reached = lowest > self.sines, lowest >= -self.sines
        inside = self.pixels[whole].ravel()
        covered[inside] = np.isfinite(self.rays[inside, 0])
        cut = self.pixels[reached & ~whole].ravel()
        covered[cut] |= (planes @ self.rays[cut].T >= 0.0).all(axis=0)  # False for NaN
        return np.asarray(reached)

    def window(self, reached: NDArray[np.bool_], shape: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of an image of this shape that hold the blocks."""
        if not reached.any():
            return slice(0, 0), slice(0, 0)
        corners = self.corners[reached]
        first, last = corners.min(axis=0).tolist(), np.minimum(corners.max(axis=0) + BLOCK_PX, shape).tolist()
        return slice(first[0], last[0]), slice(first[1], last[1])


@lru_cache(maxsize=16)
def _blocks(camera: CameraModel) -> _Blocks:
    """The blocks of a camera; equal cameras share them."""
    rays = ray_grid(camera).rays_camera.reshape(-1, 3)
    rows, columns = np.meshgrid(np.arange(0, camera.height, BLOCK_PX), np.arange(0, camera.width, BLOCK_PX))
    steps = np.arange(BLOCK_PX)
    v = np.minimum(rows.ravel()[:, None, None] + steps[:, None], camera.height - 1)
    u = np.minimum(columns.ravel()[:, None, None] + steps, camera.width - 1)
    pixels = (v * camera.width + u).reshape(rows.size, -1)
    corners = np.column_stack([rows.ravel(), columns.ravel()])
    reached = np.isfinite(rays[pixels, 0]).any(axis=1)
    corners, pixels = corners[reached], pixels[reached]
    held = rays[pixels]
    axes = np.nan_to_num(normalise(np.nansum(held, axis=1)))
    turns = cross(axes[:, None], held)
    sines = np.sqrt(np.nanmax(dot(turns, turns), axis=1))
    sines[np.nanmin(dot(axes[:, None], held), axis=1) <= 0.0] = 1.0
    return _Blocks(rays=rays, corners=corners, pixels=pixels, axes=np.ascontiguousarray(axes.T), sines=sines)

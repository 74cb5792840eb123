"""Lidar data of one object at an exposure: its returns, its surface, how sure it is, what was out of reach."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform, cross, dot, normalise
from bench.geometry.raster import Raster
from bench.records.reference import ReferenceSettings
from bench.reference.clusters import Cluster, parts_at_exposure
from bench.reference.envelope import Beam
from bench.reference.exposure import Exposure
from bench.reference.grid import Grid
from bench.reference.motion import ObjectAtExposure
from bench.reference.outline_errors import limb_motion_m, outline_error_m
from bench.reference.patches import (
    CERTAIN,
    LEAST,
    LIKELY,
    Bounds,
    Layer,
    Patches,
    draw,
    surface_patches,
    union,
    without_slits,
)
from bench.reference.silhouette import Prism, silhouette
from bench.reference.sweeps import PosedSweep
from bench.times import SECOND_NS

OUTLINE_STEP_M = 0.25  # the height of a cone that falls by 24 degrees, 1.5 m from its axis, is right to 3 mm
SOLID_CLASSES = ("vehicle",)  # seen through their windows at most, which belong to them


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """Pixels of the surface that an object's returns stand for.

    Attributes:
        likely: (rows, columns) bool, of a window that may reach beyond the image; nothing where too few returns tell.
        corner: (2,) int64, (u, v) of this window's first pixel.
        least: in V, with free ends drawn in; None without `ReferenceSettings.outline`.
        most: in V, what it gains with free ends drawn out; None likewise.
        certain: in V, between returns that leave no doubt; None also for what is solid.
    """

    likely: NDArray[np.bool_]
    corner: NDArray[np.int64]
    least: Raster | None = None
    most: Raster | None = None
    certain: Raster | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ScannedObject:
    """An annotated object at an exposure with its lidar returns.

    Attributes:
        annotated: the object.
        exposure: of the image.
        settings: of the protocol.
        cluster: its returns; none where the lidar met it nowhere.
        placed: the sweep that they are of; None where there is none.
        left_out_ground: areas that the annotations leave out, x and y in the vehicle frame, m.
    """

    annotated: ObjectAtExposure
    exposure: Exposure
    settings: ReferenceSettings
    cluster: Cluster
    placed: PosedSweep | None
    left_out_ground: BaseGeometry = field(default_factory=Polygon)

    @cached_property
    def pixels(self) -> NDArray[np.float64]:
        """(N, 2) float64, px, (u, v), of its returns; NaN where the lens cannot see one."""
        return self.exposure.project(self.cluster.points_world)

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(N,) bool, the returns that fall into the image."""
        return self.exposure.camera.model.contains(self.pixels)

    @cached_property
    def points(self) -> int:
        """Number of returns that fall into the image."""
        return int(np.count_nonzero(self.inside))

    @property
    def has_enough_returns(self) -> bool:
        """Enough of them fall into the image for the protocol."""
        return self.placed is not None and self.points >= self.settings.min_points

    @property
    def solid(self) -> bool:
        """It cannot be looked through."""
        return self.annotated.track.object_class in SOLID_CLASSES

    @cached_property
    def parts_world(self) -> NDArray[np.float64]:
        """(P, K, 3) float64, m, the annotated shape at exposure, corners of convex bodies, world frame; none for point
        indices."""
        return parts_at_exposure(
            self.annotated.state,
            velocity_world_mps=self.annotated.velocity_world_mps,
            world_from_vehicle=self.annotated.world_from_vehicle,
            exposure_ns=self.exposure.timestamp_ns,
        )

    @property
    def left_out(self) -> bool:
        """Its middle stands in an area that the annotations leave out."""
        if self.left_out_ground.is_empty:
            return False
        corners = (self.parts_world if len(self.parts_world) else self.cluster.points_world).reshape(-1, 3)
        if not len(corners):
            return False
        x_m, y_m, _ = self.exposure.vehicle_from_world.apply(corners.mean(axis=0))
        return bool(shapely.contains_xy(self.left_out_ground, x_m, y_m))

    @cached_property
    def range_m(self) -> float:
        """Horizontal distance of the nearest return from the camera; NaN without returns."""
        away_m = self.cluster.points_world[:, :2] - self.exposure.position_m[:2]
        return float(np.sqrt((away_m * away_m).sum(axis=1).min())) if len(away_m) else float("nan")

    @cached_property
    def distance_m(self) -> float:
        """By which objects occlude each other: `range_m`, else that of the annotated shape (0 below or above it), else
        infinite."""
        if not np.isnan(self.range_m):
            return self.range_m
        if not len(self.parts_world):
            return float("inf")
        grounds = shapely.convex_hull(shapely.linestrings(self.parts_world[..., :2]))
        return float(shapely.distance(grounds, shapely.points(self.exposure.position_m[:2])).min())

    @cached_property
    def points_camera(self) -> NDArray[np.float64]:
        """(N, 3) float64, m, its returns at exposure, camera frame."""
        return self.exposure.camera_from_world.apply(self.cluster.points_world)

    @cached_property
    def points_from_beams(self) -> NDArray[np.float64]:
        """(N, 3) float64, m, its returns from where their beams start, sensor axes at each one's own time."""
        assert self.placed is not None, "only where a sweep has met the object"
        return self.placed.points_from_beams(self.cluster.rows)

    @cached_property
    def world_from_sensor(self) -> RigidTransform:
        """Pose of the sensor when it met the object, by the median of its returns."""
        placed = self.placed
        assert placed is not None, "only where a sweep has met the object"
        interpolated = np.searchsorted(placed.interpolation_ns, np.median(placed.times_ns[self.cluster.rows]))
        at = min(int(interpolated), len(placed.rotations) - 1)
        return RigidTransform(placed.rotations[at], placed.positions_m[at]) @ placed.lidar_from_sensor

    @cached_property
    def grid(self) -> Grid | None:
        """Neighbours of each return; None where there are too few to find them."""
        return None if self.placed is None else self.placed.grid(self.cluster.rows)

    @cached_property
    def patches(self) -> Patches:
        """The surface that each return stands for, where there is a grid."""
        assert self.grid is not None, "patches lie between neighbours"
        rotation, bounds = self.world_from_sensor.rotation, self._bounds(self.grid)
        return surface_patches(self.cluster.points_world, world_from_sensor=rotation, grid=self.grid, bounds=bounds)

    def _bounds(self, grid: Grid) -> Bounds | None:
        if not len(self.parts_world):
            return None
        assert self.placed is not None, "there is a grid"
        (x, y, z), (lowest, highest) = self.points_from_beams.T, self.placed.envelope
        slopes = z / np.maximum(np.hypot(x, y), 1e-9)
        heights_m, half_row = self.parts_world[..., 2], grid.row_step_rad / 2
        bottom_m = float(heights_m.min())
        return Bounds(
            grounded_m=np.where(slopes < lowest.slope + half_row, np.inf, bottom_m + self.settings.ground_clearance_m),
            bottom_m=bottom_m,
            top_m=np.where(slopes > highest.slope - half_row, heights_m.max(), -np.inf),
        )

    @cached_property
    def error_m(self) -> NDArray[np.float64]:
        """(N,) float64, m, how uncertain the outline is near each return but for the spacing of the beams; see
        `outline_error_m`."""
        camera_from_world, errors, placed = self.exposure.camera_from_world, self.settings.outline, self.placed
        assert errors is not None, "only for protocols with unknown bands"
        assert placed is not None, "only where a sweep has met the object"
        velocity_mps = np.nan_to_num(self.annotated.velocity_world_mps)
        speed_mps, limbs = float(np.hypot(*velocity_mps[:2])), errors.limbs.get(self.annotated.track.object_class, ())
        variance_m2 = np.full(len(self.cluster.rows), self._revolution_m2(placed, velocity_mps))
        if limbs and speed_mps:
            times_ns = placed.times_ns[self.cluster.rows] - self.exposure.timestamp_ns
            swung_m = limb_motion_m(limbs, self._heights(), speed_mps=speed_mps, times_ns=times_ns)
            across = cross(normalise(self.points_camera), camera_from_world.rotate(velocity_mps / speed_mps))
            variance_m2 += swung_m**2 * dot(across, across)
        sensor_camera = camera_from_world.apply(self.world_from_sensor.translation_m)
        return outline_error_m(self.points_camera, sensor_camera=sensor_camera, variance_m2=variance_m2, errors=errors)

    def _heights(self) -> NDArray[np.float64]:
        """(N,), of each return above the object's bottom, over the object's height."""
        points_world = self.cluster.points_world
        heights_m = (self.parts_world if len(self.parts_world) else points_world)[..., 2]
        return np.asarray((points_world[:, 2] - heights_m.min()) / np.ptp(heights_m))

    def _revolution_m2(self, placed: PosedSweep, velocity_mps: NDArray[np.float64]) -> float:
        """Variance of what nothing tells of lidars without times of points: when in the revolution was it met? At
        either end the object was elsewhere, seen from the vehicle."""
        sweep, half_ns = placed.sweep, placed.revolution_ns // 2
        if sweep.time_offset_ns is not None:
            return 0.0
        rotations, positions_m, _ = self.exposure.trajectory.at(sweep.timestamp_ns + np.array([-half_ns, half_ns]))
        middle_m = self.cluster.points_world.mean(axis=0)
        centres_m = middle_m + velocity_mps * np.array([[-half_ns], [half_ns]]) / SECOND_NS
        first_m, last_m = np.einsum("nji,nj->ni", rotations, centres_m - positions_m)
        return float(np.nan_to_num(np.square(last_m - first_m).sum()) / 12)

    @cached_property
    def surface(self) -> Surface:
        """Pixels of the surface, and for protocols with unknown bands those that it has at least, at most, for certain.

        One pass over all patches, whatever asks for it.
        """
        if self.grid is None:
            return Surface(likely=np.zeros((0, 0), dtype=bool), corner=np.zeros(2, dtype=np.int64))
        if self.settings.outline is None:
            counts, corner = draw(self.patches.corners, self.exposure)
            return Surface(likely=without_slits(union(counts), solid=self.solid), corner=corner - 1)
        corners, layer = self.patches.layers(self.error_m, solid=self.solid)
        counts, corner = draw(corners, self.exposure, layer)
        likely, least, most = (
            without_slits(union(counts, layers), solid=self.solid) for layers in (LIKELY, LEAST, (Layer.DRAWN_OUT,))
        )
        return Surface(
            likely=likely,
            corner=corner - 1,
            least=self.exposure.crop(least, corner - 1),
            most=self.exposure.crop(most, corner - 1),
            certain=None if self.solid else self.exposure.crop(union(counts, CERTAIN), corner),
        )

    def shadow(self) -> Raster | None:
        """Part of the annotated shape that lies behind its own returns: there the lidar sees nothing, and a camera may.

        Its pixels are those that the middle lines of the outline's patches, across and upright, sweep on their way
        along the beam to the end of the shape. None where no such patch or no shape is known.
        """
        shape = Prism.around(self.parts_world)
        if self.grid is None or shape is None:
            return None
        outermost = (self.grid.neighbours < 0).any(axis=0)
        beams = normalise(self.world_from_sensor.rotate(self.points_from_beams[outermost]))
        _, leave_m = shape.ways_m(self.cluster.points_world[outermost], beams)
        ways = beams * leave_m.clip(0.0)[:, None]
        corners = self.patches.corners.compress(outermost, axis=2)
        if not corners.size:
            return None
        following = np.roll(corners, -1, axis=1)  # above, right, below, left: from corner to corner
        above, right, below, left = np.moveaxis((corners + following) / 2, 1, 0)
        lines = np.concatenate([np.stack([left, right], axis=1), np.stack([above, below], axis=1)], axis=2)
        swept = np.concatenate([lines, lines[:, ::-1] + np.tile(ways.T, 2)[:, None]], axis=1)
        counts, corner = draw(swept, self.exposure)
        return self.exposure.crop(without_slits(union(counts)), corner - 1)

    def unseen(self) -> Raster | None:
        """Part of the annotated shape below the lowest beam or above the highest; None where there is none."""
        assert self.placed is not None, "only where a sweep has met the object"
        camera_from_sensor = self.exposure.camera_from_world @ self.world_from_sensor
        bodies = [
            self.exposure.seen(camera_from_sensor.apply(body))
            for corners in self.world_from_sensor.inverse().apply(self.parts_world)
            for beam, end_m in zip(self.placed.envelope, (corners[:, 2].min(), corners[:, 2].max()), strict=True)
            if len(body := beyond_beam(corners, beam, end_m=end_m))
        ]
        return silhouette(bodies, self.exposure.camera.model) if bodies else None


def beyond_beam(corners: NDArray[np.float64], beam: Beam, *, end_m: float) -> NDArray[np.float64]:
    """Part of an upright convex body between a beam's cone and the body's bottom or top.

    The cone is curved: along a side it is followed in steps of at most `OUTLINE_STEP_M`.

    Args:
        corners: (K, 3) float64, m, of the body, sensor frame.
        beam: the lowest or the highest.
        end_m: m, height of the body's bottom for the lowest beam, of its top for the highest.

    Returns:
        (J, 3) float64, m, points whose convex hull is the part; none where the beam reaches the end everywhere.
    """
    ground = shapely.convex_hull(shapely.multipoints(corners[:, :2]))
    outline_m = shapely.get_coordinates(shapely.segmentize(ground, OUTLINE_STEP_M))
    heights_m = beam.heights_m(np.hypot(*outline_m.T)).clip(corners[:, 2].min(), corners[:, 2].max())
    missed = heights_m != end_m
    end = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(outline_m[missed])))
    cut = np.column_stack([outline_m[missed], heights_m[missed]])
    return np.concatenate([cut, np.column_stack([end, np.full(len(end), end_m)])])

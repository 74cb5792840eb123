"""From the annotations of a recording to the reference of each image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from bench.cameras import ray_grid
from bench.errors import UsageError
from bench.geometry import RigidTransform, cross, dot, normalise
from bench.geometry.raster import Raster, rasterise
from bench.records.recording import ImageRef, MountedCamera, Recording
from bench.records.reference import (
    SURFACE_PATCHES,
    Category,
    IgnoreReason,
    ObjectGeometry,
    Outline,
    OutlineErrors,
    ReferenceFrame,
    ReferenceObject,
    ReferenceSettings,
    Status,
)
from bench.reference.clusters import SECOND_NS, Cluster, object_cluster, parts_at_exposure
from bench.reference.masks import mask_reference
from bench.reference.motion import AnnotationIndex, ObjectAtExposure, categorise, relative_direction
from bench.reference.patches import surface_pixels
from bench.reference.polygons import bounding_polygon, trace_polygon
from bench.reference.regions import (
    Region,
    compose,
    limb_motion_m,
    outline_error_m,
    pixels_per_radian,
    uncertain_region,
    without_band,
)
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import silhouette
from bench.reference.sweeps import PosedSweep, SweepCache

SOLID_CLASSES = ("vehicle",)  # seen through their windows at most, which belong to them


def visible_region(camera: MountedCamera) -> NDArray[np.bool_]:
    """V: pixels inside the lens's field and off the ego vehicle's own body, (H, W) bool."""
    valid = ray_grid(camera.model).valid
    return valid.copy() if camera.ego_body is None else valid & ~camera.ego_body


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Exposure:
    """What all objects of an image share."""

    timestamp_ns: int
    vehicle_from_world: RigidTransform
    camera_from_world: RigidTransform
    camera_position_m: NDArray[np.float64]  # world
    ego_velocity_mps: NDArray[np.float64]  # over the ground, vehicle axes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Measured:
    """One object by itself, before occlusion.

    Attributes:
        reference: without its region.
        region: its pixels inside V; None without a polygon.
        distance_m: what orders the objects; infinite where nothing tells.
    """

    reference: ReferenceObject
    region: Region | None
    distance_m: float


class ReferenceBuilder:
    """Builds the reference of one camera's images, in any order; holds one sweep at a time.

    Args:
        recording: the drive.
        camera: name of the camera.
        settings: of the protocol.
        beside: another builder of the same camera, with which sweeps are shared; None for a builder of its own.
    """

    def __init__(
        self, recording: Recording, camera: str, settings: ReferenceSettings, *, beside: ReferenceBuilder | None = None
    ) -> None:
        self.recording, self.settings = recording, settings
        self.camera = recording.cameras[camera]
        self.valid = visible_region(self.camera)
        self._index = AnnotationIndex(recording, settings)
        self._sweeps: SweepCache = SweepCache(recording, settings.max_sweep_gap_ns)
        if beside is not None and beside.settings.max_sweep_gap_ns == settings.max_sweep_gap_ns:
            self._sweeps = beside._sweeps
        ground_m = float(self.camera.vehicle_from_camera.translation_m[2]) - self.camera.road.height_m
        self._lowest_m = ground_m + settings.ground_clearance_m
        above_shape = settings.clearance_above_shape or settings.polygon_kind == SURFACE_PATCHES
        self._clearance_m = settings.ground_clearance_m if above_shape else 0.0
        self._sweep_interval_ns = _sweep_interval_ns(recording)

    def build(self, image: ImageRef) -> ReferenceFrame:
        """The reference of one image.

        Raises:
            DataError: no ego-motion at the exposure, or a sweep that cannot be read.
        """
        exposure = self._exposure(image.timestamp_ns)
        if image.moving_path is not None:
            return mask_reference(
                image,
                self.camera,
                recording=self.recording.name,
                ego_speed_mps=float(np.hypot(*exposure.ego_velocity_mps[:2])),
                valid=self.valid,
                settings=self.settings,
            )
        found = [self._measure(annotated, exposure) for annotated in self._index.at(image.timestamp_ns)]
        found.sort(key=lambda one: (one.distance_m, one.reference.track_id))  # nearest first
        objects, labels, ignored = compose([(one.reference, one.region) for one in found], self.valid)
        return ReferenceFrame(
            recording=self.recording.name,
            camera=image.camera,
            timestamp_ns=image.timestamp_ns,
            ego_speed_mps=float(np.hypot(*exposure.ego_velocity_mps[:2])),
            objects=objects,
            labels=labels,
            ignored=ignored,
            valid=self.valid,
        )

    def geometry(self, track_id: str, image: ImageRef) -> ObjectGeometry:
        """An object's lidar points and outline at exposure; to look at, not to score.

        Raises:
            UsageError: the image has no such object.
        """
        exposure = self._exposure(image.timestamp_ns)
        found = [s for s in self._index.at(image.timestamp_ns) if s.track.track_id == track_id]
        if not found:
            raise UsageError(f"{image.path}: expected an annotated object {track_id!r}, got an image without it")
        vehicle_from_world = exposure.vehicle_from_world
        cluster, placed = self._cluster(found[0], exposure)
        points_world = cluster.points_world
        pixels, _ = self._projected(points_world, exposure)
        around_world = np.empty((0, 3)) if placed is None else placed.points_world()
        corners = vehicle_from_world.apply(self._parts(found[0], exposure))[..., :2].reshape(-1, 2)
        hull = shapely.MultiPoint(corners).convex_hull
        return ObjectGeometry(
            surroundings_vehicle=vehicle_from_world.apply(around_world),
            cluster_vehicle=vehicle_from_world.apply(points_world),
            outline_m=np.asarray(hull.exterior.coords)[:-1] if isinstance(hull, Polygon) else np.empty((0, 2)),
            pixels=pixels[np.isfinite(pixels[:, 0])],
        )

    def _exposure(self, timestamp_ns: int) -> _Exposure:
        world_from_vehicle = self.recording.trajectory.world_from_vehicle(timestamp_ns)
        world_from_camera = world_from_vehicle @ self.camera.vehicle_from_camera
        return _Exposure(
            timestamp_ns=timestamp_ns,
            vehicle_from_world=world_from_vehicle.inverse(),
            camera_from_world=world_from_camera.inverse(),
            camera_position_m=world_from_camera.translation_m,
            ego_velocity_mps=self.recording.trajectory.velocity_vehicle_mps(timestamp_ns),
        )

    def _measure(self, annotated: ObjectAtExposure, exposure: _Exposure) -> _Measured:
        cluster, placed = self._cluster(annotated, exposure)
        points_world = cluster.points_world
        pixels, inside = self._projected(points_world, exposure)
        points = int(np.count_nonzero(inside))
        distance_m = range_m = _nearest_m(points_world, exposure.camera_position_m)
        if points >= self.settings.min_points and placed is not None:
            scanned = ScannedObject(
                cluster=cluster,
                placed=placed,
                parts_world=self._parts(annotated, exposure),
                clearance_m=self.settings.ground_clearance_m,
            )
            polygon, raster = self._scanned(scanned, pixels, annotated.track.object_class, exposure)
            region = None if raster is None else self._region(raster, scanned, pixels, inside, annotated, exposure)
        else:
            parts_world = self._parts(annotated, exposure)
            polygon, raster = self._annotated(parts_world, exposure, pixels)
            region = None if raster is None else without_band(raster)
            distance_m = _away_m(parts_world, exposure.camera_position_m) if np.isnan(range_m) else range_m
        motion_vehicle = exposure.vehicle_from_world.rotate(annotated.smooth_world_mps)
        known = bool(np.isfinite(motion_vehicle).all())
        reference = ReferenceObject(
            track_id=annotated.track.track_id,
            object_class=annotated.track.object_class,
            status=Status.EVALUATED,
            reason=None,
            category=self._category(annotated, motion_vehicle, exposure),
            direction=relative_direction(motion_vehicle, exposure.ego_velocity_mps) if known else None,
            speed_mps=float(np.hypot(*motion_vehicle[:2])),
            range_m=range_m,
            centroid_m=exposure.vehicle_from_world.apply(_mean(points_world))[:2],
            points=points,
            polygon=polygon,
            polygon_px=0 if raster is None else int(np.count_nonzero(raster.covered)),
            region_px=0,
        )
        return _Measured(
            reference=self._with_status(reference, region, annotated, swept=placed is not None),
            region=region,
            distance_m=np.inf if np.isnan(distance_m) else distance_m,
        )

    def _cluster(self, annotated: ObjectAtExposure, exposure: _Exposure) -> tuple[Cluster, PosedSweep | None]:
        """Lidar points on the object at exposure, and the sweep they come from."""
        placed = self._sweeps.nearest(annotated.state.shape, exposure.timestamp_ns)
        if placed is None:
            return Cluster(points_world=np.empty((0, 3)), rows=np.empty(0, dtype=np.intp)), None
        cluster = object_cluster(
            placed,
            annotated.state,
            velocity_world_mps=annotated.velocity_world_mps,
            world_from_vehicle=annotated.world_from_vehicle,
            exposure_ns=exposure.timestamp_ns,
            lowest_m=self._lowest_m,
            clearance_m=self._clearance_m,
        )
        return cluster, placed

    def _parts(self, annotated: ObjectAtExposure, exposure: _Exposure) -> NDArray[np.float64]:
        """The annotated shape at exposure, (P, K, 3) float64, m, corners of convex bodies, world frame."""
        return parts_at_exposure(
            annotated.state,
            velocity_world_mps=annotated.velocity_world_mps,
            world_from_vehicle=annotated.world_from_vehicle,
            exposure_ns=exposure.timestamp_ns,
        )

    def _annotated(
        self, parts_world: NDArray[np.float64], exposure: _Exposure, pixels: NDArray[np.float64]
    ) -> tuple[Outline | None, Raster | None]:
        """What the image shows of the annotated shape; of an object whose points are named, the hull of these."""
        if not len(parts_world):
            hull = self._polygon(pixels, kind="convex")
            return hull, self._raster(hull)
        window, covered = silhouette(exposure.camera_from_world.apply(parts_world), self.camera.model)
        polygon = trace_polygon(covered, np.array([window[1].start, window[0].start]))
        return polygon, None if polygon is None else Raster(window, covered & self.valid[window])

    def _projected(
        self, points_world: NDArray[np.float64], exposure: _Exposure
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(N, 2) pixels of the points, NaN where the lens cannot see one, and which of them fall into the image."""
        pixels, _ = self.camera.model.project(exposure.camera_from_world.apply(points_world))
        return pixels, self.camera.model.contains(pixels)

    def _scanned(
        self, scanned: ScannedObject, pixels: NDArray[np.float64], object_class: str, exposure: _Exposure
    ) -> tuple[Outline | None, Raster | None]:
        """The polygon of the kind that the protocol asks for, from lidar points, and its pixels in V."""
        if self.settings.polygon_kind == SURFACE_PATCHES:
            covered, corner = self._surface_pixels(scanned.patches_world, exposure, solid=object_class in SOLID_CLASSES)
            if covered.any():
                return trace_polygon(covered, corner), self._in_image(covered, corner)
        kind = "concave" if self.settings.polygon_kind == SURFACE_PATCHES else self.settings.polygon_kind
        polygon = self._polygon(pixels, kind=kind)
        return polygon, self._raster(polygon)

    def _surface_pixels(
        self, patches_world: NDArray[np.float64], exposure: _Exposure, *, solid: bool = False, certain: bool = False
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Pixels of the patches, (4, M, 3), that the lens can see whole; as `surface_pixels`."""
        camera, rays = self.camera.model, exposure.camera_from_world.apply(patches_world)
        corners, valid = camera.project(rays.reshape(-1, 3))
        seen = valid.reshape(4, -1).all(axis=0)
        corners = corners.reshape(4, -1, 2)
        return surface_pixels(
            corners if seen.all() else corners[:, seen],
            width=camera.width,
            height=camera.height,
            solid=solid,
            certain=certain,
        )

    def _in_image(self, covered: NDArray[np.bool_], corner: NDArray[np.int64]) -> Raster:
        """What of a window lies in V; `corner` is the (u, v) of its first pixel, which may lie outside the image."""
        height, width = self.valid.shape
        (u, v), (rows, columns) = corner.tolist(), covered.shape
        top, bottom = (min(max(row, 0), height) for row in (v, v + rows))
        left, right = (min(max(column, 0), width) for column in (u, u + columns))
        window = slice(top, bottom), slice(left, right)
        return Raster(window, covered[top - v : bottom - v, left - u : right - u] & self.valid[window])

    def _region(
        self,
        raster: Raster,
        scanned: ScannedObject,
        pixels: NDArray[np.float64],
        inside: NDArray[np.bool_],
        annotated: ObjectAtExposure,
        exposure: _Exposure,
    ) -> Region:
        """The pixels of a scanned object, for certain and possibly; the same for a protocol without unknown bands."""
        errors, camera, camera_from_world = self.settings.outline, self.camera.model, exposure.camera_from_world
        if errors is None:
            return without_band(raster)
        points_camera, returns_px = camera_from_world.apply(scanned.cluster.points_world), np.rint(pixels[inside])
        returns_px = returns_px.astype(np.intp)
        error_m = outline_error_m(
            points_camera,
            sensor_camera=camera_from_world.apply(scanned.world_from_sensor.translation_m),
            variance_m2=self._unknown_motion_m2(scanned, points_camera, annotated, exposure, errors),
            errors=errors,
        )
        px_per_m = pixels_per_radian(camera)[returns_px[:, 1], returns_px[:, 0]] / _length(points_camera[inside])
        half_width_px = error_m[inside] * px_per_m
        solid = annotated.track.object_class in SOLID_CLASSES
        least = most = raster
        if scanned.grid is None:
            spacing2_px = np.count_nonzero(raster.covered) / max(len(returns_px), 1)
            half_width_px = np.sqrt(half_width_px**2 + spacing2_px / 12)
        else:
            least, most = (
                self._in_image(*self._surface_pixels(patches_world, exposure, solid=solid))
                for patches_world in scanned.certain_and_possible_world(error_m)
            )
        certain = unseen = shadow = None
        if scanned.grid is not None and not solid:
            certain = self._in_image(*self._surface_pixels(scanned.certain_world(), exposure, certain=True))
        if len(unseen_world := scanned.unseen_world()):
            unseen = silhouette(camera_from_world.apply(unseen_world), camera)
        if (shadow_world := scanned.shadow_world()).size:
            shadow = self._in_image(*self._surface_pixels(shadow_world, exposure))
        return uncertain_region(
            raster,
            self.valid,
            least=least,
            most=most,
            returns_px=returns_px,
            half_width_px=half_width_px,
            certain=certain,
            unseen=unseen,
            shadow=shadow,
        )

    def _unknown_motion_m2(
        self,
        scanned: ScannedObject,
        points_camera: NDArray[np.float64],
        annotated: ObjectAtExposure,
        exposure: _Exposure,
        errors: OutlineErrors,
    ) -> NDArray[np.float64]:
        """(N,) float64, m^2: variance of how far each return moved, across its ray, in ways that nothing tells."""
        cluster, placed = scanned.cluster, scanned.placed
        velocity_mps = np.nan_to_num(annotated.velocity_world_mps)
        limbs = errors.limbs.get(annotated.track.object_class, ())
        variance_m2 = np.zeros(len(cluster.rows))
        if limbs and (speed_mps := float(np.hypot(*velocity_mps[:2]))):
            heights_m = (scanned.parts_world if len(scanned.parts_world) else cluster.points_world)[..., 2]
            heights = (cluster.points_world[:, 2] - heights_m.min()) / np.ptp(heights_m)
            times_ns = placed.times_ns[cluster.rows] - exposure.timestamp_ns
            swung_m = limb_motion_m(limbs, heights, speed_mps=speed_mps, times_ns=times_ns)
            across = cross(normalise(points_camera), exposure.camera_from_world.rotate(velocity_mps / speed_mps))
            variance_m2 = swung_m**2 * dot(across, across)
        if placed.sweep.time_offset_ns is not None:
            return variance_m2
        # When in the revolution was it met? At either end the object was elsewhere, seen from the vehicle.
        half_ns = self._sweep_interval_ns // 2
        ends_ns = placed.sweep.timestamp_ns + np.array([-half_ns, half_ns])
        rotations, positions_m, _ = self.recording.trajectory.at(ends_ns)
        centres_m = cluster.points_world.mean(axis=0) + velocity_mps * np.array([[-half_ns], [half_ns]]) / SECOND_NS
        first_m, last_m = np.einsum("nji,nj->ni", rotations, centres_m - positions_m)
        return np.asarray(variance_m2 + np.nan_to_num(np.square(last_m - first_m).sum()) / 12)

    def _polygon(self, pixels: NDArray[np.float64], *, kind: str) -> Polygon | None:
        seen = np.isfinite(pixels[:, 0])
        return bounding_polygon(
            pixels if seen.all() else pixels[seen],
            kind=kind,
            concave_ratio=self.settings.concave_ratio,
            width=self.camera.model.width,
            height=self.camera.model.height,
        )

    def _raster(self, polygon: Outline | None) -> Raster | None:
        """The polygon's pixels inside V."""
        if polygon is None:
            return None
        window, covered = rasterise(polygon, width=self.camera.model.width, height=self.camera.model.height)
        return Raster(window, covered & self.valid[window])

    def _category(
        self, annotated: ObjectAtExposure, motion_vehicle: NDArray[np.float64], exposure: _Exposure
    ) -> Category | None:
        """As annotated, else from velocities; None where neither tells."""
        if annotated.state.category is not None:
            return Category(annotated.state.category)
        if not np.isfinite(motion_vehicle).all():
            return None
        return categorise(motion_vehicle, exposure.ego_velocity_mps, self.settings.motion)

    def _with_status(
        self, found: ReferenceObject, region: Region | None, annotated: ObjectAtExposure, *, swept: bool
    ) -> ReferenceObject:
        """Evaluated, static, or ignored for the first reason that applies; occlusion comes later."""
        settings, state = self.settings, annotated.state
        certain_px = 0 if region is None else int(np.count_nonzero(region.core))
        stationary = state.category is None and not annotated.moving
        if found.category is not None and not state.unclear and stationary:
            return replace(found, status=Status.STATIC, category=None)
        reasons = {
            IgnoreReason.UNCLEAR: state.unclear,
            IgnoreReason.CLASS: found.object_class not in settings.classes,
            IgnoreReason.MOTION_UNKNOWN: found.category is None,
            IgnoreReason.CATEGORY: found.category not in settings.categories,
            IgnoreReason.OUT_OF_VIEW: found.polygon_px == 0,
            IgnoreReason.NO_SWEEP: not swept,
            IgnoreReason.RANGE: found.range_m > settings.range_limit_m,
            IgnoreReason.FEW_POINTS: found.points < settings.min_points,
            IgnoreReason.SMALL_POLYGON: certain_px < settings.min_polygon_px,
        }
        reason = next((reason for reason, applies in reasons.items() if applies), None)
        return found if reason is None else replace(found, status=Status.IGNORED, reason=reason)


def _nearest_m(points_world: NDArray[np.float64], position_m: NDArray[np.float64]) -> float:
    """Horizontal distance of the nearest point; NaN without points."""
    away = points_world[:, :2] - position_m[:2]
    return float(np.sqrt((away * away).sum(axis=1).min())) if len(away) else float("nan")


def _away_m(parts_world: NDArray[np.float64], position_m: NDArray[np.float64]) -> float:
    """Horizontal distance of the nearest of several bodies, 0 below or above one; NaN without any."""
    if not len(parts_world):
        return float("nan")
    grounds = shapely.convex_hull(shapely.linestrings(parts_world[..., :2]))
    return float(shapely.distance(grounds, shapely.points(position_m[:2])).min())


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(dot(vectors, vectors)))


def _mean(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points.sum(axis=0) / len(points)) if len(points) else np.full(3, np.nan)


def _sweep_interval_ns(recording: Recording) -> int:
    """Time of a revolution of the lidar: the usual one between two sweeps; 0 for a single sweep."""
    times_ns = [sweep.timestamp_ns for sweep in recording.sweeps]
    return int(np.median(np.diff(times_ns))) if len(times_ns) > 1 else 0

"""From the annotations of a recording to the reference of each image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from bench.cameras import ray_grid
from bench.errors import UsageError
from bench.geometry import RigidTransform
from bench.recordings.records import ImageRef, MountedCamera, Recording
from bench.reference.clusters import SECOND_NS, Cluster, object_cluster, parts_at_exposure
from bench.reference.masks import mask_reference
from bench.reference.motion import AnnotationIndex, ObjectAtExposure, categorise, relative_direction
from bench.reference.patches import patch_polygon, patch_raster
from bench.reference.polygons import Raster, bounding_polygon, rasterise, trace_polygon
from bench.reference.records import (
    SURFACE_PATCHES,
    Category,
    IgnoreReason,
    ObjectGeometry,
    OutlineErrors,
    ReferenceFrame,
    ReferenceObject,
    ReferenceSettings,
    Status,
)
from bench.reference.regions import Region, compose, limb_motion_m, outline_error_px, uncertain_region, without_band
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
        around_world = np.empty((0, 3)) if placed is None else placed.points_world()
        corners = vehicle_from_world.apply(self._parts(found[0], exposure))[..., :2].reshape(-1, 2)
        hull = shapely.MultiPoint(corners).convex_hull
        return ObjectGeometry(
            surroundings_vehicle=vehicle_from_world.apply(around_world),
            cluster_vehicle=vehicle_from_world.apply(points_world),
            outline_m=np.asarray(hull.exterior.coords)[:-1] if isinstance(hull, Polygon) else np.empty((0, 2)),
            pixels=self._projected(points_world, exposure)[0],
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
        pixels, points = self._projected(points_world, exposure)
        distance_m = range_m = _nearest_m(points_world, exposure.camera_position_m)
        if points >= self.settings.min_points and placed is not None:
            scanned = ScannedObject(cluster=cluster, placed=placed, parts_world=self._parts(annotated, exposure))
            polygon = self._scanned_polygon(scanned, annotated.track.object_class, exposure)
            raster = self._raster(polygon)
            region = None if raster is None else self._region(raster, scanned, annotated, exposure)
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
    ) -> tuple[Polygon | None, Raster | None]:
        """What the image shows of the annotated shape; of an object whose points are named, the hull of these."""
        if not len(parts_world):
            hull = self._polygon(pixels, kind="convex")
            return hull, self._raster(hull)
        window, covered = silhouette(exposure.camera_from_world.apply(parts_world), self.camera.model)
        polygon = trace_polygon(covered, np.array([window[1].start, window[0].start]))
        return polygon, None if polygon is None else Raster(window, covered & self.valid[window])

    def _projected(self, points_world: NDArray[np.float64], exposure: _Exposure) -> tuple[NDArray[np.float64], int]:
        """Pixels of the points that the lens can see, and how many of them fall into the image."""
        pixels, valid = self.camera.model.project(exposure.camera_from_world.apply(points_world))
        inside = int(np.count_nonzero(self.camera.model.contains(pixels)))
        return pixels if valid.all() else pixels[valid], inside

    def _scanned_polygon(self, scanned: ScannedObject, object_class: str, exposure: _Exposure) -> Polygon | None:
        """The polygon of the kind that the protocol asks for, from lidar points."""
        pixels, _ = self._projected(scanned.cluster.points_world, exposure)
        if self.settings.polygon_kind != SURFACE_PATCHES:
            return self._polygon(pixels, kind=self.settings.polygon_kind)
        found = patch_polygon(
            self._corner_pixels(scanned.patches_world(clearance_m=self.settings.ground_clearance_m), exposure),
            width=self.camera.model.width,
            height=self.camera.model.height,
            solid=object_class in SOLID_CLASSES,
        )
        return self._polygon(pixels, kind="concave") if found is None else found

    def _corner_pixels(self, patches_world: NDArray[np.float64], exposure: _Exposure) -> NDArray[np.float64]:
        """(N, 4, 2) float64, px, of the patches, (M, 4, 3), that the lens can see whole."""
        corners, valid = self.camera.model.project(exposure.camera_from_world.apply(patches_world.reshape(-1, 3)))
        seen = valid[0::4] & valid[1::4] & valid[2::4] & valid[3::4]
        return corners.reshape(-1, 4, 2)[seen]

    def _region(
        self, raster: Raster, scanned: ScannedObject, annotated: ObjectAtExposure, exposure: _Exposure
    ) -> Region:
        """The pixels of a scanned object, for certain and possibly; the same for a protocol without unknown bands."""
        errors, camera, camera_from_world = self.settings.outline, self.camera.model, exposure.camera_from_world
        if errors is None:
            return without_band(raster)
        half_width_px = outline_error_px(
            camera_from_world.apply(scanned.cluster.points_world),
            camera_from_world.apply(scanned.world_from_sensor.translation_m),
            unknown_motion_m=self._unknown_motion_m(scanned, annotated, exposure, errors),
            region_px=int(np.count_nonzero(raster.covered)),
            camera=camera,
            errors=errors,
        )
        certain = gaps = unseen = None
        if scanned.grid is not None and annotated.track.object_class not in SOLID_CLASSES:
            clearance_m = self.settings.ground_clearance_m
            certain = self._patch_raster(scanned.patches_world(clearance_m=clearance_m, certain=True), exposure)
            gaps = self._patch_raster(scanned.gaps_world(), exposure)
        if len(unseen_world := scanned.unseen_world()):
            unseen = silhouette(camera_from_world.apply(unseen_world), camera)
        return uncertain_region(
            raster, self.valid, half_width_px=half_width_px, certain=certain, gaps=gaps, unseen=unseen
        )

    def _patch_raster(self, patches_world: NDArray[np.float64], exposure: _Exposure) -> Raster:
        pixels = self._corner_pixels(patches_world, exposure)
        return patch_raster(pixels, width=self.camera.model.width, height=self.camera.model.height)

    def _unknown_motion_m(
        self, scanned: ScannedObject, annotated: ObjectAtExposure, exposure: _Exposure, errors: OutlineErrors
    ) -> NDArray[np.float64]:
        """(N,) float64, m: standard deviation of how far each return moved in ways that nothing tells."""
        cluster, placed = scanned.cluster, scanned.placed
        velocity_mps = np.nan_to_num(annotated.velocity_world_mps)
        limb_mps = errors.limb_speed.get(annotated.track.object_class, 0.0) * float(np.hypot(*velocity_mps[:2]))
        limbs_m = limb_motion_m(limb_mps, placed.times_ns[cluster.rows] - exposure.timestamp_ns)
        if placed.sweep.time_offset_ns is not None:
            return limbs_m
        # When in the revolution was it met? At either end the object was elsewhere, seen from the vehicle.
        half_ns = self._sweep_interval_ns // 2
        ends_ns = placed.sweep.timestamp_ns + np.array([-half_ns, half_ns])
        rotations, positions_m, _ = self.recording.trajectory.at(ends_ns)
        centres_m = cluster.points_world.mean(axis=0) + velocity_mps * np.array([[-half_ns], [half_ns]]) / SECOND_NS
        first_m, last_m = np.einsum("nji,nj->ni", rotations, centres_m - positions_m)
        away_m = float(np.nan_to_num(np.linalg.norm(last_m - first_m)))
        return np.asarray(np.hypot(limbs_m, away_m / sqrt(12)))

    def _polygon(self, pixels: NDArray[np.float64], *, kind: str) -> Polygon | None:
        return bounding_polygon(
            pixels,
            kind=kind,
            concave_ratio=self.settings.concave_ratio,
            width=self.camera.model.width,
            height=self.camera.model.height,
        )

    def _raster(self, polygon: Polygon | None) -> Raster | None:
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


def _mean(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(points.sum(axis=0) / len(points)) if len(points) else np.full(3, np.nan)


def _sweep_interval_ns(recording: Recording) -> int:
    """Time of a revolution of the lidar: the usual one between two sweeps; 0 for a single sweep."""
    times_ns = [sweep.timestamp_ns for sweep in recording.sweeps]
    return int(np.median(np.diff(times_ns))) if len(times_ns) > 1 else 0

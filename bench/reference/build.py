"""From the annotations of a recording to the reference of each image, step by step: see `ReferenceBuilder`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from bench.errors import DataError, UsageError
from bench.recordings.images import read_moving_mask
from bench.records.recording import ImageRef, Recording
from bench.records.reference import (
    UNKNOWN_CLASS,
    Category,
    IgnoreReason,
    ObjectGeometry,
    ReferenceFrame,
    ReferenceObject,
    Status,
    pixels_object,
)
from bench.records.rules import ReferenceSettings
from bench.reference.bands import with_band
from bench.reference.exposure import Exposure, visible_region
from bench.reference.motion import AnnotationIndex, ObjectAtExposure, categorise, relative_direction
from bench.reference.regions import REGION_KINDS, SURFACE_PATCHES, Region, annotated_outline, compose
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import left_out_ground, left_out_pixels
from bench.reference.sweeps import Cluster, SweepCache, object_cluster

MOST_OBJECTS = 10_000  # connected components of a mask; more are noise


class ReferenceBuilder:
    """Builds the reference of one camera's images, in any order; holds one sweep at a time.

    For each annotated object: its motion (`motion`); its returns in the nearest sweep, moved to the exposure
    (`sweeps`); their pixels and surface (`exposure`, `grid`, `patches`, `scanned`); its region (`regions`; `silhouette`
    where returns do not suffice); the unknown band around that (`bands`); its status (below), and what is left of it
    behind nearer objects (`regions.compose`).

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
        self._left_out_ground = left_out_ground(recording.annotated)
        self._left_out = left_out_pixels(recording.annotated, self.camera) & self.valid
        self._annotations = AnnotationIndex(recording, settings)
        self._sweeps = SweepCache(recording, round(settings.max_sweep_gap_ms * 1e6))
        if beside is not None and beside.settings.max_sweep_gap_ms == settings.max_sweep_gap_ms:
            self._sweeps = beside._sweeps

    def build(self, image: ImageRef) -> ReferenceFrame:
        """The reference of one image; where nothing is annotated, all of V is ignored.

        Raises:
            DataError: no ego-motion at the exposure, or a sweep that cannot be read.
        """
        exposure = self._exposure(image)
        if not self.recording.annotated.covers(image.timestamp_ns):
            unlabelled = np.zeros(self.valid.shape, dtype=np.int32)
            return exposure.frame((), unlabelled, self.valid.copy(), annotated=False)
        frame = self._annotated_frame(image, exposure)
        if self._left_out_ground.is_empty:
            return frame
        left_out = self._left_out & (frame.labels == 0) & ~frame.ignored
        return replace(frame, ignored=frame.ignored | left_out, left_out=left_out)

    def _annotated_frame(self, image: ImageRef, exposure: Exposure) -> ReferenceFrame:
        """The reference of an image as if everything that moves were annotated."""
        if image.moving_path is not None:
            return mask_reference(image, exposure, settings=self.settings)
        scanned = [self._scanned(annotated, exposure) for annotated in self._annotations.at(image.timestamp_ns)]
        scanned.sort(key=lambda item: (item.distance_m, item.annotated.track.track_id))  # nearest first
        scanned = without_needless_bands(scanned)
        regions = [self._region(item) for item in scanned]
        objects = [reference_object(item, region) for item, region in zip(scanned, regions, strict=True)]
        return exposure.frame(*compose(objects, regions, self.valid))

    def _exposure(self, image: ImageRef) -> Exposure:
        return Exposure.at(image.timestamp_ns, recording=self.recording, camera=self.camera, valid=self.valid)

    def _scanned(self, annotated: ObjectAtExposure, exposure: Exposure) -> ScannedObject:
        """The object with its returns, moved to where they were at exposure."""
        settings, placed = self.settings, self._sweeps.nearest(annotated.state.shape, exposure.timestamp_ns)
        cluster = Cluster(points_world=np.empty((0, 3)), rows=np.empty(0, dtype=np.intp))
        if placed is not None:
            clears_shape = settings.ground_clearance_above == "shape" or settings.polygon_kind == SURFACE_PATCHES
            cluster = object_cluster(
                placed,
                annotated,
                exposure.timestamp_ns,
                lowest_m=self.camera.ground_m + settings.ground_clearance_m,
                clearance_m=settings.ground_clearance_m if clears_shape else 0.0,
                margin_m=settings.shape_margin_m,
            )
        return ScannedObject(
            annotated=annotated,
            exposure=exposure.of_object(annotated.known_velocity_mps),
            settings=settings,
            cluster=cluster,
            placed=placed,
            left_out_ground=self._left_out_ground,
        )

    def _region(self, scanned: ScannedObject) -> Region | None:
        """The object's pixels: of the protocol's kind where returns suffice, else the annotated outline."""
        if not scanned.has_enough_returns:
            return annotated_outline(scanned)
        region = REGION_KINDS[self.settings.polygon_kind](scanned)
        return region if region is None or scanned.settings.unknown_band is None else with_band(region, scanned)

    def geometry(self, track_id: str, image: ImageRef) -> ObjectGeometry:
        """An object's lidar points and outline at exposure; to look at, not to score.

        Raises:
            UsageError: the image has no such object.
        """
        scanned = self._named(track_id, image)
        vehicle_from_world = scanned.exposure.vehicle_from_world
        around_world = np.empty((0, 3)) if scanned.placed is None else scanned.placed.points_world()
        corners = vehicle_from_world.apply(scanned.parts_world)[..., :2].reshape(-1, 2)
        hull = shapely.MultiPoint(corners).convex_hull
        return ObjectGeometry(
            surroundings_vehicle=vehicle_from_world.apply(around_world),
            cluster_vehicle=vehicle_from_world.apply(scanned.cluster.points_world),
            outline_m=np.asarray(hull.exterior.coords)[:-1] if isinstance(hull, Polygon) else np.empty((0, 2)),
            pixels=scanned.pixels[np.isfinite(scanned.pixels[:, 0])],
        )

    def region(self, track_id: str, image: ImageRef) -> Region | None:
        """An object's pixels, as if nothing hid it; None out of view; to look at, not to score.

        Raises:
            UsageError: the image has no such object.
        """
        return self._region(self._named(track_id, image))

    def _named(self, track_id: str, image: ImageRef) -> ScannedObject:
        for annotated in self._annotations.at(image.timestamp_ns):
            if annotated.track.track_id == track_id:
                return self._scanned(annotated, self._exposure(image))
        raise UsageError(f"{image.path}: expected an annotated object {track_id!r}, got an image without it")


def without_needless_bands(scanned: Sequence[ScannedObject]) -> list[ScannedObject]:
    """The objects of an image, nearest first, without unknown bands for static ones that hide nothing but each other:
    of these only the polygon counts."""
    last = max((number for number, item in enumerate(scanned) if not item.annotated.static), default=-1)
    without = {"unknown_band": None}
    plain = [replace(item, settings=item.settings.model_copy(update=without)) for item in scanned[last + 1 :]]
    return [*scanned[: last + 1], *plain]


def reference_object(scanned: ScannedObject, region: Region | None) -> ReferenceObject:
    """The reference of an object by itself, before occlusion; `region` None where it is out of view."""
    annotated, exposure, points_world = scanned.annotated, scanned.exposure, scanned.cluster.points_world
    motion_vehicle = exposure.vehicle_from_world.rotate(annotated.smooth_world_mps)
    known = bool(np.isfinite(motion_vehicle).all())
    category = None
    if annotated.state.category is not None:
        category = Category(annotated.state.category)
    elif known:
        category = categorise(motion_vehicle, exposure.ego_velocity_mps, scanned.settings.motion)
    status, reason = _status(scanned, region, category)
    centroid = points_world.sum(axis=0) / len(points_world) if len(points_world) else np.full(3, np.nan)
    return ReferenceObject(
        track_id=annotated.track.track_id,
        object_class=annotated.track.object_class,
        status=status,
        reason=reason,
        category=None if status is Status.STATIC else category,
        direction=relative_direction(motion_vehicle, exposure.ego_velocity_mps) if known else None,
        speed_mps=float(np.hypot(*motion_vehicle[:2])),
        range_m=scanned.range_m,
        centroid_m=exposure.vehicle_from_world.apply(centroid)[:2],
        points=scanned.points,
        polygon=None if region is None else region.polygon,
        polygon_px=0 if region is None else region.polygon_px,
        region_px=0,
    )


def _status(
    scanned: ScannedObject, region: Region | None, category: Category | None
) -> tuple[Status, IgnoreReason | None]:
    """Evaluated, static, or ignored for the first reason that applies."""
    annotated, settings = scanned.annotated, scanned.settings
    if annotated.static:
        return Status.STATIC, None
    certain_px = 0 if region is None else int(np.count_nonzero(region.core))
    reasons = {
        IgnoreReason.UNCLEAR: annotated.state.unclear,
        IgnoreReason.CLASS: annotated.track.object_class not in settings.classes,
        IgnoreReason.MOTION_UNKNOWN: category is None,
        IgnoreReason.CATEGORY: category not in settings.categories,
        IgnoreReason.NOT_ANNOTATED: scanned.left_out,
        IgnoreReason.OUT_OF_VIEW: region is None or not region.polygon_px,
        IgnoreReason.NO_SWEEP: scanned.placed is None,
        IgnoreReason.RANGE: scanned.range_m > settings.range_limit_m,
        IgnoreReason.FEW_POINTS: scanned.points < settings.min_points,
        IgnoreReason.SMALL_POLYGON: certain_px < settings.min_polygon_px,
    }
    reason = _first(reasons)
    return (Status.EVALUATED if reason is None else Status.IGNORED), reason


def _first(reasons: Mapping[IgnoreReason, bool]) -> IgnoreReason | None:
    return next((reason for reason, applies in reasons.items() if applies), None)


def mask_reference(image: ImageRef, exposure: Exposure, settings: ReferenceSettings) -> ReferenceFrame:
    """The reference of an image whose data set gives a mask of what moves instead of annotated objects.

    Each connected component of the mask (8-neighbours) is taken for an object: things that touch in the image are one,
    and a thing that is cut in two by another is two. Nothing is known of their range, speed, class and kind of motion:
    the category is "moving", and protocols without it ignore them all.

    Args:
        image: with a mask.
        exposure: of it.
        settings: of the protocol.

    Raises:
        DataError: a mask that cannot be read, of another size, or that is noise.
    """
    moving = read_moving_mask(image, exposure.camera) & exposure.valid
    count, component, stats, _ = cv2.connectedComponentsWithStats(moving.astype(np.uint8), connectivity=8)
    if count - 1 > MOST_OBJECTS:
        expected = f"at most {MOST_OBJECTS} connected components"
        raise DataError(image.moving_path or image.path, expected=expected, got=str(count - 1))
    areas_px = stats[1:, cv2.CC_STAT_AREA]
    objects, labels, ignored = [], np.zeros(moving.shape, dtype=np.int32), np.zeros(moving.shape, dtype=bool)
    for number, row in enumerate(np.argsort(-areas_px, kind="stable"), start=1):  # the largest first
        covered, area_px = component == row + 1, int(areas_px[row])
        reasons = {
            IgnoreReason.CLASS: UNKNOWN_CLASS not in settings.classes,
            IgnoreReason.CATEGORY: Category.MOVING not in settings.categories,
            IgnoreReason.SMALL_POLYGON: area_px < settings.min_polygon_px,
        }
        reason = _first(reasons)
        objects.append(pixels_object(f"component-{number}", area_px, reason=reason, polygon=_border(covered)))
        if reason is None:
            labels[covered] = number
        else:
            ignored |= covered
    return exposure.frame(tuple(objects), labels, ignored)


def _border(covered: NDArray[np.bool_]) -> Polygon | None:
    """The outer border through the centres of its pixels, to draw; None for what has no area."""
    borders, _ = cv2.findContours(covered.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    corners = borders[0][:, 0, :].astype(np.float64)
    return Polygon(corners) if len(corners) >= 3 else None

"""From the annotations of a recording to the reference of each image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import Polygon

from bench.errors import UsageError
from bench.records.recording import ImageRef, Recording
from bench.records.reference import ObjectGeometry, ReferenceFrame, ReferenceSettings
from bench.reference.bands import with_band
from bench.reference.clusters import Cluster, object_cluster
from bench.reference.exposure import Exposure, visible_region
from bench.reference.kinds import ConvexHull, region_kind
from bench.reference.masks import mask_reference
from bench.reference.motion import AnnotationIndex, ObjectAtExposure
from bench.reference.regions import Region, compose, trace_polygon
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import left_out_ground, left_out_pixels, silhouette
from bench.reference.statuses import reference_object
from bench.reference.sweeps import SweepCache


class ReferenceBuilder:
    """Builds the reference of one camera's images, in any order; holds one sweep at a time.

    Args:
        recording: the drive.
        camera: name of the camera.
        settings: of the protocol.
        beside: another builder of the same camera, with which sweeps are shared; None for a builder of its own.

    Raises:
        UnknownNameError: a kind of region that does not exist.
    """

    def __init__(
        self, recording: Recording, camera: str, settings: ReferenceSettings, *, beside: ReferenceBuilder | None = None
    ) -> None:
        self.recording, self.settings = recording, settings
        self.camera = recording.cameras[camera]
        self.valid = visible_region(self.camera)
        self._left_out_ground = left_out_ground(recording.annotated)
        self._left_out = left_out_pixels(recording.annotated, self.camera) & self.valid
        self._kind = region_kind(settings.polygon_kind)
        self._annotations = AnnotationIndex(recording, settings)
        self._sweeps = SweepCache(recording, settings.max_sweep_gap_ns)
        if beside is not None and beside.settings.max_sweep_gap_ns == settings.max_sweep_gap_ns:
            self._sweeps = beside._sweeps
        self._lowest_m = self.camera.ground_m + settings.ground_clearance_m
        clears_shape = settings.clearance_above_shape or self._kind.clears_shape
        self._clearance_m = settings.ground_clearance_m if clears_shape else 0.0

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
        scanned.sort(key=lambda one: (one.distance_m, one.annotated.track.track_id))  # nearest first
        scanned = without_needless_bands(scanned)
        regions = [self._region(one) for one in scanned]
        found = [reference_object(one, region) for one, region in zip(scanned, regions, strict=True)]
        return exposure.frame(*compose(found, regions, self.valid))

    def _exposure(self, image: ImageRef) -> Exposure:
        return Exposure.at(image.timestamp_ns, recording=self.recording, camera=self.camera, valid=self.valid)

    def _scanned(self, annotated: ObjectAtExposure, exposure: Exposure) -> ScannedObject:
        """The object with its returns, moved to where they were at exposure."""
        placed = self._sweeps.nearest(annotated.state.shape, exposure.timestamp_ns)
        cluster = Cluster(points_world=np.empty((0, 3)), rows=np.empty(0, dtype=np.intp))
        if placed is not None:
            cluster = object_cluster(
                placed,
                annotated.state,
                velocity_world_mps=annotated.velocity_world_mps,
                world_from_vehicle=annotated.world_from_vehicle,
                exposure_ns=exposure.timestamp_ns,
                lowest_m=self._lowest_m,
                clearance_m=self._clearance_m,
                margin_m=self.settings.shape_margin_m,
            )
        return ScannedObject(
            annotated=annotated,
            exposure=exposure.of_object(annotated.velocity_world_mps),
            settings=self.settings,
            cluster=cluster,
            placed=placed,
            left_out_ground=self._left_out_ground,
        )

    def _region(self, scanned: ScannedObject) -> Region | None:
        """The object's pixels: of the protocol's kind where returns suffice, else the annotated outline."""
        if not scanned.has_enough_returns:
            return annotated_region(scanned)
        region = self._kind.region(scanned)
        return region if region is None or scanned.settings.outline is None else with_band(region, scanned)

    def geometry(self, track_id: str, image: ImageRef) -> ObjectGeometry:
        """An object's lidar points and outline at exposure; to look at, not to score.

        Raises:
            UsageError: the image has no such object.
        """
        exposure = self._exposure(image)
        scanned, vehicle_from_world = self._named(track_id, image, exposure), exposure.vehicle_from_world
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
        return self._region(self._named(track_id, image, self._exposure(image)))

    def _named(self, track_id: str, image: ImageRef, exposure: Exposure) -> ScannedObject:
        found = [one for one in self._annotations.at(image.timestamp_ns) if one.track.track_id == track_id]
        if not found:
            raise UsageError(f"{image.path}: expected an annotated object {track_id!r}, got an image without it")
        return self._scanned(found[0], exposure)


def without_needless_bands(scanned: Sequence[ScannedObject]) -> list[ScannedObject]:
    """The objects of an image, nearest first, without unknown bands for static ones that hide nothing but each other:
    of these only the polygon counts."""
    last = max((number for number, one in enumerate(scanned) if not one.annotated.static), default=-1)
    plain = [replace(one, settings=replace(one.settings, outline=None)) for one in scanned[last + 1 :]]
    return [*scanned[: last + 1], *plain]


def annotated_region(scanned: ScannedObject) -> Region | None:
    """Return the region that shows the annotated shape; of an object whose points are named, the hull of these."""
    if not len(scanned.parts_world):
        return ConvexHull().region(scanned)
    exposure = scanned.exposure
    raster = silhouette(exposure.seen(exposure.camera_from_world.apply(scanned.parts_world)), exposure.camera.model)
    rows, columns = raster.window
    polygon = trace_polygon(raster.covered, np.array([columns.start, rows.start]))
    return None if polygon is None else Region.of(polygon, exposure.in_valid(raster))

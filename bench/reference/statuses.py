"""Status of an annotated object before occlusion: evaluated, static, or ignored and why."""

from __future__ import annotations

import numpy as np

from bench.records.reference import Category, IgnoreReason, ReferenceObject, Status
from bench.reference.motion import categorise, relative_direction
from bench.reference.regions import Region
from bench.reference.scanned import ScannedObject


def reference_object(scanned: ScannedObject, region: Region | None) -> ReferenceObject:
    """Return the reference of an object by itself.

    Args:
        scanned: the object.
        region: its pixels; None where it is out of view.
    """
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
    reason = next((reason for reason, applies in reasons.items() if applies), None)
    return (Status.EVALUATED, None) if reason is None else (Status.IGNORED, reason)

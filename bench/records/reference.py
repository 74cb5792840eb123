"""Reference of one image."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

Outline: TypeAlias = Polygon | MultiPolygon  # of several parts where the lidar sees an object in several
# The strategies are in `bench.reference.regions`.
RegionKindName = Literal["convex", "concave", "surface-patches"]
ObjectClass = Literal["pedestrian", "cyclist", "vehicle", "animal"]
OBJECT_CLASSES: tuple[str, ...] = get_args(ObjectClass)
UNKNOWN_CLASS = "unknown"  # of an object of which only pixels are known


class Status(StrEnum):
    """Outcome of an annotated object; exactly one of the three."""

    EVALUATED = "evaluated"
    IGNORED = "ignored"
    STATIC = "static"


class Category(StrEnum):
    """Kind of motion, in the order of the paper's table; then motion of which the data set does not tell the kind."""

    CROSSING = "crossing"
    OVERTAKING = "overtaking"
    PRECEDING = "preceding"
    APPROACHING = "approaching"
    STATIC_EGO = "static_ego"
    MOVING = "moving"


class Direction(StrEnum):
    """Direction of the motion relative to the ego vehicle, for the range maps."""

    LATERAL = "lateral"
    LONGITUDINAL = "longitudinal"


class IgnoreReason(StrEnum):
    """Reason why a moving object is not evaluated; the first that applies, in this order."""

    UNCLEAR = "unclear"
    CLASS = "class_not_in_protocol"
    MOTION_UNKNOWN = "motion_unknown"
    CATEGORY = "category_not_in_protocol"
    NOT_ANNOTATED = "area_not_annotated"
    OUT_OF_VIEW = "out_of_view"
    NO_SWEEP = "no_sweep"
    RANGE = "beyond_range"
    FEW_POINTS = "too_few_points"
    SMALL_POLYGON = "polygon_too_small"
    OCCLUDED = "occluded"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceObject:
    """One annotated object in one image.

    Attributes:
        track_id: of the object.
        object_class: of the object.
        status: evaluated, ignored or static.
        reason: why it is ignored; None unless ignored.
        category: kind of motion; None where static or unknown.
        direction: of the relative motion; None where unknown.
        speed_mps: over the ground; NaN where unknown.
        range_m: horizontal distance of the nearest lidar point from the camera; NaN without points.
        centroid_m: (2,) float64, x and y of the cluster's centroid, vehicle frame at exposure, m; NaN without points.
        points: lidar points on the object that fall into the image.
        polygon: in pixels (u, v) of the evaluated image, may reach beyond its border. From lidar points where they
            suffice, else the outline of the annotated shape, which is only ever ignored; None where the object is
            out of view.
        polygon_px: pixels of the polygon inside V before occlusion.
        region_px: |G_i|, after occlusion; 0 unless evaluated.
        unknown_px: pixels beside G_i that may be the object's, after occlusion; 0 unless evaluated by a protocol with
            an unknown band.
    """

    track_id: str
    object_class: str
    status: Status
    reason: IgnoreReason | None
    category: Category | None
    direction: Direction | None
    speed_mps: float
    range_m: float
    centroid_m: NDArray[np.float64]
    points: int
    polygon: Outline | None
    polygon_px: int
    region_px: int
    unknown_px: int = 0


def pixels_object(
    track_id: str, area_px: int, *, reason: IgnoreReason | None, polygon: Polygon | None = None
) -> ReferenceObject:
    """An object of which nothing is known but its pixels.

    Args:
        track_id: of the object.
        area_px: its pixels in V.
        reason: why it is ignored; None to evaluate it.
        polygon: its outline, in pixels (u, v).
    """
    return ReferenceObject(
        track_id=track_id,
        object_class=UNKNOWN_CLASS,
        status=Status.EVALUATED if reason is None else Status.IGNORED,
        reason=reason,
        category=Category.MOVING,
        direction=None,
        speed_mps=float("nan"),
        range_m=float("nan"),
        centroid_m=np.full(2, np.nan),
        points=0,
        polygon=polygon,
        polygon_px=area_px,
        region_px=area_px if reason is None else 0,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceFrame:
    """The reference of one image, ready to be scored against.

    Attributes:
        recording: name.
        camera: name.
        timestamp_ns: exposure.
        ego_speed_mps: over the ground, >= 0.
        objects: nearest first, ties by track id; every annotated object of the frame once.
        labels: (H, W) int32; k + 1 where the pixel belongs to G of `objects[k]`, 0 elsewhere.
        ignored: (H, W) bool; the region I, unknown bands and areas that are not annotated among it.
        unknown: (H, W) bool; of I the unknown bands of evaluated objects.
        left_out: (H, W) bool; of I what is neither an object's nor a band, but lies in an area that is not annotated.
        valid: (H, W) bool; the region V.
        annotated: False where nobody knows what moves in the image: it is not scored, and I is all of V.
    """

    recording: str
    camera: str
    timestamp_ns: int
    ego_speed_mps: float
    objects: tuple[ReferenceObject, ...]
    labels: NDArray[np.int32]
    ignored: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    left_out: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    annotated: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectGeometry:
    """An object and its surroundings at exposure, to look at.

    Attributes:
        surroundings_vehicle: (N, 3) float64, m, the whole sweep motion-compensated, vehicle frame.
        cluster_vehicle: (K, 3) float64, m, the points on the object, vehicle frame.
        outline_m: (M, 2) float64, m, the annotated shape from above, vehicle frame, not closed; empty for point
            indices.
        pixels: (K', 2) float64, px, the cluster as far as the lens can see it.
    """

    surroundings_vehicle: NDArray[np.float64]
    cluster_vehicle: NDArray[np.float64]
    outline_m: NDArray[np.float64]
    pixels: NDArray[np.float64]

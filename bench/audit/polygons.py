"""Fit of reference polygons to the exact masks, also with other motion compensation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, binary_fill_holes, distance_transform_edt, find_objects
from scipy.spatial.transform import Rotation

from bench.evaluation.rows import IMAGE, IMAGE_COLUMNS, Row
from bench.recordings import ImageRef, Recording, Track
from bench.records.reference import Category, ReferenceFrame, Status
from bench.records.rules import ReferenceSettings
from bench.reference.build import ReferenceBuilder
from bench.reference.regions import REGION_KINDS


class Compensation(StrEnum):
    """Part of the motion between a lidar point and the exposure that is compensated."""

    NONE = "none"  # the sweep is taken for a snapshot at exposure
    EGO_MOTION = "ego_motion"  # every point is compensated for the ego-motion
    FULL = "full"  # and moved with its object: what the benchmark does


def with_compensation(recording: Recording, compensation: Compensation) -> Recording:
    """A recording whose reference is built with that much compensation and nothing else changed.

    The reference builder takes ego-motion and the objects' velocities from the recording: without the one the ego
    vehicle is stationary, without the other the objects are. Every object of a changed recording is annotated as
    moving, since velocities no longer tell; who is evaluated is decided by the unchanged one.
    """
    if compensation is Compensation.FULL:
        return recording
    tracks = tuple(_stationary(track) for track in recording.tracks)
    if compensation is Compensation.EGO_MOTION:
        return replace(recording, tracks=tracks)
    driven = recording.trajectory
    ends_ns = driven.timestamps_ns[[0, -1]]
    stationary = replace(
        driven,
        timestamps_ns=ends_ns,
        rotations=Rotation.identity(2),
        positions_m=np.zeros((2, 3)),
        max_gap_ns=int(ends_ns[1] - ends_ns[0]),
    )
    return replace(recording, tracks=tracks, trajectory=stationary)


def _stationary(track: Track) -> Track:
    states = (
        replace(s, velocity_mps=np.zeros(3), yaw_rate_radps=0.0, category=s.category or Category.CROSSING.value)
        for s in track.states
    )
    return replace(track, states=tuple(states))


Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionFit:
    """A region against a mask; both hold at least one pixel.

    Attributes:
        iou: |region n mask| / |region u mask|.
        area_error: (|region| - |mask|) / |mask|: positive for a region that is too large.
        boundary_px: mean distance from the outline of either to the outline of the other, px.
        solid: |mask| / |mask with its holes filled|, such as those between the spokes of a wheel: about the best IoU
            that a polygon without holes can reach.
    """

    iou: float
    area_error: float
    boundary_px: float
    solid: float


def region_fit(region: Mask, mask: Mask) -> RegionFit:
    """Compare a region with a mask.

    Args:
        region: (H, W) bool, not empty.
        mask: (H, W) bool, not empty.
    """
    (window,) = find_objects((region | mask).astype(np.uint8))
    region, mask = region[window], mask[window]
    both, size, covered = np.count_nonzero(region & mask), np.count_nonzero(mask), np.count_nonzero(region)
    assert size, "the object is seen"
    assert covered, "the object has a region"
    return RegionFit(
        iou=both / (size + covered - both),
        area_error=(covered - size) / size,
        boundary_px=_outline_distance_px(region, mask),
        solid=size / np.count_nonzero(binary_fill_holes(mask)),
    )


def _outline_distance_px(first: Mask, second: Mask) -> float:
    # By SciPy: OpenCV's distances depend on where the mask lies in memory, in the last digit.
    outlines = [mask & ~binary_erosion(mask) for mask in (first, second)]  # with a 4-neighbour outside of it
    there, back = (distance_transform_edt(~outlines[k])[outlines[1 - k]].mean() for k in (1, 0))
    return float((there + back) / 2)


FIT = tuple(measure.name for measure in fields(RegionFit))
# What the protocol's reference says of an object, the same for all kinds of polygon.
DESCRIPTION = ("track_id", "object_class", "category", "range_m", "speed_mps", "points")

# One row per evaluated object-frame, kind and compensation that gave a polygon; ratios as in `RegionFit`.
POLYGONS_SCHEMA = pa.schema(
    [
        *IMAGE_COLUMNS,
        *[(name, pa.string()) for name in ("track_id", "object_class", "category", "kind", "compensation")],
        *[(name, pa.float64()) for name in ("range_m", "speed_mps")],
        *[(name, pa.int64()) for name in ("points", "mask_px", "region_px")],
        *[(name, pa.float64()) for name in FIT],
    ]
)


class PolygonAuditor:
    """Builds the polygons of one camera in every way and compares them with the masks.

    Args:
        recording: as the benchmark reads it.
        camera: name of the camera.
        settings: of the protocol.
    """

    def __init__(self, recording: Recording, camera: str, settings: ReferenceSettings) -> None:
        self._builders = {
            (kind, compensation): ReferenceBuilder(
                with_compensation(recording, compensation), camera, lenient(settings, kind)
            )
            for compensation in Compensation
            for kind in REGION_KINDS
        }

    def rows(
        self, image: ImageRef, evaluated: ReferenceFrame, ids: NDArray[np.uint16], instance_of: Mapping[str, int]
    ) -> list[Row]:
        """Rows of `POLYGONS_SCHEMA` for the objects that the protocol evaluates and that the camera sees.

        Args:
            image: which.
            evaluated: the reference of the protocol, which decides who is evaluated.
            ids: (H, W) uint16, the image's true instance ids.
            instance_of: instance id by track.
        """
        described = {item.track_id: item for item in evaluated.objects if item.status is Status.EVALUATED}
        masks = {track_id: (ids == instance_of[track_id]) & evaluated.valid for track_id in described}
        rows: list[Row] = []
        for (kind, compensation), builder in self._builders.items():
            built = builder.build(image)
            for number, target in enumerate(built.objects, start=1):
                mask = masks.get(target.track_id)
                if mask is None or target.status is not Status.EVALUATED or not mask.any():
                    continue
                region = built.labels == number
                fit = region_fit(region, mask)
                rows.append(
                    {name: getattr(evaluated, name) for name in IMAGE}
                    | {name: getattr(described[target.track_id], name) for name in DESCRIPTION}
                    | {"kind": kind, "compensation": compensation.value}
                    | {"mask_px": np.count_nonzero(mask), "region_px": np.count_nonzero(region)}
                    | {name: getattr(fit, name) for name in FIT}
                )
        return rows


def lenient(settings: ReferenceSettings, kind: str) -> ReferenceSettings:
    """Settings that give every object that has points its polygon of a kind; who counts is decided elsewhere."""
    changes = {"polygon_kind": kind, "range_limit_m": math.inf, "min_polygon_px": 1, "categories": tuple(Category)}
    return settings.model_copy(update=changes | {"unknown_band": None})  # the region itself is compared, not its core

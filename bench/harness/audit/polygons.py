"""Every kind of reference polygon, under every compensation, against the exact masks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.protocol import ReferenceRules
from bench.harness.audit.compensation import Compensation, with_compensation
from bench.harness.audit.polygon_fit import region_fit
from bench.recordings import ImageRef, Recording
from bench.reference import Category, ReferenceBuilder, ReferenceFrame, ReferenceSettings, Status

Row = dict[str, Any]
FIT = ("iou", "area_error", "missing", "surplus", "boundary_px", "centroid_px", "filled_iou", "solid")
POLYGON_KINDS: tuple[str, ...] = get_args(ReferenceRules.model_fields["polygon_kind"].annotation)

# One row per evaluated object-frame, kind and compensation that gave a polygon; ratios as in `RegionFit`.
POLYGONS_SCHEMA = pa.schema(
    [
        *[(name, pa.string()) for name in ("recording", "camera")],
        ("timestamp_ns", pa.int64()),
        *[(name, pa.string()) for name in ("track_id", "object_class", "category", "kind", "compensation")],
        *[(name, pa.float64()) for name in ("range_m", "x_m", "y_m")],
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
            for kind in POLYGON_KINDS
        }

    def rows(
        self,
        image: ImageRef,
        evaluated: ReferenceFrame,
        ids: NDArray[np.uint16],
        instance_of: Mapping[str, int],
    ) -> list[Row]:
        """Rows of `POLYGONS_SCHEMA` for the objects that the protocol evaluates and that the camera sees.

        Args:
            image: which.
            evaluated: the reference of the protocol, which decides who is evaluated.
            ids: (H, W) uint16, the image's true instance ids.
            instance_of: instance id by track.
        """
        masks = {
            item.track_id: (ids == instance_of[item.track_id]) & evaluated.valid
            for item in evaluated.objects
            if item.status is Status.EVALUATED
        }
        rows: list[Row] = []
        for (kind, compensation), builder in self._builders.items():
            built = builder.build(image)
            for number, found in enumerate(built.objects, start=1):
                mask = masks.get(found.track_id)
                if mask is None or found.status is not Status.EVALUATED or not mask.any():
                    continue
                rows.append(
                    {"kind": kind, "compensation": compensation.value}
                    | _fit_columns(built.labels == number, mask)
                    | {"track_id": found.track_id}
                )
        return [_described(row, evaluated) for row in rows]


def lenient(settings: ReferenceSettings, kind: str) -> ReferenceSettings:
    """Settings that give every object that has points its polygon of a kind; who counts is decided elsewhere."""
    return replace(settings, polygon_kind=kind, range_limit_m=math.inf, min_polygon_px=1, categories=tuple(Category))


def _fit_columns(region: NDArray[np.bool_], mask: NDArray[np.bool_]) -> Row:
    fit = region_fit(region, mask)
    sizes = {"mask_px": int(np.count_nonzero(mask)), "region_px": int(np.count_nonzero(region))}
    return sizes | {name: getattr(fit, name) for name in FIT}


def _described(row: Row, evaluated: ReferenceFrame) -> Row:
    """The row with what the protocol's reference says of the object, the same for all kinds."""
    found = next(item for item in evaluated.objects if item.track_id == row["track_id"])
    return row | {
        "recording": evaluated.recording,
        "camera": evaluated.camera,
        "timestamp_ns": evaluated.timestamp_ns,
        "object_class": found.object_class,
        "category": None if found.category is None else found.category.value,
        "range_m": found.range_m,
        "x_m": float(found.centroid_m[0]),
        "y_m": float(found.centroid_m[1]),
        "points": found.points,
    }

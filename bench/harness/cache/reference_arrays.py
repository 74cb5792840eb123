"""The reference of an image <-> arrays."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from bench.harness.cache.folder import Arrays
from bench.records.reference import Category, Direction, IgnoreReason, Outline, ReferenceObject, Status
from bench.reference import ReferenceFrame

WORDS: dict[str, type[Any]] = {
    "status": Status,
    "reason": IgnoreReason,
    "category": Category,
    "direction": Direction,
}
APART = ("polygon", "centroid_m")
PLAIN = tuple(field.name for field in fields(ReferenceObject) if field.name not in APART)


def reference_arrays(frame: ReferenceFrame) -> Arrays:
    """A reference as arrays; without what the reader knows: recording, camera, time, V and whether it is annotated."""
    objects = [{name: getattr(item, name) for name in PLAIN} for item in frame.objects]
    outlines = [b"" if item.polygon is None else item.polygon.wkb for item in frame.objects]
    return {
        "ego_speed_mps": np.array([frame.ego_speed_mps], dtype=np.float64),
        "objects": np.frombuffer(json.dumps(objects).encode(), dtype=np.uint8),
        "centroids_m": np.array([item.centroid_m for item in frame.objects], dtype=np.float64).reshape(-1, 2),
        "outline_bytes": np.array([len(outline) for outline in outlines], dtype=np.int64),
        "outlines": np.frombuffer(b"".join(outlines), dtype=np.uint8),
        "labels": _packed(frame.labels.astype(np.uint16)),
        "ignored": _packed(frame.ignored.view(np.uint8)),
    }


def reference_from_arrays(
    arrays: Arrays, *, recording: str, camera: str, timestamp_ns: int, valid: NDArray[np.bool_], annotated: bool
) -> ReferenceFrame:
    """The reference again, equal in every value.

    Args:
        arrays: from `reference_arrays`.
        recording: name.
        camera: name.
        timestamp_ns: exposure.
        valid: (H, W) bool, the region V.
        annotated: of the image.
    """
    ends = np.cumsum(arrays["outline_bytes"]).tolist()
    content = arrays["outlines"].tobytes()
    outlines = [content[first:last] for first, last in zip([0, *ends[:-1]], ends, strict=True)] if ends else []
    objects = tuple(
        ReferenceObject(
            **{name: WORDS[name](value) if name in WORDS and value is not None else value
               for name, value in item.items()},
            polygon=_polygon(outline),
            centroid_m=centroid_m,
        )
        for item, outline, centroid_m in zip(
            json.loads(arrays["objects"].tobytes()), outlines, arrays["centroids_m"], strict=True
        )
    )  # fmt: skip
    return ReferenceFrame(
        recording=recording,
        camera=camera,
        timestamp_ns=timestamp_ns,
        ego_speed_mps=float(arrays["ego_speed_mps"][0]),
        objects=objects,
        labels=_unpacked(arrays["labels"]).astype(np.int32),
        ignored=_unpacked(arrays["ignored"]).view(np.bool_),
        valid=valid,
        annotated=annotated,
    )


def _polygon(outline: bytes) -> Outline | None:
    if not outline:
        return None
    polygon = shapely.from_wkb(outline)
    assert isinstance(polygon, Outline), "only polygons are stored"
    return polygon


def _packed(image: NDArray[Any]) -> NDArray[np.uint8]:
    done, content = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    assert done, "an array of two dimensions can be a PNG"
    return np.asarray(content, dtype=np.uint8).ravel()


def _unpacked(content: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_UNCHANGED))

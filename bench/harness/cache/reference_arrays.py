"""The reference of an image <-> arrays."""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import fields
from typing import Any

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
    moving = frame.labels > 0
    return {
        "ego_speed_mps": np.array([frame.ego_speed_mps], dtype=np.float64),
        "objects": np.frombuffer(json.dumps(objects).encode(), dtype=np.uint8),
        "centroids_m": np.array([item.centroid_m for item in frame.objects], dtype=np.float64).reshape(-1, 2),
        "outline_bytes": np.array([len(outline) for outline in outlines], dtype=np.int64),
        "outlines": np.frombuffer(b"".join(outlines), dtype=np.uint8),
        "moving": _packed(moving),
        "labels": frame.labels[moving],
        "ignored": _packed(frame.ignored),
        "unknown": _packed(frame.unknown),
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
    labels = np.zeros(valid.shape, dtype=np.int32)
    labels[_unpacked(arrays["moving"], valid.shape)] = arrays["labels"]
    return ReferenceFrame(
        recording=recording,
        camera=camera,
        timestamp_ns=timestamp_ns,
        ego_speed_mps=float(arrays["ego_speed_mps"][0]),
        objects=objects,
        labels=labels,
        ignored=_unpacked(arrays["ignored"], valid.shape),
        unknown=_unpacked(arrays["unknown"], valid.shape),
        valid=valid,
        annotated=annotated,
    )


def _polygon(outline: bytes) -> Outline | None:
    if not outline:
        return None
    polygon = shapely.from_wkb(outline)
    assert isinstance(polygon, Outline), "only polygons are stored"
    return polygon


def _packed(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return np.frombuffer(zlib.compress(np.packbits(mask).tobytes(), 1), dtype=np.uint8)


def _unpacked(content: NDArray[Any], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    bits = np.frombuffer(zlib.decompress(content.tobytes()), dtype=np.uint8)
    return np.unpackbits(bits, count=math.prod(shape)).reshape(shape).view(np.bool_)

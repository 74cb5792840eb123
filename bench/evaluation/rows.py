"""The two tables of a run: one row per annotated object in an image, one row per image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import pyarrow as pa

from bench.evaluation.counts import FrameCounts, ObjectCounts
from bench.evaluation.likelihood import OUTSIDE_COLUMN, REFERENCE_COLUMN, LikelihoodCounts
from bench.records.reference import ReferenceFrame, ReferenceObject, Status

Row = dict[str, Any]

_IMAGE_KEY = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]

# One row per annotated object per image, whatever its status. `tp`, `fn`, `fp`, `region_px` and `unknown_px` (pixels
# beside the region that may be the object's) are 0 unless evaluated; `unknown_px` is null in tables of older versions.
# `ceiling_tp` and `ceiling_fp` are what the exact masks would have got; null unless evaluated and without exact masks.
# `chance_tp` is null unless evaluated and where the recording is too short for another mask. Unknown speeds and places
# are NaN, categories, directions and reasons that do not apply are null.
OBJECTS_SCHEMA = pa.schema(
    [
        *_IMAGE_KEY,
        ("track_id", pa.string()),
        ("object_class", pa.string()),
        ("status", pa.string()),
        ("reason", pa.string()),
        ("category", pa.string()),
        ("direction", pa.string()),
        ("range_m", pa.float64()),
        ("x_m", pa.float64()),
        ("y_m", pa.float64()),
        ("speed_mps", pa.float64()),
        ("ego_speed_mps", pa.float64()),
        ("points", pa.int64()),
        ("polygon_px", pa.int64()),
        ("region_px", pa.int64()),
        ("tp", pa.int64()),
        ("fn", pa.int64()),
        ("fp", pa.int64()),
        ("chance_tp", pa.int64()),
        ("unknown_px", pa.int64()),
        ("ceiling_tp", pa.int64()),
        ("ceiling_fp", pa.int64()),
    ]
)

_FRAME_COUNTS = (
    "width",
    "height",
    "valid_px",
    "reference_px",
    "ignored_px",
    "detected_px",
    "tp_px",
    "fn_px",
    "fp_px",
    "fp_unattached_px",
    "fp_components",
    "fp_large_components",
    "fp_largest_px",
)

# One row per image. All counts are 0 unless evaluated; `fp_by_cause` is empty for a method that names no causes. The
# histograms over `bench.evaluation.likelihood.EDGES` are null unless evaluated and where the method has no likelihood.
FRAMES_SCHEMA = pa.schema(
    [
        *_IMAGE_KEY,
        ("ego_speed_mps", pa.float64()),
        ("status", pa.string()),
        ("problem", pa.string()),
        *[(name, pa.int64()) for name in _FRAME_COUNTS],
        ("undefined_px", pa.int64()),
        ("fp_by_cause", pa.map_(pa.string(), pa.int64())),
        (REFERENCE_COLUMN, pa.list_(pa.int64())),
        (OUTSIDE_COLUMN, pa.list_(pa.int64())),
    ]
)


def object_rows(
    reference: ReferenceFrame, counts: Sequence[ObjectCounts], *, ceiling: Sequence[ObjectCounts] | None = None
) -> list[Row]:
    """Rows of `OBJECTS_SCHEMA`, in the order of `reference.objects`; `chance_tp` is still null.

    Args:
        reference: of the image.
        counts: one per object.
        ceiling: the same of the exact masks; None where nobody knows them.
    """
    image = _image_key(reference) | {"ego_speed_mps": reference.ego_speed_mps, "chance_tp": None}
    rows = [image | _object_row(item, count) for item, count in zip(reference.objects, counts, strict=True)]
    for number, row in enumerate(rows):
        evaluated = row["status"] == Status.EVALUATED.value
        best = ceiling[number] if ceiling is not None and evaluated else None
        row["ceiling_tp"], row["ceiling_fp"] = (None, None) if best is None else (best.tp, best.fp)
    return rows


def frame_row(
    reference: ReferenceFrame, counts: FrameCounts, *, undefined_px: int, likelihood: LikelihoodCounts | None = None
) -> Row:
    """The row of `FRAMES_SCHEMA` of an image that was scored."""
    row = _image_key(reference) | {"ego_speed_mps": reference.ego_speed_mps, "status": "evaluated", "problem": None}
    row |= {name: getattr(counts, name) for name in _FRAME_COUNTS}
    row |= {"undefined_px": undefined_px, "fp_by_cause": sorted(counts.fp_by_cause.items())}
    return row | {
        REFERENCE_COLUMN: None if likelihood is None else likelihood.reference_px,
        OUTSIDE_COLUMN: None if likelihood is None else likelihood.outside_px,
    }


def unscored_frame_row(
    *, recording: str, camera: str, timestamp_ns: int, status: Literal["failed", "skipped"], problem: str
) -> Row:
    """The row of `FRAMES_SCHEMA` of an image that could not be scored, with the reason in words."""
    row: Row = {"recording": recording, "camera": camera, "timestamp_ns": timestamp_ns, "ego_speed_mps": math.nan}
    row |= {"status": status, "problem": problem} | dict.fromkeys(_FRAME_COUNTS, 0)
    return row | {"undefined_px": 0, "fp_by_cause": [], REFERENCE_COLUMN: None, OUTSIDE_COLUMN: None}


def objects_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`objects.parquet`."""
    return pa.Table.from_pylist(list(rows), schema=OBJECTS_SCHEMA)


def frames_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`frames.parquet`."""
    return pa.Table.from_pylist(list(rows), schema=FRAMES_SCHEMA)


def _image_key(reference: ReferenceFrame) -> Row:
    return {
        "recording": reference.recording,
        "camera": reference.camera,
        "timestamp_ns": reference.timestamp_ns,
    }


def _object_row(item: ReferenceObject, counts: ObjectCounts) -> Row:
    return {
        "track_id": item.track_id,
        "object_class": item.object_class,
        "status": item.status.value,
        "reason": None if item.reason is None else item.reason.value,
        "category": None if item.category is None else item.category.value,
        "direction": None if item.direction is None else item.direction.value,
        "range_m": item.range_m,
        "x_m": float(item.centroid_m[0]),
        "y_m": float(item.centroid_m[1]),
        "speed_mps": item.speed_mps,
        "points": item.points,
        "polygon_px": item.polygon_px,
        "region_px": counts.tp + counts.fn,
        "unknown_px": item.unknown_px,
        "tp": counts.tp,
        "fn": counts.fn,
        "fp": counts.fp,
    }

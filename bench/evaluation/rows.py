"""The two tables of a run: one row per annotated object in an image, one row per image.

On disk they are `pyarrow` tables of these schemas, in memory data frames of pandas. No metric needs rows of two
recordings at once: what would not fit into memory is read in parts of whole recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import fields
from typing import Any

import pandas as pd
import pyarrow as pa

from bench.evaluation.counts import OUTSIDE_COLUMN, REFERENCE_COLUMN, FrameCounts, ObjectCounts

Row = dict[str, Any]

IMAGE = ["recording", "camera", "timestamp_ns"]
OBJECT = [*IMAGE, "track_id"]
EVALUATED, NOT_ANNOTATED = "evaluated", "not_annotated"
IMAGE_STATUSES = (EVALUATED, "failed", "skipped", NOT_ANNOTATED)
IMAGE_COLUMNS = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]


def _schema(columns: Iterable[tuple[str, pa.DataType]], *, nullable: Set[str]) -> pa.Schema:
    return pa.schema([pa.field(name, kind, nullable=name in nullable) for name, kind in columns])


# One row per annotated object per image, whatever its status. The counts, `region_px` and `unknown_px` (pixels
# beside the region that may be the object's) are 0 unless evaluated.
# `ceiling_tp` and `ceiling_fp` are what the exact masks would have got; null unless evaluated and without exact masks.
# `chance_tp` is null unless evaluated and where the recording is too short for another mask. Unknown speeds and places
# are NaN, categories, directions and reasons that do not apply are null.
OBJECTS_SCHEMA = _schema(
    [
        *IMAGE_COLUMNS,
        *[(name, pa.string()) for name in ("track_id", "object_class", "status", "reason", "category", "direction")],
        *[(name, pa.float64()) for name in ("range_m", "x_m", "y_m", "speed_mps", "ego_speed_mps")],
        *[(name, pa.int64()) for name in ("points", "polygon_px", "region_px")],
        *[(field.name, pa.int64()) for field in fields(ObjectCounts)],
        *[(name, pa.int64()) for name in ("chance_tp", "unknown_px", "ceiling_tp", "ceiling_fp")],
    ],
    nullable={"reason", "category", "direction", "chance_tp", "ceiling_tp", "ceiling_fp"},
)

FRAME_COUNTS = tuple(field.name for field in fields(FrameCounts))

# One row per image. All counts are 0 where there is no mask; an image that is not annotated has those of its mask and
# of V only. `fp_by_cause` is `fp_px` by the cause that the method names, empty for one that names none. The histograms
# over `bench.evaluation.counts.EDGES` are null unless evaluated and where the method has no likelihood.
FRAMES_SCHEMA = _schema(
    [
        *IMAGE_COLUMNS,
        ("ego_speed_mps", pa.float64()),
        *[(name, pa.string()) for name in ("status", "problem")],
        *[(name, pa.int64()) for name in (*FRAME_COUNTS, "undefined_px")],
        ("fp_by_cause", pa.map_(pa.string(), pa.int64())),
        *[(name, pa.list_(pa.int64())) for name in (REFERENCE_COLUMN, OUTSIDE_COLUMN)],
    ],
    nullable={"problem", REFERENCE_COLUMN, OUTSIDE_COLUMN},
)
COLUMNS_OF_FRAMES = [name for name in FRAMES_SCHEMA.names if name not in {REFERENCE_COLUMN, OUTSIDE_COLUMN}]


def to_frame(table: pa.Table) -> pd.DataFrame:
    """Rows for pandas; maps are dictionaries, numbers with nulls float64."""
    frame: pd.DataFrame = table.to_pandas(maps_as_pydicts="strict")
    return frame


def merge_rows(one: pd.DataFrame, other: pd.DataFrame, *, on: Sequence[str]) -> pd.DataFrame:
    """The rows whose key both have; columns that both have get the suffixes "_before" and "_after"."""
    return one.merge(other, on=list(on), suffixes=("_before", "_after"))


def pick(parts: Iterable[pd.DataFrame], choose: Callable[[pd.DataFrame], pd.DataFrame]) -> pd.DataFrame:
    """The few rows that are chosen of all parts, with one part in memory at a time.

    Args:
        parts: at least one, in the order of their key, so that a stable sort leaves equals in it.
        choose: of the rows that were chosen before and those of the next part.
    """
    found: pd.DataFrame | None = None
    for part in parts:
        found = choose(part if found is None else pd.concat([found, part], ignore_index=True))
    assert found is not None, "there is at least one part"
    return found


def sort_rows(rows: pd.DataFrame, key: Sequence[str]) -> pd.DataFrame:
    """The rows by a key that names each once."""
    assert not rows.duplicated(list(key)).any(), f"{list(key)} names each row once"
    return rows.sort_values(list(key), ignore_index=True)

"""Which object-frames one run found and another did not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.evaluation.object_figures import coverage, intersection_over_union
from bench.evaluation.slices import IMAGE

_KEY = [*IMAGE, "track_id"]
_OF_OBJECT = ["object_class", "category", "range_m", "region_px"]

# Null where the run did not evaluate the object-frame. `change` is "gained", "lost" (the detection), "both", "neither",
# or "only_before" and "only_after" for what one run alone evaluated.
CHANGES_SCHEMA = pa.schema(
    [
        ("recording", pa.string()),
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("track_id", pa.string()),
        ("object_class", pa.string()),
        ("category", pa.string()),
        ("range_m", pa.float64()),
        ("region_px", pa.int64()),
        ("change", pa.string()),
        *[
            (f"{name}_{run}", kind)
            for name, kind in (("detected", pa.bool_()), ("coverage", pa.float64()), ("iou", pa.float64()))
            for run in ("before", "after")
        ],
    ]
)


def object_changes(before_objects: pa.Table, after_objects: pa.Table) -> pa.Table:
    """Set the evaluated object-frames of two runs side by side.

    Args:
        before_objects: of `OBJECTS_SCHEMA`.
        after_objects: of `OBJECTS_SCHEMA`.

    Returns:
        Of `CHANGES_SCHEMA`, one row per object-frame evaluated in either run, by recording, camera, time and track.
    """
    before, after = (_scores(table) for table in (before_objects, after_objects))
    rows = before.merge(after, on=_KEY, how="outer", suffixes=("_before", "_after"), indicator=True)
    rows = rows.sort_values(_KEY, ignore_index=True)
    only_before, only_after = ((rows["_merge"] == side).to_numpy() for side in ("left_only", "right_only"))
    for name in _OF_OBJECT:
        rows[name] = rows[f"{name}_before"].where(~only_after, rows[f"{name}_after"])
    was, is_now = (rows[f"detected_{run}"].eq(True).to_numpy() for run in ("before", "after"))
    rows["change"] = np.select(
        [only_before, only_after, ~was & is_now, was & ~is_now, was & is_now],
        ["only_before", "only_after", "gained", "lost", "both"],
        "neither",
    )
    columns = {field.name: pa.array(rows[field.name], type=field.type, from_pandas=True) for field in CHANGES_SCHEMA}
    return pa.table(columns, schema=CHANGES_SCHEMA)


def _scores(objects: pa.Table) -> pd.DataFrame:
    table = objects.to_pandas()
    rows = table[table["status"] == "evaluated"]
    tp, fp, fn = (rows[name].to_numpy(dtype=np.float64) for name in ("tp", "fp", "fn"))
    # Plain strings, as a join of empty Arrow strings fails.
    strings = dict.fromkeys(["recording", "camera", "track_id"], object)
    scores = rows[[*_KEY, *_OF_OBJECT]].astype({"region_px": "Int64"} | strings)
    figures = {"detected": tp > 0, "coverage": coverage(tp, fn), "iou": intersection_over_union(tp, fp, fn)}
    joined: pd.DataFrame = pd.concat([scores, pd.DataFrame(figures, index=scores.index)], axis=1)
    return joined

"""Rows of a result."""

import pandas as pd
import pyarrow as pa

from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA, to_frame
from bench.evaluation.summary import Summary, summary_of
from bench.evaluation.sums import sum_run


def evaluated(table: pa.Table) -> pd.DataFrame:
    rows = to_frame(table)
    return rows[rows["status"] == "evaluated"]


def summarise(objects: pa.Table, frames: pa.Table, *, protocol: Protocol) -> Summary:
    """The metrics of a run from its tables."""
    return summary_of(sum_run([to_frame(objects)], [to_frame(frames)], protocol=protocol), protocol=protocol)


def objects_table(rows):
    return pa.Table.from_pylist(rows, schema=OBJECTS_SCHEMA)


def frames_table(rows):
    return pa.Table.from_pylist(rows, schema=FRAMES_SCHEMA)


def object_row(number):
    key = {"recording": f"drive-{number % 3}", "camera": "front", "timestamp_ns": number * 100, "track_id": "a"}
    what = {"object_class": "vehicle", "status": "evaluated", "reason": None, "category": "crossing"}
    where = {"direction": "lateral", "range_m": 4.0, "x_m": 5.5, "y_m": 2.5, "speed_mps": 2.0, "ego_speed_mps": 1.0}
    size = {"points": 50, "polygon_px": 100, "region_px": 100, "unknown_px": 0}
    counts = {"tp": 50, "fn": 50, "fp": 10, "chance_tp": 5}
    return dict.fromkeys(OBJECTS_SCHEMA.names) | key | what | where | size | counts


def frame_row(number):
    key = {"recording": f"drive-{number % 3}", "camera": "front", "timestamp_ns": number * 100, "ego_speed_mps": 1.0}
    counts = {field.name: 0 for field in FRAMES_SCHEMA if field.type == pa.int64()}
    size = {"width": 640, "height": 480, "valid_px": 300_000, "fp_px": 3072}
    return counts | key | size | {"status": "evaluated", "problem": None, "fp_by_cause": []}

"""Which frames a page shows, what was measured of them, and which object-frames its table lists."""

from types import SimpleNamespace

import pyarrow as pa
import pytest

from bench.evaluation import rows
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECT, OBJECTS_SCHEMA, TableRows
from bench.reporting.run_page import image_facts, object_facts, object_table, worst_frames, worst_objects
from tests.evaluation.runs import random_run, shuffled

S = 1_000_000_000


def objects(*rows):
    fixed = {"recording": "drive", "camera": "front", "status": "evaluated", "category": "crossing", "region_px": 100}
    content = [
        dict.fromkeys(OBJECTS_SCHEMA.names) | fixed
        | {"track_id": track, "timestamp_ns": time, "tp": tp, "fn": 100 - tp, "fp": 0}
        for track, time, tp in rows
    ]  # fmt: skip
    return pa.Table.from_pylist(content, schema=OBJECTS_SCHEMA)


def frames(*rows):
    fixed = dict.fromkeys(FRAMES_SCHEMA.names) | {"camera": "front", "status": "evaluated", "width": 10, "height": 10}
    content = [
        fixed | {"recording": recording, "timestamp_ns": time, "fp_px": fp, "fp_by_cause": []}
        for recording, time, fp in rows
    ]
    return pa.Table.from_pylist(content, schema=FRAMES_SCHEMA)


def test_the_least_found_image_of_each_object():
    table = objects(("a", 0, 1), ("a", S // 2, 2), ("a", 2 * S, 3), ("b", 0, 40), ("c", 0, 90))
    for most, expected in ((2, [("a", 0, 1), ("b", 0, 40)]), (9, [("a", 0, 1), ("b", 0, 40), ("c", 0, 90)])):
        picked = worst_objects(table, most=most)
        assert [(row["track_id"], row["timestamp_ns"], row["tp"]) for row in picked] == expected
        assert [row["coverage"] for row in picked] == [tp / 100 for *_, tp in expected]


def test_the_image_with_most_false_marks_of_each_recording():
    table = frames(("x", 0, 50), ("x", 2 * S, 40), ("y", 0, 10), ("z", 0, 0))
    assert [(r["recording"], r["coverage"]) for r in worst_frames(table, most=9)] == [("x", 0.5), ("y", 0.1)]
    assert [r["recording"] for r in worst_frames(table, most=1)] == ["x"]


ROW = {"coverage": 0.2, "range_m": 4.0, "points": 12, "region_px": 400, "polygon_px": 1000, "speed_mps": 4.8,
       "ego_speed_mps": 5.0}  # fmt: skip


def test_what_was_measured_is_said():
    assert object_facts(ROW) == (
        "20 % found; 4.0 m away, 12 lidar points, 400 px, 60 % hidden by nearer objects; 4.8 m/s, ego vehicle 5.0 m/s"
    )
    counts = {"fp_px": 100, "fp_by_cause": {"epipolar": 70, "height": 30}, "coverage": 0.5, "fp_components": 7,
              "ego_speed_mps": 5.0}  # fmt: skip
    assert image_facts(counts) == ("50 % wrongly marked in 7 patches, most by epipolar, 70 %; ego vehicle 5.0 m/s")
    assert "most by" not in image_facts(counts | {"fp_by_cause": None})


@pytest.mark.parametrize("rows_at_once", [1, 20, 10_000])
def test_the_least_covered_object_frames_are_listed(monkeypatch, rows_at_once):
    monkeypatch.setattr(rows, "ROWS_AT_ONCE", rows_at_once)
    table, _ = random_run(2)
    content = table.to_pylist()
    evaluated = sorted(
        (row["tp"] / (row["tp"] + row["fn"]), -row["region_px"], *(row[name] for name in OBJECT))
        for row in content
        if row["region_px"]
    )
    run = SimpleNamespace(objects=TableRows(shuffled(table, 1)))
    listed, annotated = object_table(run, {}, most=10)
    assert annotated == len(content)
    assert [*listed.rows[OBJECT].itertuples(index=False, name=None)] == [row[2:] for row in evaluated[:10]]
    every, _ = object_table(run, {}, most=10_000)
    assert len(every.rows) == len(every.tags) == annotated

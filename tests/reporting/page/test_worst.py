"""Which frames are shown, and what was measured of them."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from bench.evaluation import CoverageCurve
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.records.segmentation import Segmentation
from bench.reference import Category
from bench.reporting.charts import coverage_points
from bench.reporting.worst_cases import (
    OF_IMAGE,
    OF_OBJECT,
    Card,
    facts_of_missed,
    gallery,
    image_facts,
    object_facts,
    worst_frames,
    worst_objects,
)

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


def picked(table, category=Category.CROSSING, *, most):
    rows = worst_objects(table, [category], most=most)[category.value]
    return [(row["track_id"], row["timestamp_ns"] // S, row["tp"]) for row in rows]


def test_each_object_first_then_a_second_apart():
    table = objects(("a", 0, 1), ("a", S // 2, 2), ("a", 2 * S, 3), ("b", 0, 40), ("c", 0, 90))
    assert picked(table, most=3) == [("a", 0, 1), ("b", 0, 40), ("c", 0, 90)]
    of_four = [("a", 0, 1), ("a", 2, 3), ("b", 0, 40), ("c", 0, 90)]
    assert picked(table, most=9) == of_four
    assert picked(table, Category.PRECEDING, most=3) == []


def test_images_of_different_recordings_first():
    table = frames(("x", 0, 50), ("x", 2 * S, 40), ("y", 0, 10), ("z", 0, 0))
    assert [(r["recording"], r["coverage"]) for r in worst_frames(table, most=2)] == [("x", 0.5), ("y", 0.1)]
    assert [r["fp_px"] for r in worst_frames(table, most=9)] == [50, 40, 10]


ROW = {"coverage": 0.2, "range_m": 4.0, "points": 12, "region_px": 400, "polygon_px": 1000, "speed_mps": 4.8,
       "ego_speed_mps": 5.0}  # fmt: skip


def test_what_was_measured_of_an_object_is_said():
    seen = {"undefined": "70 %", "near travel": "60 %", "likelihood": "0.0002 (0.0006)"}
    assert object_facts(ROW, seen) == {
        "found": "20 %", "range": "4.0 m", "lidar points": "12", "size": "400 px", "hidden": "60 %",
        "speed": "4.8 m/s", "ego vehicle": "5.0 m/s", "undefined": "70 %", "near travel": "60 %",
        "above horizon": "", "likelihood": "0.0002 (0.0006)",
    }  # fmt: skip
    assert {name for name, text in object_facts(ROW, {}).items() if not text} == set(OF_OBJECT)


def frame_of(likelihood, *, threshold=6e-4):
    """A camera that looks up at every pixel and drives straight ahead, in cells of two pixels."""
    model = SimpleNamespace(unproject=lambda pixels: (np.tile([1.0, 0.0, 1.0], (len(pixels), 1)), None))
    pose = SimpleNamespace(rotation=np.eye(3))
    pipeline = SimpleNamespace(camera=SimpleNamespace(model=model, vehicle_from_camera=pose))
    found = Segmentation(cell_size_px=2, mask=np.zeros((2, 2), bool), likelihood=likelihood, threshold=threshold)
    step = SimpleNamespace(translation_m=np.array([0.0, 0.0, 1.0]))
    return pipeline, SimpleNamespace(segmentation=found, given=SimpleNamespace(current_from_previous=[step]))


def test_what_the_image_shows_of_the_missed_pixels():
    missed = np.zeros((4, 4), dtype=bool)
    missed[0] = True
    cells = np.array([[1e-4, 3e-4], [9e-4, 9e-4]], dtype=np.float32)
    facts = facts_of_missed(*frame_of(cells), missed=missed)
    assert facts == {
        "undefined": "0 %",
        "near travel": "0 %",
        "above horizon": "100 %",
        "likelihood": "0.0002 (0.0006)",
    }
    assert not any(facts_of_missed(*frame_of(cells), missed=~missed & missed).values()), "nothing was missed"
    for of_method in (frame_of(cells, threshold=None), frame_of(None, threshold=None)):
        assert not facts_of_missed(*of_method, missed=missed).get("likelihood")


def test_what_was_measured_of_an_image_is_said():
    counts = {"fp_px": 100, "fp_largest_px": 20, "fp_unattached_px": 90, "fp_by_cause": {"epipolar": 70, "height": 30},
              "coverage": 0.5, "fp_components": 7, "ego_speed_mps": 5.0}  # fmt: skip
    assert image_facts(counts, dict(zip(OF_IMAGE, ("90 %", "0 %"), strict=True))) == {
        "wrongly marked": "50 %", "patches": "7", "largest": "20 %", "at objects": "10 %", "cause": "epipolar 70 %",
        "ego vehicle": "5.0 m/s", "below horizon": "90 %", "on stationary": "0 %",
    }  # fmt: skip
    unknown = image_facts(counts | {"fp_by_cause": None}, {})
    assert {name for name, text in unknown.items() if not text} == {"cause", "below horizon", "on stationary"}


def test_the_worst_stand_in_one_table_that_leads_to_their_pictures():
    cards = [
        Card(element=f"worst-{n}", key=("a", "front", n), title=f"car {n}", view=None, facts=object_facts(row, {}))
        for n, row in enumerate([ROW, ROW | {"coverage": 0.4}])
    ]
    _, table, _ = gallery("Crossing", "object", cards)
    assert [heading.text for heading in table.headings()][:2] == ["object", "found"]
    assert "undefined" not in [heading.text for heading in table.headings()], "of no card"
    assert [(cells[0].link, cells[1].text) for cells in table.cells()] == [("#worst-0", "20 %"), ("#worst-1", "40 %")]
    assert cards[0].facts_line.startswith("found 20 %, range 4.0 m, lidar points 12, ")


def test_the_coverage_curve_has_a_point_where_it_bends():
    at_least = np.array([3] * 251 + [2] * 250 + [1] * 500)
    thresholds, found = coverage_points(CoverageCurve(at_least=at_least, object_frames=4))
    assert thresholds.tolist() == [0, 25, pytest.approx(25.1), 50, pytest.approx(50.1), 100]
    assert found.tolist() == [75, 75, 50, 50, 25, 25]

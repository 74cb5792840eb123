"""Which frames are shown, and what is said of them."""

import math

import numpy as np
import pyarrow as pa
import pytest

from bench.evaluation import CoverageCurve
from bench.evaluation.rows import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.reference import Category
from bench.reporting.page.charts import coverage_points
from bench.reporting.page.worst import (
    FrameEvidence,
    ObjectEvidence,
    frame_reason,
    object_reason,
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


def row(**changes):
    found = {"coverage": 0.2, "category": "crossing", "region_px": 1000, "polygon_px": 1000, "points": 100}
    return found | {"speed_mps": 1.0, "ego_speed_mps": 5.0} | changes


def seen(**changes):
    shares = {"undefined": 0.0, "blind_band": 0.0, "above_horizon": 0.0, "likelihood": 2e-4}
    of_method = {"threshold": 6e-4, "causes": ("positive_height", "anti_parallel")}
    return ObjectEvidence(**(shares | of_method | changes))


@pytest.mark.parametrize(
    ("of_row", "of_image", "words"),
    [
        ({"coverage": 0.9}, {}, "Nothing to explain: 90 %"),
        ({}, {"undefined": 0.7}, "70 % of the missed pixels are undefined"),
        ({}, {"blind_band": 0.6}, "Blind band: 60 %"),
        (
            {"category": "preceding"},
            {"above_horizon": 0.8},
            "80 % of the missed pixels lie above the horizon, where pos",
        ),
        ({"category": "approaching"}, {"above_horizon": 0.8}, "where anti-parallel"),
        ({"region_px": 400}, {}, "Occluded: 60 %"),
        ({"category": "preceding", "speed_mps": 4.8}, {}, "almost as fast as the ego vehicle (4.8 and 5.0 m/s)"),
        ({"points": 12}, {}, "Only 12 lidar points"),
        ({"region_px": 90, "polygon_px": 90}, {}, "Small: 90 pixels"),
        (
            {},
            {},
            "No single reason found in the numbers. On its missed pixels the median motion likelihood is 0.0002",
        ),
    ],
)
def test_the_reason_is_what_the_numbers_say(of_row, of_image, words):
    told = object_reason(row(**of_row), seen(**of_image))
    assert words in told
    others = ("Nothing", "undefined", "Blind", "horizon", "Occluded", "almost", "Only", "Small", "No single")
    assert sum(other in told for other in others) == 1


def test_what_needs_the_image_is_not_said_without_it():
    assert object_reason(row(), None) == "No single reason found in the numbers."
    assert "likelihood" not in object_reason(row(), seen(likelihood=math.nan))
    assert object_reason(row(), seen()).endswith("is 0.0002, below the threshold of 0.0006.")
    assert "above the threshold" in object_reason(row(), seen(likelihood=1e-3))


def test_what_the_method_does_not_have_is_no_reason():
    assert object_reason(row(), seen(threshold=None)) == "No single reason found in the numbers."
    high = row(category="preceding"), seen(above_horizon=0.8, causes=("epipolar", "anti_parallel"))
    assert "horizon" not in object_reason(*high)


def test_the_reason_of_an_image_is_what_the_numbers_say():
    counts = {"fp_px": 100, "fp_largest_px": 20, "fp_unattached_px": 90, "fp_by_cause": {"epipolar": 70, "height": 30}}
    unclear = counts | {"fp_by_cause": {"epipolar": 40, "height": 35, "depth": 25}}
    evidence = FrameEvidence(below_horizon=0.9, static_objects=0.0)
    assert frame_reason(counts, None) == "Mostly epipolar, with 70 % of the false pixels."
    assert frame_reason(unclear, None) == "No single cause; the largest is epipolar, with 40 % of the false pixels."
    assert "90 % lie below the horizon" in frame_reason(counts, evidence)
    assert "One connected patch makes 80 %" in frame_reason(counts | {"fp_largest_px": 80}, None)
    assert "60 % are in patches that touch a moving object" in frame_reason(counts | {"fp_unattached_px": 40}, None)
    assert frame_reason(counts | {"fp_by_cause": {}}, None) == "No single reason found in the numbers."


def test_the_coverage_curve_has_a_point_where_it_bends():
    at_least = np.array([3] * 251 + [2] * 250 + [1] * 500)
    thresholds, found = coverage_points(CoverageCurve(at_least=at_least, object_frames=4))
    assert thresholds.tolist() == [0, 25, pytest.approx(25.1), 50, pytest.approx(50.1), 100]
    assert found.tolist() == [75, 75, 50, 50, 25, 25]

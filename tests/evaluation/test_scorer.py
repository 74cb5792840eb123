"""From frames to the two tables."""

from __future__ import annotations

import numpy as np

from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, SequenceScorer
from bench.records.reference import IgnoreReason
from bench.records.segmentation import Segmentation
from bench.times import SECOND_NS
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import PAPER, scored


def test_every_annotated_object_has_a_row() -> None:
    objects = [reference_object("a"), ignored_object("b", IgnoreReason.FEW_POINTS), static_object("c")]
    frame = reference_frame(picture("11.."), objects=objects, ignored=mask("..x."))
    table, _ = scored([(frame, mask(".x.x"))])
    rows = table.to_pylist()
    assert table.schema == OBJECTS_SCHEMA
    assert [(r["track_id"], r["status"], r["reason"], r["category"]) for r in rows] == [
        ("a", "evaluated", None, "crossing"),
        ("b", "ignored", "too_few_points", "crossing"),
        ("c", "static", None, None),
    ]
    assert [(r["region_px"], r["tp"], r["fn"], r["fp"]) for r in rows] == [(2, 1, 1, 0), (0, 0, 0, 0), (0, 0, 0, 0)]


def test_cells_are_spread_over_the_image() -> None:
    scorer = SequenceScorer(PAPER)
    frame = reference_frame(np.zeros((4, 6), dtype=np.int32), valid=mask("xxxxxx\nxxxxxx\nxxxxxx\n......"))
    cells = Segmentation(
        cell_size_px=2,
        mask=mask("x..\n..."),
        undefined=mask("...\n.x."),
        causes=("depth", "epipolar"),
        cause=np.array([[1, 0, 0], [0, 0, 0]], dtype=np.uint8),
    )
    scorer.add(frame, cells)
    (row,) = scorer.finish()[1].to_pylist()
    assert (row["fp_px"], row["undefined_px"], row["valid_px"]) == (4, 2, 18)
    assert row["fp_by_cause"] == [("depth", 0), ("epipolar", 4)]


def test_an_image_left_out_says_why() -> None:
    scorer = SequenceScorer(PAPER)
    scorer.leave_out(recording="drive", camera="front", timestamp_ns=7, status="failed", problem="truncated image")
    objects, images = scorer.finish()
    assert len(objects) == 0
    assert images.schema == FRAMES_SCHEMA
    (row,) = images.to_pylist()
    assert (row["timestamp_ns"], row["status"], row["problem"], row["fp_px"]) == (7, "failed", "truncated image", 0)


def test_chance_comes_from_the_mask_a_second_away() -> None:
    objects = [reference_object("a"), static_object("b")]
    early = reference_frame(picture("11.."), objects=objects)
    late = reference_frame(picture("..11"), objects=objects, timestamp_ns=SECOND_NS)
    table, _ = scored([(early, mask("xxx.")), (late, mask(".xxx"))])
    assert table["chance_tp"].to_pylist() == [1, None, 1, None]

"""Object-frames gained and lost."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.evaluation import changes_in_parts
from bench.evaluation.comparison import CHANGES
from bench.evaluation.comparison import object_changes as changes_of_frames
from bench.evaluation.rows import to_frame
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import random_run, scored, shuffled


def object_changes(before: pa.Table, after: pa.Table) -> pd.DataFrame:
    return changes_of_frames(to_frame(before), to_frame(after))


def rows_of(table: pd.DataFrame) -> list[dict[str, object]]:
    """Rows with None for what is missing."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def test_every_kind_of_change() -> None:
    objects = [reference_object(name) for name in "dcba"]
    frame = reference_frame(picture("1234\n1234"), objects=[*objects, static_object("s")])
    before, _ = scored([(frame, mask("xx..\n...."))])
    after, _ = scored([(frame, mask("x.x.\nx..."))])
    table = object_changes(before, after)
    assert list(table.columns) == CHANGES
    rows = rows_of(table)
    assert [(r["track_id"], r["change"]) for r in rows] == [
        *[("a", "neither"), ("b", "gained"), ("c", "lost"), ("d", "both")]
    ]
    d = rows[-1]
    assert (d["coverage_before"], d["coverage_after"]) == (0.5, 1)
    assert (d["detected_before"], d["detected_after"]) == (True, True)
    assert (d["object_class"], d["category"], d["range_m"], d["region_px"]) == ("pedestrian", "crossing", 3.0, 2)
    # Before, one component of two pixels touches c and d; after, d alone.
    assert (d["iou_before"], d["iou_after"]) == (0.5, 1.0)


def test_what_one_run_alone_evaluated_has_nulls_in_the_other() -> None:
    both = reference_frame(picture("12"), objects=[reference_object("a"), reference_object("b")])
    one = reference_frame(picture("1."), objects=[reference_object("a"), ignored_object("b")])
    table = object_changes(scored([(both, mask("xx"))])[0], scored([(one, mask("xx"))])[0])
    a, b = rows_of(table)
    assert (a["change"], b["change"]) == ("both", "only_before")
    assert (b["detected_before"], b["detected_after"], b["coverage_after"], b["iou_after"]) == (True, None, None, None)
    back = rows_of(object_changes(scored([(one, mask("xx"))])[0], scored([(both, mask("xx"))])[0]))[1]
    assert (back["change"], back["object_class"]) == ("only_after", "pedestrian")
    assert (back["range_m"], back["region_px"]) == (3, 1)


def test_the_order_of_the_rows_does_not_matter() -> None:
    (before, _), (after, _) = random_run(1), random_run(2)
    turned = object_changes(shuffled(before, 3), shuffled(after, 4))
    pd.testing.assert_frame_equal(turned, object_changes(before, after))


def test_changes_in_parts_are_those_of_the_whole() -> None:
    (before, _), (after, _) = random_run(1), random_run(2)
    parts = list(changes_in_parts(shuffled(before, 1), shuffled(after, 2), rows_at_once=25))
    assert len(parts) > 1
    pd.testing.assert_frame_equal(pd.concat(parts, ignore_index=True), object_changes(before, after))


def test_a_run_against_itself_changes_nothing() -> None:
    objects, _ = random_run(3)
    table = object_changes(objects, objects)
    evaluated = sum(status == "evaluated" for status in objects["status"].to_pylist())
    assert len(table) == evaluated > 0
    assert set(table["change"]) == {"both", "neither"}
    assert np.array_equal(table["iou_before"], table["iou_after"])


def test_runs_of_nothing() -> None:
    empty, _ = scored([])
    assert len(object_changes(empty, empty)) == 0
    static = scored([(reference_frame(picture(".."), objects=[static_object("s")]), mask("xx"))])[0]
    assert len(object_changes(static, static)) == 0

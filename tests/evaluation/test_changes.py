"""Object-frames gained and lost."""

from __future__ import annotations

from bench.evaluation import object_changes
from bench.evaluation.paired import CHANGES_SCHEMA
from tests.evaluation.frames import ignored_object, mask, picture, reference_frame, reference_object, static_object
from tests.evaluation.runs import random_run, scored, shuffled


def test_every_kind_of_change() -> None:
    objects = [reference_object(name) for name in "dcba"]
    frame = reference_frame(picture("1234\n1234"), objects=[*objects, static_object("s")])
    before, _ = scored([(frame, mask("xx..\n...."))])
    after, _ = scored([(frame, mask("x.x.\nx..."))])
    table = object_changes(before, after)
    assert table.schema == CHANGES_SCHEMA
    rows = table.to_pylist()
    assert [(r["track_id"], r["change"]) for r in rows] == [
        *[("a", "neither"), ("b", "gained"), ("c", "lost"), ("d", "both")]
    ]
    d = rows[-1]
    assert (d["coverage_before"], d["coverage_after"], d["detected_before"], d["detected_after"]) == (
        0.5,
        1,
        True,
        True,
    )
    assert (d["object_class"], d["category"], d["range_m"], d["region_px"]) == ("pedestrian", "crossing", 3.0, 2)
    # Before, one component of two pixels touches c and d; after, d alone.
    assert (d["iou_before"], d["iou_after"]) == (0.5, 1.0)


def test_what_one_run_alone_evaluated_has_nulls_in_the_other() -> None:
    both = reference_frame(picture("12"), objects=[reference_object("a"), reference_object("b")])
    one = reference_frame(picture("1."), objects=[reference_object("a"), ignored_object("b")])
    table = object_changes(scored([(both, mask("xx"))])[0], scored([(one, mask("xx"))])[0])
    a, b = table.to_pylist()
    assert (a["change"], b["change"]) == ("both", "only_before")
    assert (b["detected_before"], b["detected_after"], b["coverage_after"], b["iou_after"]) == (True, None, None, None)
    back = object_changes(scored([(one, mask("xx"))])[0], scored([(both, mask("xx"))])[0]).to_pylist()[1]
    assert (back["change"], back["object_class"], back["range_m"], back["region_px"]) == (
        "only_after",
        "pedestrian",
        3,
        1,
    )


def test_the_order_of_the_rows_does_not_matter() -> None:
    (before, _), (after, _) = random_run(1), random_run(2)
    assert object_changes(shuffled(before, 3), shuffled(after, 4)) == object_changes(before, after)


def test_a_run_against_itself_changes_nothing() -> None:
    objects, _ = random_run(3)
    table = object_changes(objects, objects)
    evaluated = sum(status == "evaluated" for status in objects["status"].to_pylist())
    assert len(table) == evaluated > 0
    assert set(table["change"].to_pylist()) == {"both", "neither"}
    assert table["iou_before"] == table["iou_after"]


def test_runs_of_nothing() -> None:
    empty, _ = scored([])
    assert object_changes(empty, empty).num_rows == 0

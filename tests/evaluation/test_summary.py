"""The reduction of a run, and the checks that must always hold."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import pyarrow as pa
import pytest
from hypothesis import given, settings

from bench.evaluation import definitions
from bench.evaluation import summary as summary_module
from bench.evaluation.definitions import find_metric
from bench.evaluation.protocol import load_protocol
from bench.evaluation.summary import FalsePositiveMetrics, Metric, ObjectMetrics, SegmentationMetrics, Summary
from bench.records.reference import Category, ReferenceFrame, Status
from tests.evaluation.frames import frames, mask, picture, reference_frame, reference_object
from tests.evaluation.runs import joined, random_run, scored, summary_of
from tests.support.result_rows import summarise


def three_objects() -> Summary:
    """Two recordings; coverages 1/2, 0 and 1, false positives 2, 0 and 0."""
    one = reference_frame(picture("11..\n11..\n....\n2..."), recording="one")
    two = reference_frame(picture("1111"), recording="two")
    return summary_of(joined([scored([(one, mask(".xx.\n.x..\n.x..\n...."))]), scored([(two, mask("xxxx"))])]))


def test_figures_to_check_by_hand() -> None:
    row = three_objects().categories["crossing"]
    assert (row.object_frames, row.tracks, row.recordings) == (3, 3, 2)
    assert row.detection_rate.value == row.metric("detection_rate_50").value == 2 / 3
    assert (row.tpr.value, row.tpr_all.value) == (3 / 4, 1 / 2)
    assert row.iou.value == pytest.approx((2 / 6 + 0 + 1) / 3)
    assert row.iou_detected.value == pytest.approx((2 / 6 + 1) / 2)
    assert (row.tpr.cases, row.iou.cases) == (2, 3)


def test_the_unknown_share_stands_beside_the_rows_of_a_protocol_with_unknown_bands() -> None:
    objects = [reference_object("a", unknown_px=1), reference_object("b")]
    frame = reference_frame(picture("111.\n2..."), objects=objects)
    surface = load_protocol("surface-v1")
    tables = scored([(frame, mask("xxx.\n...."))], protocol=surface)
    row = summarise(*tables, protocol=surface).categories["crossing"]
    assert row.metric("unknown_share").value == (1 / 4 + 0) / 2
    assert row.metric("unknown_share").cases == 2
    assert "unknown_share" not in summary_of(tables).categories["crossing"].metric_names()


def test_false_positives_to_check_by_hand() -> None:
    summary = three_objects()
    images, pixels = summary.false_positives, summary.segmentation
    assert (images.frames, images.coverage.value, images.components_per_frame.value) == (2, (2 / 16 + 0) / 2, 0.5)
    assert (pixels.precision.value, pixels.recall.value) == (6 / 8, 6 / 9)
    assert (pixels.iou.value, pixels.f1.value) == (6 / 11, 12 / 17)


def test_one_recording_has_no_intervals_and_no_cases_are_nan_and_null() -> None:
    alone = summary_of(scored([(reference_frame(picture("1.")), mask("x."))]))
    assert alone.all_moving.iou == Metric(value=1.0, ci95=None, cases=1, recordings=1)
    summary = three_objects()
    empty = summary.categories["static_ego"].iou
    assert math.isnan(empty.value)
    assert (empty.ci95, empty.cases) == (None, 0)
    stored = json.loads(summary.model_dump_json())
    assert stored["categories"]["static_ego"]["iou"] == {"value": None, "ci95": None, "cases": 0, "recordings": 0}


@pytest.mark.parametrize(
    ("row", "metrics"),
    [
        (ObjectMetrics, definitions.OF_OBJECTS),
        (FalsePositiveMetrics, definitions.FALSE_POSITIVES),
        (SegmentationMetrics, definitions.SEGMENTATION),
    ],
)
def test_what_a_row_declares_is_defined(row: type[ObjectMetrics], metrics: Sequence[definitions.Definition]) -> None:
    declared = [name for name, field in row.model_fields.items() if field.annotation is Metric]
    assert declared == [metric.field for metric in metrics if metric.field in declared]


@settings(max_examples=3, deadline=None)
@given(frames())
def test_the_reference_against_itself_is_perfect_and_every_annotated_object_in_the_ledger_once(
    frame: ReferenceFrame,
) -> None:
    summary = summary_of(scored([(frame, frame.labels > 0)]))
    row, ledger = summary.all_moving, summary.objects
    if row.object_frames:
        merits = [name for name in row.metric_names() if find_metric(name).higher_is_better]
        assert {row.metric(name).value for name in merits} == {1.0}
        assert len(merits) >= 7
    assert summary.false_positives.coverage.value == 0
    statuses = [item.status for item in frame.objects]
    assert ledger.annotated == len(statuses) == ledger.evaluated + ledger.static + sum(ledger.ignored.values())
    assert ledger.evaluated == statuses.count(Status.EVALUATED)


def test_every_object_frame_is_in_one_category_and_one_slice_of_each_breakdown() -> None:
    summary = summary_of(random_run(3))
    for rows in (summary.categories, *summary.breakdowns.values()):
        assert sum(row.object_frames for row in rows.values()) == summary.objects.evaluated
    assert summary.false_positives.frames == summary.images.evaluated


def test_figures_lie_in_their_intervals() -> None:
    summary = summary_of(random_run(4, recordings=20))
    rows = [summary.all_moving, *summary.categories.values()]
    figures = [row.metric(name) for row in rows for name in row.metric_names()]
    figures += [summary.false_positives.coverage, summary.segmentation.f1, *summary.false_positive_causes.values()]
    assert all(f.ci95 is not None and f.ci95[0] <= f.value <= f.ci95[1] for f in figures)


def test_causes_share_all_false_positives() -> None:
    causes = summary_of(random_run(4)).false_positive_causes
    assert list(causes) == ["depth", "epipolar"]
    assert sum(figure.value for figure in causes.values()) == pytest.approx(1)


def test_failed_images_are_counted_and_score_nothing() -> None:
    objects, images = random_run(6)
    summary = summary_of((objects, images))
    assert summary.images.failed > 0
    assert summary.images.problems == {"truncated image": summary.images.failed}
    scored_only = images.filter(pa.compute.equal(images["status"], "evaluated"))
    assert summary_of((objects, scored_only)).false_positives == summary.false_positives


def test_a_detection_on_another_slice_is_neutral() -> None:
    """A crossing pedestrian and an overtaking vehicle: finding the one says nothing about the other."""
    vehicle = reference_object("b", object_class="vehicle", category=Category.OVERTAKING, range_m=7.0)
    objects = [reference_object("a"), vehicle]
    frame = reference_frame(picture("11..22\n......"), objects=objects)
    blind = summary_of(scored([(frame, mask("x.....\nx....."))]))
    seeing = summary_of(scored([(frame, mask("x...xx\nx....x"))]))
    assert seeing.categories["overtaking"] != blind.categories["overtaking"]
    assert str(seeing.categories["crossing"]) == str(blind.categories["crossing"])
    for breakdown, name in (("object_class", "pedestrian"), ("range_m", "[2, 4)")):
        assert str(seeing.breakdowns[breakdown][name]) == str(blind.breakdowns[breakdown][name])


def test_object_frames_are_cut_by_the_objects_own_speed_and_by_class_and_speed() -> None:
    """A walking and a running pedestrian, and a car that drives off beside one of unknown speed."""
    speeds = {"a": 1.49, "b": 1.5, "c": 5.0, "d": math.nan}
    objects = [
        reference_object(name, object_class="pedestrian" if name in "ab" else "vehicle", speed_mps=speed)
        for name, speed in speeds.items()
    ]
    cut = summary_of(scored([(reference_frame(picture("1234"), objects=objects), mask("x.xx"))])).breakdowns
    by_speed = {name: (row.object_frames, row.iou.value) for name, row in cut["speed_mps"].items() if row.object_frames}
    assert by_speed == {"[0, 1.5)": (1, 1.0), "[1.5, 5)": (1, 0.0), "[5, 10)": (1, 1.0)}
    both = {name: row.object_frames for name, row in cut["class_and_speed"].items() if row.object_frames}
    assert both == {"pedestrian, [0, 1.5)": 1, "pedestrian, [1.5, 5)": 1, "vehicle, [5, 10)": 1}
    assert len(cut["class_and_speed"]) == 3 * len(cut["speed_mps"]) == 15


def test_objects_of_which_no_speed_is_known_are_in_no_bin_of_it() -> None:
    objects = [reference_object(name, speed_mps=math.nan) for name in "ab"]
    cut = summary_of(scored([(reference_frame(picture("12"), objects=objects), mask("xx"))])).breakdowns
    assert not any(row.object_frames for name in ("speed_mps", "class_and_speed") for row in cut[name].values())
    assert sum(row.object_frames for row in cut["object_class"].values()) == 2


def test_bins_are_half_open() -> None:
    objects = [reference_object(chr(97 + k), range_m=range_m) for k, range_m in enumerate([1.99, 2.0, 8.0, 50.0])]
    rows = summary_of(scored([(reference_frame(picture("1234"), objects=objects), mask("xxxx"))])).breakdowns["range_m"]
    assert [*rows] == ["[0, 2)", "[2, 4)", "[4, 6)", "[6, 8)", "[8, inf)"]
    assert [row.object_frames for row in rows.values()] == [1, 1, 0, 0, 2]


def test_a_metric_that_is_added_to_the_definitions_is_in_the_summary(monkeypatch: pytest.MonkeyPatch) -> None:
    added = replace(definitions.FALSE_POSITIVES[0], name="added", short_name="")
    for module in (definitions, summary_module):
        monkeypatch.setattr(module, "FALSE_POSITIVES", (*definitions.FALSE_POSITIVES, added))
    monkeypatch.setitem(definitions.FIXED, "added", added)
    found = summary_of(random_run(1))
    stored = Summary.model_validate_json(found.model_dump_json())
    assert stored.false_positives.metric("added") == found.false_positives.coverage
    assert "added" in stored.false_positives.metric_names()

"""The top of a run's page: its tiles, the kinds of motion in one table, statements read off the tables."""

import math

import pytest

from bench.evaluation.summary import FrameLedger, Metric, ObjectMetrics
from bench.reporting.formats import percent
from bench.reporting.run_page import (
    breakdown_table,
    breakdowns,
    lowest_of,
    remarks,
    tiles,
)
from tests.reporting.printed import texts
from tests.reporting.summaries import object_figures, summary


def told(figures):
    return [(remark.style, remark.text) for remark in remarks(figures)]


def of_kinds(**rows):
    return summary().model_copy(update={"categories": rows})


def without_intervals(row, recordings=5):
    names = row.metric_names()
    few = {name: row.metric(name).model_copy(update={"ci95": None, "recordings": recordings}) for name in names}
    return ObjectMetrics(object_frames=row.object_frames, tracks=row.tracks, recordings=recordings, **few)


def test_the_kinds_are_in_the_order_of_iou_and_those_without_cases_left_out():
    table = breakdown_table("categories", breakdowns(summary())["categories"])
    assert [row[:2] for row in texts(table)] == [
        ["Preceding", "15.0 %"], ["Approaching", "22.5 %"], ["Crossing", "32.5 %"], ["Overtaking", "45.0 %"]
    ]  # fmt: skip
    assert [cells[1].style for cells in table.cells()] == ["bad", "strong", "strong", "strong"], "clearly the lowest"


@pytest.mark.parametrize(
    ("third", "said"),
    [
        (object_figures(0.64), False),
        (object_figures(0.1), True),
        (without_intervals(object_figures(0.1)), False),
        (object_figures(0.1, object_frames=9), False),
    ],
)
def test_the_lowest_is_named_only_where_its_interval_lies_wholly_below_another(third, said):
    rows = {"crossing": object_figures(0.60), "overtaking": object_figures(0.62), "preceding": third}
    statement = ("bad", "IoU is clearly lower than elsewhere, by kind of motion: Preceding with 4.5 %.")
    assert told(of_kinds(**rows)) == ([statement] if said else [])


def test_the_statement_names_what_the_tables_mark():
    rows = {"[0, 2)": object_figures(0.9), "[2, 4)": object_figures(0.2), "[4, 6)": object_figures(math.nan)}
    found = of_kinds(crossing=object_figures(0.6)).model_copy(update={"breakdowns": {"range_m": rows}})
    assert told(found) == [("bad", "IoU is clearly lower than elsewhere, by range: [2, 4) with 9.0 %.")]
    table = breakdown_table("range_m", breakdowns(found)["range_m"])
    assert [row[0] for row in texts(table)] == ["[0, 2)", "[2, 4)"], "only what occurs is listed"
    assert [cells[0].text for cells in table.cells() if cells[1].style == "bad"] == ["[2, 4)"]
    assert lowest_of(rows | {"[2, 4)": object_figures(0.2, object_frames=9)}) is None


def test_the_page_begins_with_the_headlines_and_the_ceiling_of_iou():
    figures = summary()
    ceiling = Metric(value=0.92, ci95=None, cases=100, recordings=8)
    with_truth = figures.all_moving.model_copy(update={"ceiling_iou": ceiling})
    table = tiles(figures.model_copy(update={"all_moving": with_truth}), large_px=100)
    assert list(zip((cell.text for cell in table.headings()), texts(table)[0], strict=True)) == [
        ("IoU, all", "27.0 %"),
        ("TPR, all", "42.0 %"),
        ("Detection at 50 %", percent(figures.all_moving.metric("detection_rate_50").value)),
        ("False-positive coverage", "10.5 %"),
        ("Frames with a large false positive", "88.0 %"),
    ]
    assert table.cells()[0][4].below == ("[83.0, 93.0]", "of the images have a false patch of more than 100 px")
    assert table.cells()[0][0].below == ("[22.0, 32.0]", "ceiling 92.0 %; over 100 object-frames")
    assert tiles(figures, large_px=100).cells()[0][0].below[-1] == "over 100 object-frames"


def test_what_was_not_scored_is_said():
    images = FrameLedger(images=10, evaluated=7, failed=2, skipped=1, problems={})
    texts = [text for _, text in told(summary().model_copy(update={"images": images}))]
    assert "3 of 10 images could not be scored; the last section says why." in texts
    none = of_kinds(crossing=object_figures(math.nan))
    assert told(none) == [("warn", "No object-frame was evaluated: there is nothing to say of moving objects.")]


def test_cells_without_cases_have_no_bar():
    rows = {"a": object_figures(0.9), "b": object_figures(0.2), "c": object_figures(math.nan)}
    ious = {name: cells[1] for name, cells in zip(rows, breakdown_table("camera", rows).cells(), strict=True)}
    assert (ious["c"].below, ious["c"].bar) == (("(0 cases)",), None)
    assert ious["a"].below == ("[35.5, 45.5]",)
    assert (ious["a"].bar.share, *ious["a"].bar.interval) == pytest.approx((0.405, 0.355, 0.455))

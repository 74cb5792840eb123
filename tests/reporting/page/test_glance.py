"""A run at a glance: its tiles, the kinds of motion in one table, and statements read off the tables."""

import math
import re

import pytest

from bench.evaluation.summary import FrameLedger, Metric, ObjectMetrics
from bench.reference import Category
from bench.reporting.document import to_html
from bench.reporting.formats import percent
from bench.reporting.glance import against_chance, breakdown_table, breakdowns, kind_tables, lowest_of, remarks, tiles
from tests.reporting.printed import texts
from tests.reporting.summaries import figure, object_figures, summary


def told(figures):
    return [(remark.style, remark.text) for remark in remarks(figures)]


def of_kinds(**rows):
    return summary().model_copy(update={"categories": rows})


def without_intervals(row, recordings=5):
    names = row.metric_names()
    few = {name: row.metric(name).model_copy(update={"ci95": None, "recordings": recordings}) for name in names}
    return ObjectMetrics(object_frames=row.object_frames, tracks=row.tracks, recordings=recordings, **few)


def at_chance(row):
    rate = Metric(value=0.2, ci95=(0.1, 0.3), cases=100, recordings=8)
    level = Metric(value=0.15, ci95=None, cases=100, recordings=8)
    return row.model_copy(update={"detection_rate_50": rate, "chance_50": level})


def without_chance(row):
    return row.model_copy(update={"chance_50": figure(math.nan)})


@pytest.mark.parametrize(
    ("row", "style", "statement"),
    [
        (object_figures(0.6), "",
         "Above chance when half of an object must be found: crossing (30.0 %, by chance 6.0 %)"),
        (at_chance(object_figures(0.6)), "bad",
         "Not shown to be above chance when half of an object must be found: crossing (20.0 %, by chance 15.0 %)"),
        (without_intervals(object_figures(0.6)), "",
         "Too few recordings to tell from chance, 6 are needed: crossing (5)"),
        (object_figures(0.6, object_frames=9), "", "Fewer than 10 object-frames: crossing (9)"),
        (without_chance(object_figures(0.6)), "", "Without a chance level: crossing"),
    ],
)  # fmt: skip
def test_a_kind_of_motion_stands_in_one_statement_on_chance(row, style, statement):
    found = of_kinds(crossing=row, overtaking=object_figures(0.62))
    assert statement.startswith(against_chance(row)[1])
    ((told_style, text),) = [(style, text) for style, text in told(found) if "crossing" in text]
    assert told_style == style
    assert text.startswith(statement)
    assert sum("crossing" in text for _, text in told(found)) == 1


def test_the_kinds_are_in_the_order_of_iou_and_those_without_cases_left_out():
    (table,) = kind_tables(summary())
    assert [row[:2] for row in texts(table)] == [
        ["Preceding", "15.0 %"], ["Approaching", "22.5 %"], ["Crossing", "32.5 %"], ["Overtaking", "45.0 %"]
    ]  # fmt: skip
    assert [cells[1].style for cells in table.cells()] == ["bad", "strong", "strong", "strong"], "clearly the lowest"


def test_the_lowest_is_named_only_where_its_interval_lies_wholly_below_another():
    few = {"crossing": object_figures(0.60), "overtaking": object_figures(0.62), "preceding": object_figures(0.64)}
    assert not any("lower" in text for _, text in told(of_kinds(**few)))
    apart = few | {"preceding": object_figures(0.1)}
    assert ("bad", "IoU is clearly lower than elsewhere: kind preceding with 4.5 %.") in told(of_kinds(**apart))
    unknown = apart | {"preceding": without_intervals(object_figures(0.1))}
    assert not any("lower" in text for _, text in told(of_kinds(**unknown))), "too few recordings"
    nine = apart | {"preceding": object_figures(0.1, object_frames=9)}
    assert not any("lower" in text for _, text in told(of_kinds(**nine))), "too few object-frames"


def test_the_statement_names_what_the_tables_mark():
    rows = {"[0, 2)": object_figures(0.9), "[2, 4)": object_figures(0.2), "[4, 6)": object_figures(math.nan)}
    found = of_kinds(crossing=object_figures(0.6)).model_copy(update={"breakdowns": {"range_m": rows}})
    assert ("bad", "IoU is clearly lower than elsewhere: range [2, 4) m with 9.0 %.") in told(found)
    (table,) = breakdowns(found)
    assert [cells[0].text for cells in table.cells() if cells[1].style == "bad"] == ["[2, 4)"]
    assert lowest_of(rows | {"[2, 4)": object_figures(0.2, object_frames=9)}) is None


def test_of_class_and_speed_only_what_occurs_is_listed():
    rows = {"pedestrian, [0, 1.5)": object_figures(0.9), "pedestrian, [20, inf)": object_figures(math.nan)}
    split = {"class_and_speed": rows, "speed_mps": {"[0, 1.5)": rows["pedestrian, [20, inf)"]}}
    both, speeds = breakdowns(of_kinds(crossing=object_figures(0.6)).model_copy(update={"breakdowns": split}))
    assert [[row[0] for row in texts(table)] for table in (both, speeds)] == [["pedestrian, [0, 1.5)"], ["[0, 1.5)"]]


def test_the_page_begins_with_the_headlines_and_the_ceiling_of_iou():
    figures = summary()
    ceiling = Metric(value=0.92, ci95=None, cases=100, recordings=8)
    with_truth = figures.all_moving.model_copy(update={"ceiling_iou": ceiling})
    table = tiles(figures.model_copy(update={"all_moving": with_truth}), category=None)
    assert list(zip((cell.text for cell in table.headings()), texts(table)[0], strict=True)) == [
        ("IoU, all", "27.0 %"),
        ("TPR, all", "42.0 %"),
        ("Detection at 50 %", percent(figures.all_moving.metric("detection_rate_50").value)),
        ("False-positive coverage", "10.5 %"),
    ]
    assert table.cells()[0][0].below == ("[22.0, 32.0]", "ceiling 92.0 %; over 100 object-frames")
    assert tiles(figures, category=None).cells()[0][0].below[-1] == "over 100 object-frames"
    of_crossing = [cell.text for cell in tiles(figures, category=Category.CROSSING).headings()]
    assert of_crossing == ["IoU, all", "TPR, all", "Detection at 50 %"]
    few = figures.model_copy(update={"all_moving": object_figures(0.4, object_frames=9)})
    assert [text == "n/a" for text in texts(tiles(few, category=None))[0]] == [True, True, True, False]


def test_images_that_were_not_scored_are_said():
    images = FrameLedger(images=10, evaluated=7, failed=2, skipped=1, problems={})
    texts = [text for _, text in told(summary().model_copy(update={"images": images}))]
    assert "3 of 10 images could not be scored; the last section says why." in texts


def test_a_run_without_object_frames_says_so():
    none = of_kinds(crossing=object_figures(math.nan))
    assert told(none) == [("warn", "No object-frame was evaluated: there is nothing to say of moving objects.")]


def cells(rows):
    """What the page shows of IoU, by row."""
    table = breakdown_table("By letter", "letter", rows)
    lines = [re.findall(r"<td class=\"metric.*?</td>|<td.*?</td>", line, re.DOTALL)
             for line in to_html([table]).split("<tr>")[2:]]  # fmt: skip
    return {name: line[0] for name, line in zip(rows, lines, strict=True)}


def test_the_lowest_of_a_table_is_marked_and_cells_without_cases_have_no_bar():
    rows = {"a": object_figures(0.9), "b": object_figures(0.2), "c": object_figures(math.nan)}
    shown = cells(rows)
    assert [name for name, cell in shown.items() if "lowest" in cell] == ["b"]
    assert not any("lowest" in cell for cell in cells(rows | {"b": without_intervals(rows["b"])}).values())
    assert "(0 cases)" in shown["c"]
    assert "meter" not in shown["c"]
    assert "--v:40.5%" in shown["a"]
    assert "--l:35.5%;width:10.0%" in shown["a"]
    assert "[35.5, 45.5]" in shown["a"]

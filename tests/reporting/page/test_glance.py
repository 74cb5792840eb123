"""The sentences at the top of the page."""

import math
import re

from bench.evaluation.summary import FrameLedger, Metric, ObjectMetrics
from bench.reference import Category
from bench.reporting.page.build import environment
from bench.reporting.page.summary import breakdown, remarks, tiles
from tests.reporting.summaries import figure, object_figures, summary


def told(figures, category=None):
    return [(remark.kind, remark.text) for remark in remarks(figures, category=category)]


def test_best_and_weakest_are_named_with_their_figures():
    (bad, weakest), (good, best), *others = told(summary())
    assert (good, bad) == ("good", "bad")
    found = "on average 70.0 % of an object is found, over 100 object-frames of 7 objects in 8 recordings"
    assert best == f"Best: overtaking, {found}."
    assert weakest.startswith("Weakest: preceding, on average 23.3 %")
    assert others[-1] == ("bad", "Wrongly marked as moving: 10.5 % of the image on average.")


def without_intervals(row, recordings=5):
    names = row.metric_names()
    few = {name: row.metric(name).model_copy(update={"ci95": None, "recordings": recordings}) for name in names}
    return ObjectMetrics(object_frames=row.object_frames, tracks=row.tracks, recordings=recordings, **few)


def test_no_kind_is_called_the_best_where_intervals_overlap():
    rows = {"crossing": object_figures(0.60), "overtaking": object_figures(0.62), "preceding": object_figures(0.64)}
    (bad, lowest), (kind, text), *others = told(summary().model_copy(update={"categories": rows}))
    assert (bad, kind) == ("bad", "note")
    assert lowest == "Lowest here: crossing, IoU 27.0 % (8 recordings, 95 % interval [22.0, 32.0])."
    assert text == (
        "Share of an object that is found, on average: crossing 42.0 %, overtaking 43.4 %, preceding 44.8 %; the "
        "recordings are too few to call one the best."
    )
    assert not any(word in other for _, other in others for word in ("Best", "Weakest"))


def test_nothing_is_claimed_of_fewer_than_six_recordings():
    rows = {"crossing": object_figures(0.9), "overtaking": object_figures(0.5)}
    few = rows | {"preceding": without_intervals(object_figures(0.1))}
    (_, weakest), (_, best), *others = told(summary().model_copy(update={"categories": few}))
    assert best.startswith("Best: crossing, ")
    assert best.endswith("Left out, with fewer than 6 recordings: preceding (5).")
    assert weakest.startswith("Weakest: overtaking, ")
    assert ("note", "Recordings too few to tell from chance, 6 are needed: preceding (5).") in others
    none = {name: without_intervals(row) for name, row in rows.items()}
    none["overtaking"].__pydantic_extra__["detection_rate_50"] = figure(0.0).model_copy(update={"ci95": None})
    texts = [text for _, text in told(summary().model_copy(update={"categories": none}))]
    assert texts[0] == "Lowest here: overtaking, IoU 22.5 %, not above chance (5 recordings, no interval)."
    assert not any(word in text for text in texts for word in ("Best", "Weakest", "Not clearly"))


def test_a_kind_that_chance_reaches_is_named():
    figures = summary()
    row = figures.categories["crossing"]
    lucky = row.model_copy(update={"detection_rate_50": Metric(value=0.2, ci95=(0.1, 0.3), cases=100, recordings=8)})
    lucky.__pydantic_extra__["chance_50"] = Metric(value=0.15, ci95=None, cases=100, recordings=8)
    lucky.__pydantic_extra__["detection_rate_50"] = Metric(value=0.2, ci95=(0.1, 0.3), cases=100, recordings=8)
    sentence = (
        "Not clearly better than chance when half of an object must be found: crossing (20.0 %, by chance 15.0 %)."
    )
    assert ("bad", sentence) not in told(figures)
    assert ("bad", sentence) in told(figures.model_copy(update={"categories": {"crossing": lucky}}))


def test_nothing_is_said_of_fewer_than_ten_object_frames():
    rows = {"crossing": object_figures(0.9), "overtaking": object_figures(0.5), "preceding": object_figures(0.1)}
    rows["preceding"] = object_figures(0.1, object_frames=9)
    ranges = {"[0, 2)": object_figures(0.1, object_frames=9), "[2, 4)": object_figures(0.6)}
    found = summary().model_copy(update={"categories": rows, "breakdowns": {"range_m": ranges}})
    texts = [text for _, text in told(found)]
    assert [text for text in texts if "preceding" in text] == [
        "Nothing is said of fewer than 10 object-frames: preceding (9)."
    ]
    assert not any("Where least" in text for text in texts)
    assert breakdown("By letter", "letter", ranges).lowest is None
    few = found.model_copy(update={"all_moving": object_figures(0.4, object_frames=9)})
    assert [tile.metric is None for tile in tiles(few, category=None)] == [True, False, True]


def test_the_page_begins_with_iou_beside_its_ceiling_and_false_positives():
    figures = summary()
    ceiling = Metric(value=0.92, ci95=None, cases=100, recordings=8)
    with_truth = figures.all_moving.model_copy(update={"ceiling_iou": ceiling})
    shown = tiles(figures.model_copy(update={"all_moving": with_truth}), category=None)
    assert [(tile.name, round(tile.metric.value, 3)) for tile in shown] == [
        ("IoU, all", 0.27), ("False positives", 0.105), ("TPR, all", 0.42)
    ]  # fmt: skip
    assert shown[0].beside == "ceiling 92.0 %: what exact masks get; over 100 object-frames"
    assert tiles(figures, category=None)[0].beside == "over 100 object-frames"
    assert [tile.name for tile in tiles(figures, category=Category.CROSSING)] == ["IoU, all", "TPR, all"]


def test_the_weakest_place_is_named_where_it_stands_out():
    rows = {"[0, 2)": object_figures(0.9), "[2, 4)": object_figures(0.2), "[4, 6)": object_figures(math.nan)}
    figures = summary().model_copy(update={"breakdowns": {"range_m": rows}})
    sentence = "Where least of an object is found (on average 42.0 %): range [2, 4) m with 14.0 %."
    assert ("bad", sentence) in told(figures)
    even = {name: object_figures(0.6) for name in rows}
    assert not any(
        "Where least" in text for _, text in told(summary().model_copy(update={"breakdowns": {"range_m": even}}))
    )


def test_images_that_were_not_scored_are_said():
    images = FrameLedger(images=10, evaluated=7, failed=2, skipped=1, problems={})
    texts = [text for _, text in told(summary().model_copy(update={"images": images}))]
    assert "3 of 10 images could not be scored; the last section says why." in texts


def test_a_page_of_one_kind_says_nothing_of_images():
    figures = summary()
    only = figures.model_copy(update={"categories": {"crossing": figures.categories["crossing"]}})
    assert all("of the image" not in text for _, text in told(only, Category.CROSSING))
    none = figures.model_copy(update={"categories": {"crossing": object_figures(math.nan)}})
    assert [kind for kind, _ in told(none, Category.CROSSING)] == ["note"]


def cells(rows):
    """What the page shows of the share found, by row."""
    found = breakdown("By letter", "letter", rows)
    table = str(environment().get_template("tables.html.j2").module.breakdown(found))
    lines = [re.findall(r"<td class=\"metric.*?</td>", line, flags=re.DOTALL) for line in table.split("<tr>")[2:]]
    place = list(found.metrics).index("tpr_all")
    return {name: line[place] for name, line in zip(rows, lines, strict=True)}


def test_the_lowest_of_a_table_is_marked_and_cells_without_cases_have_no_bar():
    rows = {"a": object_figures(0.9), "b": object_figures(0.2), "c": object_figures(math.nan)}
    shown = cells(rows)
    assert [name for name, cell in shown.items() if "lowest" in cell] == ["b"]
    assert not any("lowest" in cell for cell in cells(rows | {"b": without_intervals(rows["b"])}).values())
    assert "n/a (0 cases)" in shown["c"]
    assert "meter" not in shown["c"]
    assert "--v:63.0%" in shown["a"]
    assert "--l:58.0%;width:10.0%" in shown["a"]
    assert "58.0 to 68.0" in shown["a"]

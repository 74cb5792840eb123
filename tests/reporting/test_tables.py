import csv
import io
import math
import re
from dataclasses import replace

import pytest

from bench.reporting import run_tables
from bench.reporting.document import to_csv, to_markdown
from bench.reporting.formats import percent, with_interval
from bench.reporting.run_tables import (
    COMPARED,
    COVERAGES,
    detection_columns,
    report,
    table_rows,
    terminal_report,
)
from tests.reporting.printed import printed
from tests.reporting.summaries import banded_summary, figure, summary

CONSTRAINTS = ("epipolar", "positive_depth", "positive_height", "anti_parallel", "static_camera")
OF_PAPER = summary().model_copy(update={"false_positive_causes": dict.fromkeys(CONSTRAINTS, figure(0.2))})
ROWS = table_rows(OF_PAPER)


def markdown(rows):
    return to_markdown(report(rows).blocks)


def latex(rows):
    return run_tables.latex(rows, label="demo-spherical", about="method spherical_2, data set demo, paper-v1")


def table_csv(rows):
    return to_csv(report(rows).numbers)


def on_terminal(rows):
    return printed(terminal_report(rows, title="any"), width=100)


def table_lines(rows):
    return printed(terminal_report(rows, title="any")[:1], width=100).splitlines()


def number(text):
    return float(text) if text else math.nan


def same(a, b):
    return a == b or (math.isnan(a) and math.isnan(b))


def test_the_rows_are_the_papers_with_the_papers_values():
    assert [(row.label, row.paper_frames) for row in ROWS] == [
        ("Crossing (epipolar)", 3848),
        ("Overtaking (positive depth)", 2757),
        ("Preceding (positive height)", 789),
        ("Approaching (anti-parallel)", 224),
        ("Static ego-vehicle (degenerate)", 475),
        ("All moving", None),
        ("False positives", 5000),
    ]
    assert ROWS[0].paper == {"detection_rate": 0.72, "tpr": 0.64, "iou_detected": 0.55}
    assert ROWS[-1].paper == {"coverage": 0.13}


def test_rows_of_a_method_without_constraints_do_not_name_them():
    own = {"false_positive_causes": {"epipolar": figure(1.0)}}
    labels = [row.label for row in table_rows(summary().model_copy(update=own))]
    assert labels[:2] == ["Crossing (epipolar)", "Overtaking"]
    assert [row.label for row in table_rows(summary())] == [
        "Crossing", "Overtaking", "Preceding", "Approaching", "Static ego-vehicle", "All moving",
        "False positives",
    ]  # fmt: skip


def test_differences_are_percentage_points():
    assert ROWS[0].difference_points("detection_rate") == pytest.approx(0.14)
    assert ROWS[0].difference("detection_rate") == "+0.1"
    assert ROWS[0].difference("chance") == ""


def test_csv_carries_the_rows_without_loss():
    lines = {(line["row"], line["metric"]): line for line in csv.DictReader(io.StringIO(table_csv(ROWS)))}
    assert len(lines) == sum(len(row.metrics) for row in ROWS)
    for row in ROWS:
        for name, metric in row.metrics.items():
            line = lines[row.name, name]
            assert same(number(line["value"]), metric.value)
            assert same(number(line["paper"]), row.paper.get(name, math.nan))
            assert (line["frames"], line["recordings"]) == (str(row.frames), str(row.recordings))
            assert same(number(line["difference_points"]), row.difference_points(name))
            for end, bound in zip(("low", "high"), metric.ci95 or (math.nan, math.nan), strict=True):
                assert same(number(line[f"ci95_{end}"]), bound)


@pytest.mark.parametrize("write", [markdown, lambda rows: latex(rows).replace(r"\%", "%").replace(r"\\", "")])
def test_markdown_and_latex_show_the_same_values(write):
    text = write(ROWS)
    for row in (row for row in ROWS[:-1] if row.frames):
        for name in [*detection_columns(ROWS), *COVERAGES, "chance", "chance_10", "chance_50"]:
            assert with_interval(row.metrics[name]) in text
        for name in COMPARED:
            ours = percent(row.metrics[name].value, cases=row.metrics[name].cases)
            shown = [ours, row.paper_percent(name), row.difference(name)]
            assert re.search(r" +[|&] +".join(map(re.escape, shown)).replace(r"[|&] +$", ""), text)


def test_the_terminal_shows_the_same_values_at_100_columns():
    text = on_terminal(ROWS)
    assert max(map(len, table_lines(ROWS))) <= 100
    assert "…" not in text
    for row in (row for row in ROWS[:-1] if row.frames):
        for name in [*detection_columns(ROWS), *COVERAGES]:
            assert f"{100 * row.metrics[name].value:.1f}" in text
    assert "Static" not in text, "it has no cases"
    assert "Left out, without cases: static ego." in text
    crossing, false = (next(x for x in text.splitlines() if x.startswith(n)) for n in ("Crossing", "False positives"))
    assert false.index("10.5") == crossing.index("72.1"), "below the detection rate"
    crossing = text[text.index("Crossing") : text.index("Overtaking")].splitlines()
    assert " ".join(crossing[0].split()) == "Crossing ours 8 100 7 32.5 50.5 43.3 57.7 72.1 64.9 36.1"
    assert crossing[2].split() == ["chance", "28.9", "14.4", "7.2"]
    assert crossing[3].split() == ["paper", "3848", "55", "64", "72"]
    assert crossing[4].split() == ["diff.", "-11.7", "-6.3", "+0.1"]


def test_nothing_to_average_is_said_and_not_made_up():
    assert percent(math.nan) == "n/a (0 cases)"
    assert "n/a (0 cases)" in markdown(ROWS)
    assert "Static" not in latex(ROWS), "without cases"
    assert all("nan" not in write(ROWS).lower() for write in (markdown, latex))
    lines = csv.DictReader(io.StringIO(table_csv(ROWS)))
    (static,) = [line for line in lines if (line["row"], line["metric"]) == ("static_ego", "tpr")]
    assert [static[name] for name in ("value", "ci95_low", "cases", "paper", "difference_points")] == [
        "", "", "0", "0.78", ""
    ]  # fmt: skip
    assert "nan" not in table_csv(ROWS)


def test_rows_of_own_data_stand_beside_nothing():
    own = table_rows(OF_PAPER, beside_paper=False)
    assert [row.name for row in own] == [row.name for row in ROWS]
    for text in (markdown(own), latex(own), on_terminal(own)):
        assert "paper" not in text.replace("paper-v1", "").lower().replace("the paper's outlines", "")
        assert "diff" not in text
    assert "72.1 %" in markdown(own)


def test_latex_is_three_balanced_floats_with_labels_captions_and_notes():
    text = latex(ROWS)
    names = "results-by-category-of-objects", "detection", "coverage"
    assert re.findall(r"\\label\{(.*?)\}", text) == [f"tab:demo-spherical-{name}" for name in names]
    captions = re.findall(r"\\caption\{(.*)\}", text)
    assert all(r": method spherical\_2, data set demo, paper-v1. " in caption for caption in captions)
    assert text.count(r"Intervals: 95 \%") == 2
    assert text.count(r" with 95 \% intervals: method") == 2
    assert not re.search(r"(?<!\\)%", text)
    assert text.count(r"\begin{") == text.count(r"\end{")
    for table in text.split(r"\begin{tabular}")[1:]:
        columns = len(re.findall("[lr]", table[1 : table.index("}")]))
        rows = [line for line in table.splitlines() if line.endswith(r"\\")]
        assert {len(re.findall(r"(?<!\\)&", line)) + 1 for line in rows} == {columns}
    bare = [
        replace(row, metrics={n: m.model_copy(update={"ci95": None}) for n, m in row.metrics.items()}) for row in ROWS
    ]
    assert "with 95" not in latex(bare)


def test_markdown_tables_have_as_many_cells_in_every_line():
    for table in re.findall(r"(?:^\|.*\n)+", markdown(ROWS), flags=re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1


def test_the_unknown_share_stands_beside_each_row_of_a_protocol_with_bands_and_of_no_other():
    banded = table_rows(banded_summary())
    *rows, false_positives = banded
    assert {row.metrics["unknown_share"].value for row in rows} == {0.25}
    assert "unknown_share" not in false_positives.metrics
    for write, heading in ((markdown, "| Unknown |"), (latex, "& Unknown"), (on_terminal, "known\n")):
        assert heading in write(banded)
        assert heading not in write(ROWS)
    (line,) = [line for line in markdown(banded).splitlines() if line.startswith("| Crossing") and "25.0 %" in line]
    assert line.split("|")[-2].split() == ["25.0", "%", "[20.0,", "30.0]"]
    assert max(map(len, table_lines(banded))) <= 100
    assert "…" not in on_terminal(banded)

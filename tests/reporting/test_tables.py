"""The table of a run, the paper's rows and values beside ours, and a sweep: the same numbers in every form."""

import csv
import io
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from matplotlib.colors import to_hex

from bench.evaluation.summary import FalsePositiveMetrics, Metric, ObjectMetrics
from bench.evaluation.thresholds import ThresholdFreeMetrics
from bench.harness.stored import read_run
from bench.reporting.document import to_markdown
from bench.reporting.figures import BLUE, GREEN, PURPLE, VERMILION, draw_sweep
from bench.reporting.formats import headline_metrics, interval, percent, short_interval
from bench.reporting.run_tables import (
    COVERAGES,
    left_out_note,
    legend,
    report,
    results_table,
    sweep_report,
    table_rows,
    threshold_free_line,
    write_report_files,
)
from tests.reporting.compare.runs import drawn, write_run
from tests.reporting.printed import printed
from tests.reporting.summaries import banded_summary, figure, summary
from tests.support.stored_files import change_summary

CONSTRAINTS = ("epipolar", "positive_depth", "positive_height", "anti_parallel", "static_camera")
OF_PAPER = summary().model_copy(update={"false_positive_causes": dict.fromkeys(CONSTRAINTS, figure(0.2))})
ROWS = table_rows(OF_PAPER)
DETECTION = ["detection_rate", "detection_rate_10", "detection_rate_50"]


def markdown(rows):
    return to_markdown(report(rows).blocks)


def on_terminal(rows):
    return printed([results_table(rows, title="any", short=True)], width=100)


def numbers(rows):
    return list(csv.DictReader(io.StringIO(report(rows).numbers.to_csv())))


def same(text, value):
    return (math.nan if text == "" else float(text)) == value or (text == "" and math.isnan(value))


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
    assert ROWS[0].difference_points("detection_rate") == pytest.approx(0.14)


@pytest.mark.parametrize(
    ("causes", "labels"),
    [(("epipolar",), ["Crossing (epipolar)", "Overtaking"]), ((), ["Crossing", "Overtaking"])],
)
def test_rows_of_a_method_without_a_constraint_do_not_name_it(causes, labels):
    own = {"false_positive_causes": dict.fromkeys(causes, figure(1.0))}
    assert [row.label for row in table_rows(summary().model_copy(update=own))][:2] == labels


def test_csv_carries_the_rows_without_loss():
    lines = {(line["row"], line["metric"]): line for line in numbers(ROWS)}
    assert len(lines) == sum(len(row.metrics) for row in ROWS)
    for row in ROWS:
        for name, metric in row.metrics.items():
            line = lines[row.name, name]
            assert same(line["value"], metric.value)
            assert same(line["paper"], row.paper.get(name, math.nan))
            assert (line["frames"], line["recordings"]) == (str(row.frames), str(row.recordings))
            assert same(line["difference_points"], row.difference_points(name))
            for end, bound in zip(("low", "high"), metric.ci95 or (math.nan, math.nan), strict=True):
                assert same(line[f"ci95_{end}"], bound)
    static = lines["static_ego", "tpr"]
    assert [static[name] for name in ("value", "cases", "paper", "difference_points")] == ["", "0", "0.78", ""]


def test_markdown_and_terminal_show_the_same_values():
    text, shown = markdown(ROWS), on_terminal(ROWS)
    assert max(map(len, shown.splitlines())) <= 100
    assert "…" not in shown
    for row in (row for row in ROWS[:-1] if row.frames):
        for name in (*(COVERAGES.keys() & row.metrics), *DETECTION):
            metric = row.metrics[name]
            assert f"{100 * metric.value:.1f}<br>{interval(metric.ci95)}" in text
            if name != "detection_rate_10":
                assert f"{100 * metric.value:.1f}" in shown
                assert short_interval(metric.ci95) in shown
    crossing = next(line for line in text.splitlines() if line.startswith("| Crossing"))
    assert crossing.startswith("| Crossing<br>(epipolar)<br>paper: 3848 | 8 | 100 | 7 | 32.5<br>[27.5, 37.5] | ")
    assert crossing.count("paper") == 4
    assert "| 72.1<br>[67.1, 77.1]<br>chance 29<br>paper 72<br>+0.1 | 64.9<br>" in crossing
    lines = shown[shown.index("Crossing") : shown.index("Overtaking")].splitlines()
    assert lines[0].split() == ["Crossing", "8", "100", "7", "32.5", "50.5", "43.3", "57.7", "72.1", "36.1"]
    assert [line.split() for line in lines[2:4]] == [
        ["paper:", "3848", "paper", "55", "paper", "64", "chance", "29", "chance", "7"],
        ["-11.7", "-6.3", "paper", "72"],
    ]
    false = next(line for line in shown.splitlines() if line.startswith("False positives"))
    assert false.index("10.5") == lines[0].index("72.1"), "below the detection rate, as the paper has it"
    assert len({line.count("|") for line in text.splitlines() if line.startswith("|")}) == 1


def test_nothing_to_average_is_said_and_not_made_up():
    assert percent(math.nan) == "n/a (0 cases)"
    assert left_out_note(summary()) == "Left out, without cases: static ego."
    for text in (markdown(ROWS), on_terminal(ROWS), report(ROWS).numbers.to_csv()):
        assert "nan" not in text.lower()
    assert "Static" not in markdown(ROWS) + on_terminal(ROWS), "without cases"


def test_rows_of_own_data_stand_beside_nothing():
    own = table_rows(OF_PAPER, beside_paper=False)
    assert [row.name for row in own] == [row.name for row in ROWS]
    for text in (markdown(own).replace("paper-v1", ""), on_terminal(own)):
        assert "paper" not in text
    assert "72.1<br>[" in markdown(own)


def test_the_unknown_share_stands_beside_each_row_of_a_protocol_with_bands_and_of_no_other():
    banded = table_rows(banded_summary())
    *rows, false_positives = banded
    assert {row.metrics["unknown_share"].value for row in rows} == {0.25}
    assert "unknown_share" not in false_positives.metrics
    assert "| Unknown |" not in markdown(ROWS)
    (line,) = [line for line in markdown(banded).splitlines() if line.startswith("| Crossing")]
    assert line.endswith(" 25.0<br>[20.0, 30.0] |")


def test_the_legend_explains_what_its_table_shows():
    banded = table_rows(banded_summary())
    assert ["Unknown: " in legend(rows) for rows in (ROWS, banded)] == [False, True]
    assert "Unknown: " not in legend(banded, short=True), "no column of the terminal"
    assert "Ceiling: " not in legend(ROWS), "no ceiling is known"
    alone = [replace(row, metrics={name: m for name, m in row.metrics.items() if "chance" not in name}) for row in ROWS]
    assert ["Chance: " in legend(rows) for rows in (ROWS, alone)] == [True, False]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A run of images with one crossing vehicle each, half of it found."""
    run = write_run(tmp_path_factory.mktemp("run") / "run", drawn(50, categories=("crossing",)))
    change_summary(run, lambda summary: summary.update(caveats="Staged, not the paper's."))
    return run


def test_all_files_are_written_from_the_stored_results(stored):
    files = write_report_files(read_run(stored))
    assert files == (stored / "paper-v1" / "table.md", stored / "paper-v1" / "table.csv")
    assert files[0].read_text().rstrip().endswith("The data: Staged, not the paper's.")
    values = {(row["row"], row["metric"]): row["value"] for row in csv.DictReader(io.StringIO(files[1].read_text()))}
    assert float(values["crossing", "tpr"]) == 0.5
    assert float(values["crossing", "iou"]) == pytest.approx(50 / 110)
    assert float(values["false_positives", "coverage"]) == 0.01
    assert values["overtaking", "tpr"] == ""


def test_metrics_without_a_threshold_are_told_or_why_there_is_none():
    none = Metric(value=math.nan, ci95=None, cases=8547651, recordings=0)
    assert threshold_free_line(ThresholdFreeMetrics(auprc=none, fpr95=none, images=9)) == (
        "Over all thresholds: no AUPRC, since no object was evaluated in the 9 images with a likelihood."
    )
    known = ThresholdFreeMetrics(auprc=figure(0.5), fpr95=figure(0.2), images=1)
    assert threshold_free_line(known).startswith("Over all thresholds: AUPRC 50.0 % [45.0, 55.0], false-positive rate")


# A sweep.


def run(share, *, levels=("10", "50"), frames=40):
    shifts = {"detection_rate": 0, "chance": 0, "tpr": 0, "tpr_all": -0.01, "iou": -0.3, "iou_detected": 0}
    named = {name: figure(share + shift, spread=0.1) for name, shift in shifts.items()}
    named |= {f"detection_rate_{level}": figure(share - 0.05, spread=0.1) for level in levels}
    of_images = {name: figure(0.28, spread=0.02) for name in ("coverage", "coverage_valid", "frame_rate")}
    return SimpleNamespace(
        all_moving=ObjectMetrics(object_frames=frames, tracks=3, recordings=7, **named),
        false_positives=FalsePositiveMetrics(
            frames=12, recordings=8, components_per_frame=of_images["coverage"], **of_images
        ),
        images=SimpleNamespace(evaluated=12),
    )


RUNS = {"3e-4": run(0.9), "6e-4": run(0.8, frames=38), "1e-2": run(0.6)}


def axes_of(runs):
    metrics = {value: headline_metrics(summary) for value, summary in runs.items()}
    (axes,) = draw_sweep("threshold", metrics, title="threshold on demo").axes
    return axes


def test_csv_and_markdown_have_one_line_per_value():
    told = sweep_report("threshold", RUNS | {"1": run(math.nan)}, title="", note="A note.")
    lines = list(csv.DictReader(io.StringIO(told.numbers.to_csv())))
    assert [line["threshold"] for line in lines] == ["3e-4", "6e-4", "1e-2", "1"]
    assert [line["object_frames"] for line in lines] == ["40", "38", "40", "40"]
    assert float(lines[1]["tpr_all"]) == 0.8 - 0.01, "at full precision"
    assert float(lines[1]["iou.ci95_low"]) == pytest.approx(0.4)
    assert lines[1]["false_positive_coverage"] == "0.28"
    assert (lines[1]["recordings"], lines[1]["images"]) == ("7", "12")
    assert lines[3]["iou"] == lines[3]["iou.ci95_high"] == ""
    text = to_markdown(told.blocks)
    assert "| threshold | Images | Object-frames | Recordings | IoU, all | TPR, all | Detection at 50 % |" in text
    shares = "30.0 %<br>[20.0, 40.0] | 59.0 %<br>[49.0, 69.0] | 55.0 %<br>[45.0, 65.0] | 28.0 %"
    assert f"| 1e-2 | 12 | 40 | 7 | {shares}" in text
    assert text.count("fewer than 6 recordings have none") == text.count("A note.") == 1
    assert "| 1 | 12 | 40 | 7 | n/a<br>(0 cases) |" in text


def test_a_protocol_without_the_level_has_no_such_column():
    runs = {value: run(0.5, levels=("10",)) for value in ("1e-3", "2e-3")}
    told = sweep_report("threshold", runs, title="t")
    assert "Detection at 50 %" not in to_markdown(told.blocks)
    assert "detection_rate_50" not in told.numbers
    assert len(axes_of(runs).lines) == 3


def test_chart_draws_the_metrics_in_percent_with_their_intervals():
    axes = axes_of(RUNS)
    lines = {to_hex(line.get_color()): line for line in axes.lines}
    assert set(lines) == {BLUE, GREEN, PURPLE, VERMILION}
    assert [label.get_text() for label in axes.get_xticklabels()] == [*RUNS]
    assert lines[BLUE].get_ydata() == pytest.approx([85, 75, 55])
    assert axes.collections[-1].get_segments()[0][:, 1] == pytest.approx((26, 30))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("threshold", "percent")


def test_the_files_of_a_sweep(tmp_path):
    files = sweep_report("threshold", RUNS, title="threshold on demo").write(tmp_path, "sweep")
    assert sorted(file.name for file in files) == ["sweep.csv", "sweep.html", "sweep.md"]
    assert "<svg" in (tmp_path / "sweep.html").read_text()

"""A sweep as table and chart: the same numbers everywhere, nothing invented where there is none."""

import csv
import io
import math
from types import SimpleNamespace

import pytest
from matplotlib.colors import to_hex

from bench.evaluation import FalsePositiveMetrics, ObjectMetrics
from bench.reporting.document import to_csv, to_markdown
from bench.reporting.figures import BLUE, GREEN, PURPLE, VERMILION, draw_sweep
from bench.reporting.formats import headline_metrics
from bench.reporting.run_tables import sweep_report, write_sweep
from tests.reporting.summaries import figure


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
    lines = list(csv.DictReader(io.StringIO(to_csv(told.numbers))))
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
    assert "detection_rate_50" not in to_csv(told.numbers)
    assert len(axes_of(runs).lines) == 3


def test_chart_draws_the_metrics_in_percent_with_their_intervals():
    axes = axes_of({"6e-4": run(0.8), "3e-4": run(0.9), "1e-2": run(0.6)})
    lines = {to_hex(line.get_color()): line for line in axes.lines}
    assert set(lines) == {BLUE, GREEN, PURPLE, VERMILION}
    assert lines[BLUE].get_xdata().tolist() == [3e-4, 6e-4, 1e-2], "by value, however they were given"
    assert lines[BLUE].get_ydata() == pytest.approx([85, 75, 55])
    assert axes.collections[-1].get_segments()[0][:, 1] == pytest.approx((26, 30))
    assert (axes.get_xscale(), axes.get_xlabel(), axes.get_ylabel()) == ("log", "threshold", "percent")


@pytest.mark.parametrize(
    ("values", "at"), [(("-1", "0", "20"), [-1, 0, 20]), (("5", "8"), [5, 8]), (("dis", "farneback"), [0, 1])]
)
def test_values_that_are_no_numbers_stand_side_by_side(values, at):
    axes = axes_of({value: run(0.5) for value in values})
    assert (axes.get_xscale(), axes.lines[0].get_xdata().tolist()) == ("linear", at)
    if values[0] == "dis":
        assert [label.get_text() for label in axes.get_xticklabels()] == ["dis", "farneback"]


def test_the_files_of_a_sweep(tmp_path):
    files = write_sweep(tmp_path, "threshold", RUNS, title="threshold on demo")
    assert sorted(file.name for file in files) == ["sweep.csv", "sweep.html", "sweep.md"]
    assert "<svg" in (tmp_path / "sweep.html").read_text()

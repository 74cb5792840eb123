"""A sweep as table and chart: the same numbers everywhere, nothing invented where there is none."""

import csv
import io
import math
from itertools import pairwise

import pytest
from matplotlib.colors import to_hex
from rich.console import Console

from bench.evaluation import FalsePositiveMetrics, Metric, ObjectMetrics
from bench.harness.method_stamp import MethodStamp
from bench.harness.sweep import SweepResult, SweepRow
from bench.harness.sweep.results import FlowCalls, write_sweep
from bench.records.reference import Category
from bench.reporting.canvas import BLUE, GREY, VERMILION
from bench.reporting.sweep import draw_sweep, shown_labels, to_csv, to_markdown, to_rich, write_sweep_files
from tests.support.manifests import provenance


def figure(value, *, spread=0.1, cases=40):
    if math.isnan(value):
        return Metric(value=value, ci95=None, cases=0, recordings=0)
    return Metric(value=value, ci95=(value - spread, value + spread), cases=cases, recordings=7)


def object_figures(value, *, frames=40, levels=("10", "50")):
    names = ("detection_rate", "chance", "tpr", "tpr_all", "iou", "iou_detected")
    shifts = {"tpr_all": -0.01, "iou": -0.3, "iou_detected": -0.25}
    named = {name: figure(value + shifts.get(name, 0)) for name in names}
    named |= {f"detection_rate_{level}": figure(value - 0.05) for level in levels}
    return ObjectMetrics(object_frames=frames, tracks=3, recordings=7 if frames else 0, **named)


def row(value, share, *, operating=False, levels=("10", "50")):
    nan = math.nan
    return SweepRow(
        value=value,
        operating=operating,
        settings={},
        protocol_digest="d",
        injected={},
        categories={
            kind.value: object_figures(nan, frames=0) if kind is Category.PRECEDING else object_figures(share)
            for kind in Category
            if kind is not Category.MOVING
        },
        all_moving=object_figures(share, levels=levels),
        false_positives=FalsePositiveMetrics(
            frames=12,
            recordings=8,
            coverage=figure(0.28, spread=0.02),
            coverage_valid=figure(0.3),
            frame_rate=figure(0.9),
            components_per_frame=figure(3.0),
        ),
    )


def sweep(*rows, scale="log", part="method", **more):
    return SweepResult(
        schema_version=1,
        what="threshold",
        title="threshold of the likelihood",
        about="",
        part=part,
        scale=scale,
        dataset="demo",
        card="demo.yaml",
        split=None,
        method=MethodStamp(name="spherical", settings={}),
        protocol="paper-v1",
        rows=rows or (row(3e-4, 0.9), row(6e-4, 0.8, operating=True), row(1e-3, 0.6)),
        flow=FlowCalls(computed=12, read=0),
        provenance=provenance(images=12),
        failures=(),
        **more,
    )


def panels(result):
    return {axes.get_title().split("\n")[0]: axes for axes in draw_sweep(result).axes}


def test_csv_has_one_line_per_value_at_full_precision():
    lines = list(csv.DictReader(io.StringIO(to_csv(sweep()))))
    assert [line["value"] for line in lines] == ["0.0003", "0.0006", "0.001"]
    assert [line["operating"] for line in lines] == ["0", "1", "0"]
    assert float(lines[1]["all_moving.tpr_all"]) == 0.8 - 0.01
    assert float(lines[1]["crossing.iou.ci95_low"]) == pytest.approx(0.4)
    assert lines[1]["false_positive_coverage"] == "0.28"
    assert (lines[1]["recordings"], lines[1]["crossing.recordings"]) == ("8", "7")
    assert lines[1]["preceding.tpr"] == lines[1]["preceding.tpr.ci95_high"] == ""
    groups = {name.split(".")[0] for name in lines[0] if "." in name}
    assert groups == {
        "all_moving",
        "false_positive_coverage",
        *(kind.value for kind in Category if kind is not Category.MOVING),
    }


def test_markdown_has_a_table_per_kind_of_motion_and_marks_the_operating_value():
    text = to_markdown(sweep())
    assert text.count("| **0.0006** (operating) |") == 6
    assert "75.0 % [65.0, 85.0]" in text
    assert "28.0 % [26.0, 30.0]" in text
    assert "| 0.001 | 7 | 40 | 55.0 % [45.0, 65.0] |" in text
    assert text.count("fewer than 6 recordings have none") == 1
    assert "| 0.001 | 0 | 0 | n/a (0 cases) |" in text
    tables = [block for block in text.rstrip().split("\n\n") if block.startswith("|")]
    for block in tables:
        lines = block.split("\n")
        assert len({line.count("|") for line in lines}) == 1
        assert len(lines) == 2 + 3


def test_what_injected_errors_reach_is_said_in_every_form():
    result = sweep(part="input")
    said = "They reach the method only"
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(to_rich(result))
    assert said in to_markdown(result)
    assert said in " ".join(console.export_text().split())
    assert any(said in text.get_text() for text in draw_sweep(result).texts)


def test_terminal_table_fits_and_shows_all_moving_and_each_kind():
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(to_rich(sweep(*(row(name, 0.5) for name in ("all", "without positive_height")), scale="names")))
    shown = console.export_text()
    assert "without positive height" in shown
    assert "45.0" in shown  # detection at 50 %
    assert "35-55" in shown
    assert "Recs" in shown
    assert "n/a" in shown  # preceding has no cases
    assert "…" not in shown
    assert all(len(line) <= 110 for line in shown.splitlines())


def test_a_protocol_without_the_level_has_no_such_column():
    rows = [row(value, 0.5, levels=("10",)) for value in (1e-3, 2e-3)]
    assert "Detection at 50 %" not in to_markdown(sweep(*rows))
    assert "detection_rate_50" not in to_csv(sweep(*rows))


def test_chart_draws_the_figures_in_percent_with_their_intervals():
    drawn = panels(sweep())
    assert len(drawn) == 8  # all, false positives, five kinds, legend
    lines = {to_hex(line.get_color()): line for line in drawn["All moving"].lines if line.get_linestyle() == "-"}
    assert lines[BLUE].get_xdata().tolist() == [3e-4, 6e-4, 1e-3]
    assert lines[BLUE].get_ydata() == pytest.approx([85, 75, 55])
    band = drawn["False-positive coverage"].collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == pytest.approx((26, 30))
    assert [to_hex(line.get_color()) for line in drawn["False-positive coverage"].lines] == [VERMILION, GREY]
    assert drawn["All moving"].get_xscale() == "log"


def test_chart_marks_the_operating_value_and_names_its_axes():
    drawn = panels(sweep())
    for title, axes in drawn.items():
        if title:
            marks = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == ":"]
            assert marks == [6e-4], title
    assert drawn["Static ego-vehicle"].get_xlabel() == "threshold of the likelihood"
    assert drawn["All moving"].get_ylabel() == "percent"
    assert "40 object-frames, 7 recordings" in drawn["Crossing"].get_title()


def test_names_are_points_side_by_side_with_their_names_below():
    rows = [row("all", 0.9, operating=True), row("only epipolar", 0.7), row("without anti_parallel", 0.8)]
    drawn = panels(sweep(*rows, scale="names"))
    axes = drawn["Overtaking"]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["all", "only epipolar", "without anti parallel"]
    starts = sorted(round(float(line.get_xdata()[0]), 2) for line in axes.lines if line.get_linestyle() == "None")
    assert starts == [-0.26, -0.13, 0.0, 0.13, 0.26]


def test_a_sweep_of_the_reference_says_how_many_object_frames_each_value_has():
    few = row(3, 0.9).model_copy(update={"all_moving": object_figures(0.9, frames=50)})
    drawn = panels(sweep(few, row(10, 0.8, operating=True), scale="linear", part="reference"))
    assert "40 to 50 object-frames" in drawn["All moving"].get_title(), list(drawn)


def test_files_are_written_beside_the_stored_sweep_and_do_not_change(tmp_path):
    write_sweep(tmp_path, sweep())
    files = write_sweep_files(tmp_path)
    assert [file.name for file in files[:5]] == ["sweep.json", "sweep.md", "sweep.csv", "sweep.png", "sweep.svg"]
    before = {file: file.read_bytes() for file in files}
    assert before[tmp_path / "sweep.png"].startswith(b"\x89PNG")
    write_sweep_files(tmp_path)
    assert {file: file.read_bytes() for file in files} == before


@pytest.mark.parametrize(
    ("values", "scale"),
    [((3e-4, 4.5e-4, 6e-4, 7e-4, 8e-4, 9e-4), "log"), ((-0.0025, -0.00125, 0.0, 0.00125, 0.0025, 0.01), "linear")],
)
def test_labels_of_values_do_not_overlap(values, scale):
    result = sweep(*(row(value, 0.5, operating=value in (6e-4, 0.0)) for value in values), scale=scale)
    figure = draw_sweep(result)
    for axes in figure.axes:
        labels = [label for label in axes.get_xticklabels() if label.get_text() and axes.xaxis.get_visible()]
        ends = [label.get_window_extent() for label in labels]
        assert all(left.x1 < right.x0 for left, right in pairwise(ends))
    assert {"0.0006", "0"} & set(shown_labels(result))
    assert {f"{values[0]:g}", f"{values[-1]:g}"} <= set(shown_labels(result))

"""A sweep as a table: one row per value, for files and for the terminal."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation import Metric, ObjectMetrics
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.harness.sweep import SweepResult, SweepRow
from bench.plain_text import escape_markdown
from bench.reference.records import Category
from bench.reporting.sheets import INTERVALS, count
from bench.reporting.tables import LABELS

FIGURES = {
    "detection_rate_50": "Detection at 50 %",
    "tpr_all": "TPR, all",
    "tpr": "TPR, detected",
    "iou": "IoU, all",
    "iou_detected": "IoU, detected",
}
ALL_MOVING = "all_moving"
COVERAGE = "false_positive_coverage"
PARTS = {
    "method": "The values change the method; the reference is the same for all.",
    "reference": "The values change the reference, not the method: which objects are evaluated, or their polygons.",
    "input": (
        "The values are errors of what the method is told. They reach the method only: the reference keeps the true "
        "calibration and ego-motion."
    ),
}
NOTE = (
    "TPR and IoU: averages over all object-frames, or over the detected ones. False-positive coverage: share of the "
    f"image's area. {INTERVALS} All values are of the same images, so their intervals move together."
)
_SHORT = {
    Category.CROSSING: "cross.",
    Category.OVERTAKING: "overt.",
    Category.PRECEDING: "prec.",
    Category.APPROACHING: "appr.",
    Category.STATIC_EGO: "stat.",
    Category.MOVING: "mov.",
}


def shown_figures(result: SweepResult) -> dict[str, str]:
    """Names and headings of the figures; detection at 50 % only where the protocol has that level."""
    names = result.rows[0].all_moving.metric_names()
    return {name: heading for name, heading in FIGURES.items() if name in names}


def groups(row: SweepRow) -> Iterator[tuple[str, str, ObjectMetrics]]:
    """Name, label and figures of all moving objects, then of each category."""
    yield ALL_MOVING, "All moving", row.all_moving
    for name, figures in row.categories.items():
        yield name, LABELS[Category(name)], figures


def value_text(row: SweepRow) -> str:
    """The value of a row, for example "0.0006" or "without epipolar"."""
    return row.value.replace("_", " ") if isinstance(row.value, str) else f"{row.value:g}"


def to_markdown(result: SweepResult) -> str:
    """One table for all moving objects with the false positives, then one per category; GitHub's Markdown."""
    head = (
        f"# Sweep `{result.what}` on {escape_markdown(result.dataset)}: {result.title}\n\n{PARTS[result.part]} {NOTE}"
    )
    return "\n\n".join([head, *(_markdown_group(result, index) for index in range(_group_count(result)))]) + "\n"


def to_csv(result: SweepResult) -> str:
    """One line per value; ratios in [0, 1] at full precision, empty where there is no number."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(_csv_row(result.rows[0], result)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(_csv_row(row, result) for row in result.rows)
    return buffer.getvalue()


def to_rich(result: SweepResult) -> Table:
    """One row per value, in percent: all moving objects with intervals below, and TPR over all by category."""
    figures = {name: heading for name, heading in shown_figures(result).items() if name not in {"tpr", "iou_detected"}}
    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        title=f"Sweep {result.what} on {result.dataset}: {result.title}; figures in percent",
        title_justify="left",
        caption=Text(
            "TPR by kind of motion: over all its object-frames. *: the operating value. Recs: recordings, under "
            f"{FEWEST_RECORDINGS} no interval.\n{PARTS[result.part]}"
        ),
        caption_justify="left",
    )
    table.add_column("Value", no_wrap=True)
    table.add_column("Recs", justify="right", no_wrap=True)
    for heading in (*figures.values(), "False pos.\ncoverage"):
        lines = Text(heading.replace(" at ", "\nat ").replace(", ", ",\n"))
        table.add_column(lines, justify="right", no_wrap=True)
    for name in result.rows[0].categories:
        table.add_column(Text(f"TPR\n{_SHORT[Category(name)]}"), justify="right", no_wrap=True)
    for row in result.rows:
        cells = [_with_bounds(row.all_moving.metric(name)) for name in figures]
        cells.append(_with_bounds(row.false_positives.coverage))
        cells += [Text(_number(kind.tpr_all)) for kind in row.categories.values()]
        head = value_text(row) + (" *" if row.operating else ""), count(row.all_moving.recordings)
        table.add_row(*head, *cells, style="bold" if row.operating else "")
    return table


def _group_count(result: SweepResult) -> int:
    return 1 + len(result.rows[0].categories)


def _markdown_group(result: SweepResult, index: int) -> str:
    shown = shown_figures(result)
    name, label, _ = list(groups(result.rows[0]))[index]
    last = ["False-positive coverage"] if name == ALL_MOVING else []
    lines = [[result.title, "Recordings", "# Frames", *shown.values(), *last]]
    for row in result.rows:
        _, _, figures = list(groups(row))[index]
        cells = [_markdown_figure(figures.metric(figure)) for figure in shown]
        cells += [_markdown_figure(row.false_positives.coverage)] if last else []
        value = f"**{value_text(row)}** (operating)" if row.operating else value_text(row)
        lines.append([value, str(figures.recordings), str(figures.object_frames), *cells])
    rule = ["---", *("---:" for _ in lines[0][1:])]
    rows = [f"| {' | '.join(line)} |" for line in (lines[0], rule, *lines[1:])]
    return "\n".join([f"**{label}**", "", *rows])


def _markdown_figure(figure: Metric) -> str:
    if math.isnan(figure.value):
        return f"n/a ({figure.cases} cases)"
    bounds = "" if figure.ci95 is None else f" [{100 * figure.ci95[0]:.1f}, {100 * figure.ci95[1]:.1f}]"
    return f"{100 * figure.value:.1f} %{bounds}"


def _csv_row(row: SweepRow, result: SweepResult) -> dict[str, object]:
    cells: dict[str, object] = {
        "sweep": result.what,
        "value": row.value,
        "operating": int(row.operating),
        "image_frames": row.false_positives.frames,
        "recordings": count(row.false_positives.recordings),
    }
    cells |= _csv_figure(COVERAGE, row.false_positives.coverage)
    for group, _, figures in groups(row):
        cells[f"{group}.object_frames"] = figures.object_frames
        cells[f"{group}.recordings"] = figures.recordings
        for name in shown_figures(result):
            cells |= _csv_figure(f"{group}.{name}", figures.metric(name))
    return cells


def _csv_figure(name: str, figure: Metric) -> dict[str, object]:
    low, high = figure.ci95 or (math.nan, math.nan)
    numbers = {name: figure.value, f"{name}.ci95_low": low, f"{name}.ci95_high": high}
    return {key: "" if math.isnan(number) else repr(number) for key, number in numbers.items()}


def _with_bounds(figure: Metric) -> Text:
    if math.isnan(figure.value):
        return Text(f"n/a ({figure.cases})")
    bounds = "" if figure.ci95 is None else f"{100 * figure.ci95[0]:.0f}-{100 * figure.ci95[1]:.0f}"
    return Text(f"{_number(figure)}\n{bounds}")


def _number(figure: Metric) -> str:
    return "n/a" if math.isnan(figure.value) else f"{100 * figure.value:.1f}"

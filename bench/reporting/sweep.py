"""A sweep for people: one row per value as Markdown, CSV and terminal table, and a chart of small multiples."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from rich.table import Table
from rich.text import Text

from bench.evaluation import Metric, ObjectMetrics, find_metric
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.harness.sweep import FILE, SweepResult, SweepRow, read_sweep
from bench.plain_text import escape_markdown
from bench.records.reference import Category
from bench.reporting import canvas, formats

METRICS = {name: find_metric(name).label for name in ("detection_rate_50", "tpr_all", "tpr", "iou", "iou_detected")}
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
    f"image's area. {formats.INTERVALS} All values are of the same images, so their intervals move together."
)
_SHORT = {
    Category.CROSSING: "cross.",
    Category.OVERTAKING: "overt.",
    Category.PRECEDING: "prec.",
    Category.APPROACHING: "appr.",
    Category.STATIC_EGO: "stat.",
    Category.MOVING: "mov.",
}


def _shown(result: SweepResult) -> dict[str, str]:
    """Names and headings of the metrics; detection at 50 % only where the protocol has that level."""
    names = result.rows[0].all_moving.metric_names()
    return {name: heading for name, heading in METRICS.items() if name in names}


def _groups(row: SweepRow) -> Iterator[tuple[str, str, ObjectMetrics]]:
    """Name, label and metrics of all moving objects, then of each category."""
    yield ALL_MOVING, "All moving", row.all_moving
    for name, found in row.categories.items():
        yield name, formats.LABELS[Category(name)], found


def _value(row: SweepRow) -> str:
    """The value of a row, for example "0.0006" or "without epipolar"."""
    return row.value.replace("_", " ") if isinstance(row.value, str) else f"{row.value:g}"


def to_markdown(result: SweepResult) -> str:
    """One table for all moving objects with the false positives, then one per category; GitHub's Markdown."""
    title = f"# Sweep `{result.what}` on {escape_markdown(result.dataset)}: {result.title}"
    tables = (_markdown(result, rows) for rows in zip(*(_groups(row) for row in result.rows), strict=True))
    return "\n\n".join([title, f"{PARTS[result.part]} {NOTE}", *tables]) + "\n"


def _markdown(result: SweepResult, groups: Sequence[tuple[str, str, ObjectMetrics]]) -> str:
    shown, with_coverage = _shown(result), groups[0][0] == ALL_MOVING
    headings = [result.title, "Recordings", "Object-frames", *shown.values()]
    lines = []
    for row, (_, _, found) in zip(result.rows, groups, strict=True):
        value = f"**{_value(row)}** (operating)" if row.operating else _value(row)
        metrics = [found.metric(name) for name in shown] + [row.false_positives.coverage] * with_coverage
        lines.append([value, str(found.recordings), str(found.object_frames), *map(formats.with_interval, metrics)])
    headings += ["False-positive coverage"] * with_coverage
    return f"**{groups[0][1]}**\n\n{formats.markdown_table(headings, lines, rules=('---', '---:'), escape=False)}"


def to_csv(result: SweepResult) -> str:
    """One line per value; ratios in [0, 1] at full precision, empty where there is no number."""
    return formats.csv_text([_csv_row(row, result) for row in result.rows])


def _csv_row(row: SweepRow, result: SweepResult) -> dict[str, object]:
    cells: dict[str, object] = {
        "sweep": result.what,
        "value": row.value,
        "operating": int(row.operating),
        "image_frames": row.false_positives.frames,
        "recordings": row.false_positives.recordings,
    }
    cells |= _csv_cells(COVERAGE, row.false_positives.coverage)
    for group, _, found in _groups(row):
        cells |= {f"{group}.object_frames": found.object_frames, f"{group}.recordings": found.recordings}
        for name in _shown(result):
            cells |= _csv_cells(f"{group}.{name}", found.metric(name))
    return cells


def _csv_cells(name: str, metric: Metric) -> dict[str, object]:
    low, high = metric.ci95 or (None, None)
    return {name: metric.value, f"{name}.ci95_low": low, f"{name}.ci95_high": high}


def to_rich(result: SweepResult) -> Table:
    """One row per value, in percent: all moving objects with intervals below, and TPR over all by category."""
    shown = {name: heading for name, heading in _shown(result).items() if name not in {"tpr", "iou_detected"}}
    caption = (
        "TPR by kind of motion: over all its object-frames. *: the operating value. Recs: recordings, under "
        f"{FEWEST_RECORDINGS} no interval.\n{PARTS[result.part]}"
    )
    title = f"Sweep {result.what} on {result.dataset}: {result.title}; in percent"
    table = formats.terminal_table(title, caption=Text(caption))
    table.add_column("Value", no_wrap=True)
    metrics = [heading.replace(" at ", "\nat ").replace(", ", ",\n") for heading in shown.values()]
    kinds = [f"TPR\n{_SHORT[Category(name)]}" for name in result.rows[0].categories]
    formats.number_columns(table, ["Recs", *metrics, "False pos.\ncoverage", *kinds])
    for row in result.rows:
        cells = [_cell(row.all_moving.metric(name)) for name in shown] + [_cell(row.false_positives.coverage)]
        cells += [Text(formats.hundredths(kind.tpr_all.value)) for kind in row.categories.values()]
        head = _value(row) + (" *" if row.operating else ""), str(row.all_moving.recordings)
        table.add_row(*head, *cells, style="bold" if row.operating else "")
    return table


def _cell(metric: Metric) -> Text:
    if math.isnan(metric.value):
        return Text(f"n/a ({metric.cases})")
    return Text(f"{formats.hundredths(metric.value)}\n{formats.short_interval(metric)}")


# Colour, line, marker, and the shift beside the tick where the values are names.
LOOKS: dict[str, tuple[str, Literal["-", "--", ""], str | None, float]] = {
    "detection_rate_50": (canvas.BLUE, "-", "o", -0.26),
    "tpr_all": (canvas.GREEN, "-", "s", -0.13),
    "tpr": (canvas.GREEN, "--", None, 0.0),
    "iou": (canvas.PURPLE, "-", "^", 0.13),
    "iou_detected": (canvas.PURPLE, "--", None, 0.26),
    COVERAGE: (canvas.VERMILION, "-", "D", 0.0),
}
COLUMNS = 4
_LEGEND_AT = COLUMNS - 1  # the upper right corner, so that every column has its axis below
_WIDTH_IN, _PANEL_IN, _GAP_X_IN, _GAP_Y_IN = 11.0, 2.1, 0.22, 0.42
_LEFT_IN, _RIGHT_IN, _TOP_IN = 0.55, 0.12, 0.78
_BOTTOM_IN, _LETTER_IN = 0.55, 0.055  # names of values are upright below their ticks
_MARGIN = 0.05  # of an axis beyond its values
_PANEL_WIDTH_IN = (_WIDTH_IN - _LEFT_IN - _RIGHT_IN - (COLUMNS - 1) * _GAP_X_IN) / COLUMNS


@canvas.styled
def draw_sweep(result: SweepResult) -> Picture:
    """Draw the metrics of every value with their 95 % intervals; the operating value is marked."""
    groups = list(zip(*(_groups(row) for row in result.rows), strict=True))
    names = [_value(row) for row in result.rows if result.scale == "names"]
    bottom_in = _BOTTOM_IN + _LETTER_IN * max(map(len, names), default=0)
    slots = len(groups) + 2
    lines = -(-slots // COLUMNS)
    height_in = _TOP_IN + lines * _PANEL_IN + (lines - 1) * _GAP_Y_IN + bottom_in
    picture = canvas.new_figure(_WIDTH_IN, height_in)
    panels = [_panel(picture, slot, bottom_in + (lines - 1 - slot // COLUMNS) * (_PANEL_IN + _GAP_Y_IN))
              for slot in range(slots)]  # fmt: skip
    drawn = [slot for slot in range(slots) if slot != _LEGEND_AT]
    of_coverage = drawn.pop(1)
    for slot, group in zip(drawn, groups, strict=True):
        _draw_objects(panels[slot], result, group[0][1], [found for _, _, found in group])
    _draw_coverage(panels[of_coverage], result)
    for slot in (*drawn, of_coverage):
        _finish_axes(panels[slot], result, first=slot % COLUMNS == 0, last=slot + COLUMNS >= slots)
    _draw_legend(panels[_LEGEND_AT], result)
    left, top = _LEFT_IN / _WIDTH_IN, 1 - 0.08 / height_in
    picture.text(left, top, f"Sweep {result.what} on {result.dataset}: {result.title}", va="top", fontsize=10)
    picture.text(left, top - 0.22 / height_in, PARTS[result.part], va="top", fontsize=7, color="#555555")
    return picture


def _panel(picture: Picture, slot: int, bottom_in: float) -> Axes:
    left_in = _LEFT_IN + slot % COLUMNS * (_PANEL_WIDTH_IN + _GAP_X_IN)
    return canvas.axes_at(picture, left_in, bottom_in, _PANEL_WIDTH_IN, _PANEL_IN)


def _draw_objects(axes: Axes, result: SweepResult, label: str, rows: Sequence[ObjectMetrics]) -> None:
    for name in _shown(result):
        _draw(axes, result, name, [row.metric(name) for row in rows])
    frames, recordings = _counts([row.object_frames for row in rows]), _counts([row.recordings for row in rows])
    axes.set_title(f"{label}\n{frames} object-frames, {recordings} recordings", pad=3)


def _draw_coverage(axes: Axes, result: SweepResult) -> None:
    _draw(axes, result, COVERAGE, [row.false_positives.coverage for row in result.rows])
    frames = _counts([row.false_positives.frames for row in result.rows])
    axes.set_title(f"False-positive coverage\n{frames} image-frames", pad=3)


def _draw(axes: Axes, result: SweepResult, name: str, metrics: Sequence[Metric]) -> None:
    """One metric over the values, in percent, with its interval."""
    colour, dash, marker, shift = LOOKS[name]
    values = 100 * np.array([metric.value for metric in metrics])
    low, high = 100 * np.array([metric.ci95 or (np.nan, np.nan) for metric in metrics]).T
    x = _positions(result)
    if result.scale == "names":
        axes.vlines(x + shift, low, high, color=colour, linewidth=1.0, alpha=0.6)
        axes.plot(x + shift, values, color=colour, linestyle="", marker=marker or "_", markersize=3.5)
    else:
        axes.fill_between(x, low, high, color=colour, alpha=0.12, linewidth=0)
        axes.plot(x, values, color=colour, linestyle=dash, marker=marker, markersize=3, linewidth=1.2)


def _positions(result: SweepResult) -> NDArray[np.float64]:
    values = range(len(result.rows)) if result.scale == "names" else [row.value for row in result.rows]
    return np.array(values, dtype=np.float64)


def shown_labels(result: SweepResult) -> list[str]:
    """The values of a numeric sweep as labels of their ticks, "" where they would touch those that are shown.

    The operating value and both ends come first.
    """
    x = _positions(result)
    at = np.log10(x) if result.scale == "log" else x
    at_in = (at - at.min()) / (np.ptp(at) or 1.0) * _PANEL_WIDTH_IN / (1 + 2 * _MARGIN)
    labels = [_value(row) for row in result.rows]
    half_in = [_LETTER_IN * (len(label) + 1) / 2 for label in labels]
    last = len(labels) - 1
    first = sorted(range(len(labels)), key=lambda k: (not result.rows[k].operating, k not in {0, last}, k))
    shown: list[int] = []
    for k in first:
        if all(abs(at_in[k] - at_in[other]) >= half_in[k] + half_in[other] for other in shown):
            shown.append(k)
    return [label if k in shown else "" for k, label in enumerate(labels)]


def _limits(result: SweepResult) -> tuple[float, float]:
    """Ends of the axis of a numeric sweep."""
    x = _positions(result)
    at = np.log10(x) if result.scale == "log" else x
    margin = _MARGIN * (np.ptp(at) or 1.0)
    low, high = float(at.min() - margin), float(at.max() + margin)
    return (10.0**low, 10.0**high) if result.scale == "log" else (low, high)


def _finish_axes(axes: Axes, result: SweepResult, *, first: bool, last: bool) -> None:
    positions = _positions(result)
    for x, row in zip(positions, result.rows, strict=True):
        if row.operating:
            axes.axvline(float(x), color=canvas.GREY, linewidth=1.0, linestyle=":", zorder=0.5)
    if result.scale == "names":
        axes.set_xlim(-0.6, len(positions) - 0.4)
        axes.set_xticks(positions, [_value(row) for row in result.rows], rotation=90)
    else:
        axes.set_xscale(result.scale)
        axes.set_xticks(positions, shown_labels(result), minor=False)
        axes.set_xticks([], minor=True)
        axes.set_xlim(*_limits(result))  # of a panel without cases too
    axes.set(ylim=(-2, 102), yticks=range(0, 101, 20))
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.tick_params(labelleft=first, labelbottom=last)
    if first:
        axes.set_ylabel("percent", labelpad=2)
    if last:
        axes.set_xlabel(result.title, labelpad=2)


def _draw_legend(axes: Axes, result: SweepResult) -> None:
    axes.set_axis_off()
    handles: list[Line2D | Patch] = []
    for name, heading in (_shown(result) | {COVERAGE: "False positives, share of the image"}).items():
        colour, dash, marker, _ = LOOKS[name]
        if result.scale == "names":
            dash, marker = "", marker or "_"
        handles.append(Line2D([], [], color=colour, linestyle=dash, marker=marker, markersize=4, label=heading))
    handles.append(Line2D([], [], color=canvas.GREY, linestyle=":", label="operating value"))
    handles.append(Patch(facecolor=canvas.BLACK, alpha=0.15, label="95 % interval, by recording"))
    axes.legend(handles=handles, loc="upper left", frameon=False)


def _counts(numbers: Sequence[int]) -> str:
    """A number, or its range where the values change it."""
    return f"{min(numbers)}" if min(numbers) == max(numbers) else f"{min(numbers)} to {max(numbers)}"


def write_sweep_files(folder: Path) -> tuple[Path, ...]:
    """Write `sweep.md`, `.csv`, `.png`, `.svg` and `.pdf` beside `sweep.json`; all of their paths.

    Raises:
        DataError: the stored sweep is missing or damaged.
    """
    result = read_sweep(folder)
    tables = formats.write_texts(folder, {"sweep.md": to_markdown(result), "sweep.csv": to_csv(result)})
    pictures = canvas.write_picture(folder / "sweep", draw_sweep(result), formats=("png", "svg", "pdf"))
    return (folder / FILE, *tables, *pictures)

"""A sweep as small multiples: all moving objects, the false positives beside them, then each kind of motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.evaluation import Metric, ObjectMetrics
from bench.harness.sweep import SweepResult
from bench.reporting.canvas import BLACK, BLUE, GREEN, GREY, LIGHT_GREY, PURPLE, VERMILION, new_figure, styled
from bench.reporting.sweep_report import COVERAGE, PARTS, groups, shown_figures, value_text

Dash = Literal["-", "--"]

# Colour, line, marker, and the place beside the tick where the values are names.
LOOKS: dict[str, tuple[str, Dash, str | None, float]] = {
    "detection_rate_50": (BLUE, "-", "o", -0.26),
    "tpr_all": (GREEN, "-", "s", -0.13),
    "tpr": (GREEN, "--", None, 0.0),
    "iou": (PURPLE, "-", "^", 0.13),
    "iou_detected": (PURPLE, "--", None, 0.26),
    COVERAGE: (VERMILION, "-", "D", 0.0),
}
COLUMNS = 4
_LEGEND_AT = COLUMNS - 1  # the upper right corner, so that every column has its axis below
_WIDTH_IN, _PANEL_IN, _GAP_X_IN, _GAP_Y_IN = 11.0, 2.1, 0.22, 0.42
_LEFT_IN, _RIGHT_IN, _TOP_IN = 0.55, 0.12, 0.78
_BOTTOM_IN, _LETTER_IN = 0.55, 0.055  # names of values stand on end below their ticks


@styled
def draw_sweep(result: SweepResult) -> Picture:
    """Draw the figures of every value with their 95 % intervals; the operating value is marked."""
    panels = _by_group(result)
    names = [value_text(row) for row in result.rows if result.scale == "names"]
    bottom_in = _BOTTOM_IN + _LETTER_IN * max(map(len, names), default=0)
    slots = len(panels) + 2
    lines = -(-slots // COLUMNS)
    height_in = _TOP_IN + lines * _PANEL_IN + (lines - 1) * _GAP_Y_IN + bottom_in
    picture = new_figure(_WIDTH_IN, height_in)
    every = [_panel(picture, slot, lines, height_in, bottom_in) for slot in range(slots)]
    axes = [one for slot, one in enumerate(every) if slot != _LEGEND_AT]
    all_moving, *kinds = panels
    _draw_objects(axes[0], result, *all_moving)
    _draw_coverage(axes[1], result)
    for one, kind in zip(axes[2:], kinds, strict=True):
        _draw_objects(one, result, *kind)
    for slot, one in enumerate(every):
        if slot != _LEGEND_AT:
            _finish_axes(one, result, first=slot % COLUMNS == 0, last=slot + COLUMNS >= slots)
    _legend(every[_LEGEND_AT], result)
    left, top = _LEFT_IN / _WIDTH_IN, 1 - 0.08 / height_in
    picture.text(left, top, f"Sweep {result.what} on {result.dataset}: {result.title}", va="top", fontsize=10)
    picture.text(left, top - 0.22 / height_in, PARTS[result.part], va="top", fontsize=7, color="#555555")
    return picture


def _by_group(result: SweepResult) -> list[tuple[str, list[ObjectMetrics]]]:
    """Label and figures of every value, by group."""
    found: dict[str, list[ObjectMetrics]] = {}
    for row in result.rows:
        for _, label, figures in groups(row):
            found.setdefault(label, []).append(figures)
    return list(found.items())


def _panel(picture: Picture, slot: int, lines: int, height_in: float, bottom_in: float) -> Axes:
    line, column = divmod(slot, COLUMNS)
    width_in = (_WIDTH_IN - _LEFT_IN - _RIGHT_IN - (COLUMNS - 1) * _GAP_X_IN) / COLUMNS
    left = _LEFT_IN + column * (width_in + _GAP_X_IN)
    bottom = bottom_in + (lines - 1 - line) * (_PANEL_IN + _GAP_Y_IN)
    return picture.add_axes((left / _WIDTH_IN, bottom / height_in, width_in / _WIDTH_IN, _PANEL_IN / height_in))


def _draw_objects(axes: Axes, result: SweepResult, label: str, rows: Sequence[ObjectMetrics]) -> None:
    for name in shown_figures(result):
        _draw(axes, result, name, [row.metric(name) for row in rows])
    axes.set_title(
        f"{label}\n{_counts([row.object_frames for row in rows])} object-frames, "
        f"{_counts([row.recordings for row in rows])} recordings",
        pad=3,
    )


def _draw_coverage(axes: Axes, result: SweepResult) -> None:
    figures = [row.false_positives.coverage for row in result.rows]
    _draw(axes, result, COVERAGE, figures)
    frames = _counts([row.false_positives.frames for row in result.rows])
    axes.set_title(f"False-positive coverage\n{frames} image-frames", pad=3)


def _draw(axes: Axes, result: SweepResult, name: str, figures: Sequence[Metric]) -> None:
    """One figure over the values, in percent, with its interval."""
    colour, dash, marker, shift = LOOKS[name]
    values = 100 * np.array([figure.value for figure in figures])
    bounds = 100 * np.array([figure.ci95 or (np.nan, np.nan) for figure in figures])
    if result.scale == "names":
        places = _places(result) + shift
        axes.vlines(places, bounds[:, 0], bounds[:, 1], color=colour, linewidth=1.0, alpha=0.6)
        axes.plot(places, values, color=colour, linestyle="", marker=marker or "_", markersize=3.5)
    else:
        places = _places(result)
        axes.fill_between(places, bounds[:, 0], bounds[:, 1], color=colour, alpha=0.12, linewidth=0)
        axes.plot(places, values, color=colour, linestyle=dash, marker=marker, markersize=3, linewidth=1.2)


def _places(result: SweepResult) -> NDArray[np.float64]:
    if result.scale == "names":
        return np.arange(len(result.rows), dtype=np.float64)
    return np.array([row.value for row in result.rows], dtype=np.float64)


def _finish_axes(axes: Axes, result: SweepResult, *, first: bool, last: bool) -> None:
    places = _places(result)
    for place, row in zip(places, result.rows, strict=True):
        if row.operating:
            axes.axvline(float(place), color=GREY, linewidth=1.0, linestyle=":", zorder=0.5)
    if result.scale == "names":
        axes.set_xlim(-0.6, len(places) - 0.4)
        axes.set_xticks(places, [value_text(row) for row in result.rows], rotation=90)
    elif result.scale == "log":
        axes.set_xscale("log")
    axes.set(ylim=(-2, 102), yticks=range(0, 101, 20))
    axes.grid(color=LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)
    axes.tick_params(labelleft=first, labelbottom=last)
    if first:
        axes.set_ylabel("percent", labelpad=2)
    if last:
        axes.set_xlabel(result.title, labelpad=2)


def _legend(axes: Axes, result: SweepResult) -> None:
    axes.set_axis_off()
    headings = shown_figures(result) | {COVERAGE: "False positives, share of the image"}
    handles: list[Line2D | Patch] = [_handle(name, heading, result) for name, heading in headings.items()]
    handles.append(Line2D([], [], color=GREY, linestyle=":", label="operating value"))
    handles.append(Patch(facecolor=BLACK, alpha=0.15, label="95 % interval, by recording"))
    axes.legend(handles=handles, loc="upper left", frameon=False)


def _handle(name: str, heading: str, result: SweepResult) -> Line2D:
    colour, dash, marker, _ = LOOKS[name]
    if result.scale == "names":
        return Line2D([], [], color=colour, linestyle="", marker=marker or "_", markersize=4, label=heading)
    return Line2D([], [], color=colour, linestyle=dash, marker=marker, markersize=4, label=heading)


def _counts(numbers: Sequence[int]) -> str:
    """A number, or its range where the values change it."""
    return f"{min(numbers)}" if min(numbers) == max(numbers) else f"{min(numbers)} to {max(numbers)}"

"""Quality against cost: every method of a group as a dot."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter

from bench.evaluation.slices import ALL_MOVING
from bench.reporting import canvas
from bench.reporting.leaderboard.reading import ORDERED_BY, Entry, Group, Kind

PANEL_IN, HEIGHT_IN = 4.4, 3.5
_LEAST_MS = 1.0  # what takes less stands here with an arrow, or the axis would be one of trifles
_LABEL_PT, _LINE_LETTERS = 5.5, 34
_APART = 0.035  # of the height, between lines of labels
_BESIDE = math.log10(1.35)  # decades from a dot to its label


@canvas.styled
def draw_quality_and_cost(groups: Sequence[Group]) -> Figure:
    """Draw IoU over all moving object-frames against the time for an image, a panel for each data set.

    Args:
        groups: at least one, of the same protocol.
    """
    figure = canvas.new_figure(PANEL_IN * len(groups), HEIGHT_IN)
    for number, group in enumerate(groups):
        axes = figure.add_axes(((number + 0.125) / len(groups), 0.135, 0.85 / len(groups), 0.77), xscale="log")
        _draw(axes, group)
    return figure


def _draw(axes: Axes, group: Group) -> None:
    timed = [entry for entry in group.methods if entry.cost is not None]
    for entry in timed:
        metric, best = entry.metrics[ORDERED_BY], entry is group.methods[0]
        at_ms, value = _at(entry)
        if metric.ci95 is not None:
            axes.plot([at_ms] * 2, [100 * end for end in metric.ci95], color=canvas.GREY, linewidth=0.8, zorder=2)
        marker = "D" if best else "<" if _trifling(entry) else "o"
        colour = canvas.VERMILION if best else canvas.BLUE
        axes.plot([at_ms], [value], marker=marker, markersize=6 if best else 4.5, color=colour, zorder=3)
    bounds = [(e.method, 100 * e.metrics[ORDERED_BY].value) for e in group.entries if e.kind is not Kind.METHOD]
    if not any(entry.kind is Kind.CEILING for entry in group.entries):
        bounds.append(("ceiling", 100 * group.ceiling(ALL_MOVING, ORDERED_BY)))
    bounds = [(label, value) for label, value in bounds if not math.isnan(value)]
    farneback_ms = float(np.median([entry.cost.farneback_ms for entry in timed if entry.cost])) if timed else 30.0
    times = [*(_at(entry)[0] for entry in timed), farneback_ms]
    axes.set(xlim=(_LEAST_MS / 1.5, 1.5 * max(times)), ylim=(0, 100))
    _make_room(axes, timed)
    axes.axvline(farneback_ms, color=canvas.GREY, linewidth=0.7, linestyle=":", zorder=1)
    axes.text(
        farneback_ms, 99, "one Farnebäck call", fontsize=_LABEL_PT, color="#303030", rotation=90, va="top", ha="right"
    )
    for label, value in bounds:
        axes.axhline(value, color=canvas.BLACK, linewidth=0.7, linestyle="--", zorder=1)
        axes.text(_LEAST_MS / 1.4, value + 0.6, label, fontsize=_LABEL_PT, color="#303030", va="bottom")
    _label(axes, timed)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.set_xlabel("time of the method for an image, one thread (ms)")
    axes.set_ylabel("IoU over all moving object-frames (%)")
    axes.set_title(
        f"{group.dataset}, {group.protocol}: {group.images} images, {group.rows[0].recordings} recordings", pad=4
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)


def _at(entry: Entry) -> tuple[float, float]:
    assert entry.cost is not None, "only methods with a cost are drawn"
    return max(entry.cost.method_ms, _LEAST_MS), 100 * entry.metrics[ORDERED_BY].value


def _trifling(entry: Entry) -> bool:
    return entry.cost is not None and entry.cost.method_ms < _LEAST_MS


def _label_text(entry: Entry) -> str:
    """The method's name in lines of bounded length; a word is never cut."""
    name = entry.method + (f" (below {_LEAST_MS:g} ms)" if _trifling(entry) else "")
    return textwrap.fill(name, _LINE_LETTERS, break_long_words=False, break_on_hyphens=False)


def _label_span(axes: Axes, entry: Entry) -> tuple[float, float]:
    """Where a label starts, in decades, and its width as a share of that of the axes."""
    font = FontProperties(size=_LABEL_PT)
    widths_pt = [TextPath((0, 0), line, prop=font).get_extents().width for line in _label_text(entry).split("\n")]
    axes_pt = axes.bbox.width * 72 / canvas.DPI
    margin_pt = 2.0  # letters on a grid of pixels are a little wider
    return math.log10(_at(entry)[0]) + _BESIDE, (max(widths_pt) + margin_pt) / axes_pt


def _make_room(axes: Axes, entries: Sequence[Entry]) -> None:
    """Lengthen the axis of times until every label ends within it."""
    left, right = (math.log10(end) for end in axes.get_xlim())
    for start, share in (_label_span(axes, entry) for entry in entries):
        right = max(right, left + (start - left) / max(1 - share, 0.1))
    axes.set_xlim(right=10**right)


def _label(axes: Axes, entries: Sequence[Entry]) -> None:
    """Names beside the dots, where they cover no other dot, pushed apart upwards where they would cover each other."""
    left, right = (math.log10(end) for end in axes.get_xlim())
    low, high = axes.get_ylim()
    dots = {entry.run: (math.log10(_at(entry)[0]), _at(entry)[1]) for entry in entries}
    placed: list[tuple[float, float, float]] = []  # first and last decade, and the upper edge
    for entry in sorted(entries, key=lambda entry: _at(entry)[1]):
        (at, value), text = dots[entry.run], _label_text(entry)
        start, share = _label_span(axes, entry)
        width, half = share * (right - left), _APART * (high - low) * (1 + text.count("\n")) / 2
        beside = [x for x, y in dots.values() if abs(y - value) < 2 * half]
        to_the_left = any(start < x < start + width for x in beside) and not any(
            x < at and x > 2 * at - start - width for x in [left, *beside]
        )
        first = 2 * at - start - width if to_the_left else start
        below = [edge for begin, end, edge in placed if begin < first + width and first < end]
        height = max([value, *(edge + half for edge in [low, *below])])
        placed.append((first, first + width, height + half))
        axes.annotate(
            text,
            xy=_at(entry),
            xytext=(10**first, height),
            fontsize=_LABEL_PT,
            va="center",
            arrowprops={"arrowstyle": "-", "linewidth": 0.3, "color": canvas.GREY, "shrinkA": 0, "shrinkB": 2},
        )

"""Quality against cost: every method of a group as a dot."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from bench.evaluation.slices import ALL_MOVING
from bench.reporting import canvas
from bench.reporting.leaderboard.reading import ORDERED_BY, Entry, Group, Kind

PANEL_IN, HEIGHT_IN = 4.4, 3.5
_LEAST_MS = 1.0  # what takes less stands here with an arrow, or the axis would be one of trifles
_APART = 0.035  # of the height, between labels
_BESIDE = 8.0  # times as long: farther apart, labels do not meet


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
    axes.set(xlim=(_LEAST_MS / 1.5, max(times) * 15), ylim=(0, 100))
    axes.axvline(farneback_ms, color=canvas.GREY, linewidth=0.7, linestyle=":", zorder=1)
    axes.text(farneback_ms, 99, "one Farnebäck call", fontsize=5.5, color="#303030", rotation=90, va="top", ha="right")
    for label, value in bounds:
        axes.axhline(value, color=canvas.BLACK, linewidth=0.7, linestyle="--", zorder=1)
        axes.text(_LEAST_MS / 1.4, value + 0.6, label, fontsize=5.5, color="#303030", va="bottom")
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


def _label(axes: Axes, entries: Sequence[Entry]) -> None:
    """Names to the right of the dots, pushed apart upwards where they would cover each other."""
    low, high = axes.get_ylim()
    placed: list[tuple[float, float]] = []
    for entry in sorted(entries, key=lambda entry: _at(entry)[1]):
        at_ms, value = _at(entry)
        beside = [height for other_ms, height in placed if 1 / _BESIDE < other_ms / at_ms < _BESIDE]
        placed.append((at_ms, max([value, *(height + _APART * (high - low) for height in beside)])))
        axes.annotate(
            entry.method + (f" (below {_LEAST_MS:g} ms)" if _trifling(entry) else ""),
            xy=(at_ms, value),
            xytext=(at_ms * 1.35, placed[-1][1]),
            fontsize=5.5,
            va="center",
            arrowprops={"arrowstyle": "-", "linewidth": 0.3, "color": canvas.GREY, "shrinkA": 0, "shrinkB": 2},
        )

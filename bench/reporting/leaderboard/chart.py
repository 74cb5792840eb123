"""Quality against cost: every method of a group as a dot, with its place in the table as its number."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from bench.evaluation.sums import ALL_MOVING
from bench.reporting import canvas
from bench.reporting.leaderboard.reading import ORDERED_BY, Entry, Group, Kind

WIDTH_IN, HEIGHT_IN, COLUMNS = 6.2, 3.6, 2  # of a panel; panels in a row
_LEAST_MS = 1.0  # what takes less stands here with an arrow, or the axis would be one of trifles
_LABEL_PT, _LINE_LETTERS = 6.0, 34
_BESIDE_PT = 4  # from a dot to its number


@canvas.styled
def draw_quality_and_cost(groups: Sequence[Group]) -> Figure:
    """Draw IoU over all moving object-frames against the time for an image, a panel for each data set.

    Args:
        groups: at least one, of the same protocol.
    """
    columns = min(len(groups), COLUMNS)
    rows = -(-len(groups) // columns)
    figure = canvas.new_figure(WIDTH_IN * columns, HEIGHT_IN * rows, layout="constrained")
    for number, group in enumerate(groups, start=1):
        _draw(figure.add_subplot(rows, columns, number, xscale="log"), group)
    return figure


def _draw(axes: Axes, group: Group) -> None:
    timed = [entry for entry in group.methods if entry.cost_ms is not None]
    for place, entry in enumerate(timed, start=1):
        metric, best = entry.metrics[ORDERED_BY], entry is group.methods[0]
        at_ms, value = _at(entry)
        if metric.ci95 is not None:
            axes.plot([at_ms] * 2, [100 * end for end in metric.ci95], color=canvas.GREY, linewidth=0.8, zorder=2)
        marker = "D" if best else "<" if _trifling(entry) else "o"
        colour = canvas.VERMILION if best else canvas.BLUE
        name = f"{place} {_label(entry)}"
        axes.plot([at_ms], [value], marker, markersize=6 if best else 4.5, color=colour, zorder=3, label=name)
        side = 1 if place % 2 else -1  # numbers of neighbours stand on different sides
        axes.annotate(
            str(place),
            xy=(at_ms, value),
            xytext=(side * _BESIDE_PT, 0),
            textcoords="offset points",
            fontsize=_LABEL_PT,
            va="center",
            ha="left" if side > 0 else "right",
        )
    bounds = [(e.method, 100 * e.metrics[ORDERED_BY].value) for e in group.entries if e.kind is not Kind.METHOD]
    if not any(entry.kind is Kind.CEILING for entry in group.entries):
        bounds.append(("ceiling", 100 * group.ceiling(ALL_MOVING, ORDERED_BY)))
    bounds = [(label, value) for label, value in bounds if not math.isnan(value)]
    times = [_at(entry)[0] for entry in timed] or [_LEAST_MS]
    axes.set(xlim=(_LEAST_MS / 1.5, 1.5 * max(times)), ylim=(0, 100))
    for label, value in bounds:
        axes.axhline(value, color=canvas.BLACK, linewidth=0.7, linestyle="--", zorder=1)
        axes.text(_LEAST_MS / 1.4, value + 0.6, label, fontsize=_LABEL_PT, color="#303030", va="bottom")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), frameon=False, fontsize=_LABEL_PT, handletextpad=0.3)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.set_xlabel("time of the method for an image, one thread (ms)")
    axes.set_ylabel("IoU over all moving object-frames (%)")
    axes.set_title(
        f"{group.dataset}, {group.protocol}: {group.images} images, {group.rows[ALL_MOVING].recordings} recordings",
        pad=4,
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color=canvas.LIGHT_GREY, linewidth=0.4)
    axes.set_axisbelow(True)


def _at(entry: Entry) -> tuple[float, float]:
    assert entry.cost_ms is not None, "only methods with a cost are drawn"
    return max(entry.cost_ms, _LEAST_MS), 100 * entry.metrics[ORDERED_BY].value


def _trifling(entry: Entry) -> bool:
    return entry.cost_ms is not None and entry.cost_ms < _LEAST_MS


def _label(entry: Entry) -> str:
    """The method's name in lines of bounded length; only a word that is longer is broken."""
    name = entry.method + (f" (below {_LEAST_MS:g} ms)" if _trifling(entry) else "")
    return textwrap.fill(name, _LINE_LETTERS, break_on_hyphens=False)

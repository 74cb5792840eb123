"""How well each kind of polygon fits by distance, one panel per class."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.harness.audit import AuditSummary, Compensation
from bench.reporting.canvas import new_figure, styled
from bench.reporting.colours import BLUE, GREEN, GREY, LIGHT_GREY, ORANGE, PURPLE

COLOURS = (ORANGE, BLUE, GREEN, PURPLE)
BIN_M = 1.0
FEWEST = 3  # object-frames of a point; fewer say nothing about quartiles
_PANEL_IN, _HEIGHT_IN, _LEFT_IN, _GAP_IN, _TOP_IN, _BOTTOM_IN = 2.4, 3.0, 0.5, 0.2, 0.75, 0.45


@styled
def draw_fit_by_distance(audit: AuditSummary, polygons: pa.Table) -> Figure:
    """Draw median and quartiles of the IoU over the distance, each kind of polygon in its colour.

    Args:
        audit: the figures, for names and aims.
        polygons: the rows behind them.
    """
    rows = polygons.to_pandas()
    rows = rows[rows["compensation"] == Compensation.FULL.value]
    classes = sorted(set(rows["object_class"])) or ["none"]
    width_in = _LEFT_IN + len(classes) * (_PANEL_IN + _GAP_IN)
    figure = new_figure(max(width_in, 4.0), _HEIGHT_IN)
    for number, name in enumerate(classes):
        axes = figure.add_axes(
            (
                (_LEFT_IN + number * (_PANEL_IN + _GAP_IN)) / max(width_in, 4.0),
                _BOTTOM_IN / _HEIGHT_IN,
                _PANEL_IN / max(width_in, 4.0),
                1 - (_TOP_IN + _BOTTOM_IN) / _HEIGHT_IN,
            )
        )
        of_class = rows[rows["object_class"] == name]
        for kind, colour in zip(audit.polygon_kinds, COLOURS, strict=False):
            _draw_kind(axes, of_class[of_class["kind"] == kind], kind=kind, colour=colour)
        aims = {aim.expected for aim in audit.aims if aim.object_class == name}
        for expected in sorted(aims):
            axes.axhline(expected, color=GREY, linewidth=0.8, linestyle=":")
        frames = len(of_class[of_class["kind"] == audit.polygon_kinds[0]])
        axes.set(xlabel="distance (m)", ylim=(0.3, 1.0), xlim=(0, max(float(rows["range_m"].max()), 8.0)))
        axes.set_title(f"{name}, {frames} object-frames", pad=3)
        axes.grid(color=LIGHT_GREY, linewidth=0.4)
        axes.tick_params(labelleft=number == 0)
        if number == 0:
            axes.set_ylabel("IoU with the exact mask")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=len(labels), frameon=False)
    figure.text(0.08 / width_in, 1 - 0.06 / _HEIGHT_IN, f"Reference polygons of {audit.dataset}", va="top", fontsize=10)
    figure.text(
        0.08 / width_in,
        1 - 0.26 / _HEIGHT_IN,
        "Median and quartiles; dotted: the aim for kinds that follow the outline",
        va="top",
        fontsize=7,
        color="#555555",
    )
    return figure


def _draw_kind(axes: Axes, rows: pd.DataFrame, *, kind: str, colour: str) -> None:
    bins = np.floor(rows["range_m"].to_numpy(dtype=np.float64) / BIN_M)
    places, quarters = [], []
    for number in np.unique(bins):
        iou = rows["iou"].to_numpy(dtype=np.float64)[bins == number]
        if len(iou) >= FEWEST:
            places.append((number + 0.5) * BIN_M)
            quarters.append(np.quantile(iou, [0.25, 0.5, 0.75]))
    low, median, high = np.array(quarters).reshape(-1, 3).T
    axes.fill_between(places, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(places, median, color=colour, marker="o", markersize=3, linewidth=1.2, label=kind)

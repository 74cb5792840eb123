"""The page's own charts, small enough for a phone, black on white; `svg` gives them the page's colours."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.evaluation.coverage_curves import THRESHOLDS, CoverageCurve
from bench.reporting.canvas import new_figure, styled
from bench.reporting.colours import GREY, VERMILION

CURVE = "#2a8cc4"  # reads on white and on black
_GRID = "#999999"
_SIZE_IN = 3.2, 2.3


@styled
def draw_coverage_curve(found: CoverageCurve, chance: CoverageCurve, *, title: str) -> Figure:
    """Share of object-frames that are found, against the coverage that counts as found.

    Args:
        found: of the object-frames.
        chance: the same on the masks of other frames.
        title: of the chart.
    """
    figure, axes = _chart()
    for curve, colour, style, label in ((found, CURVE, "-", "this run"), (chance, GREY, "--", "chance")):
        if curve.object_frames:
            axes.step(*coverage_points(curve), where="pre", color=colour, linestyle=style, linewidth=1.5, label=label)
    axes.set(xlim=(0, 100), ylim=(0, 102), xlabel="covered at least (%)", ylabel="object-frames (%)")
    axes.set_title(f"{title} ({found.object_frames})", pad=3)
    axes.legend(frameon=False, loc="lower left")
    return figure


def coverage_points(curve: CoverageCurve) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Thresholds and the share of object-frames with at least that coverage, both in percent.

    Points on a level line are left out but for its ends: a drawing of few object-frames stays small.
    """
    rate = curve.rate
    corner = np.ones(len(rate), dtype=bool)
    corner[1:-1] = (rate[1:-1] != rate[:-2]) | (rate[1:-1] != rate[2:])
    return 100 * THRESHOLDS[corner], 100 * rate[corner]


@styled
def draw_threshold_curve(
    false_positive_coverage: NDArray[np.float64], tpr: NDArray[np.float64], *, marked: tuple[float, float] | None
) -> Figure:
    """Pixels of moving objects found against image area wrongly marked, one point per threshold.

    Args:
        false_positive_coverage: (K,) in [0, 1].
        tpr: (K,) in [0, 1].
        marked: the operating point, in the same order; None where it is unknown.
    """
    figure, axes = _chart()
    axes.plot(100 * false_positive_coverage, 100 * tpr, color=CURVE, linewidth=1.5)
    if marked is not None:
        axes.plot(100 * marked[0], 100 * marked[1], "o", color=VERMILION, markersize=6, label="threshold of the run")
        axes.legend(frameon=False, loc="lower right")
    axes.set(
        xlim=(0, None), ylim=(0, 102), xlabel="false-positive coverage (% of the image)", ylabel="TPR (% of pixels)"
    )
    axes.set_title("Found against wrongly marked", pad=3)
    return figure


@styled
def draw_precision_curve(
    recall: NDArray[np.float64], precision: NDArray[np.float64], *, marked: tuple[float, float] | None, auprc: float
) -> Figure:
    """Precision against recall, one point per threshold, with the area below the curve."""
    figure, axes = _chart()
    axes.plot(100 * recall, 100 * precision, color=CURVE, linewidth=1.5)
    if marked is not None:
        axes.plot(100 * marked[0], 100 * marked[1], "o", color=VERMILION, markersize=6)
    axes.set(xlim=(0, 102), ylim=(0, 102), xlabel="recall (% of moving pixels)", ylabel="precision (%)")
    area = "n/a" if math.isnan(auprc) else f"{auprc:.3f}"
    axes.set_title(f"Precision against recall, AUPRC {area}", pad=3)
    return figure


@styled
def draw_plane_map(share: NDArray[np.float64], *, width: int, height: int, title: str, bar: str) -> Figure:
    """A share per cell of the image plane; cells without cases stay empty.

    Args:
        share: (rows, columns) in [0, 1], NaN without cases.
        width: of the image, px.
        height: of the image, px.
        title: of the chart.
        bar: names the colour scale.
    """
    figure = new_figure(_SIZE_IN[0], _SIZE_IN[1])
    axes = figure.add_axes((0.03, 0.05, 0.76, 0.84))
    shown = np.ma.masked_invalid(100 * share)
    drawn = axes.imshow(
        shown, cmap="viridis", vmin=0, vmax=100, interpolation="nearest", extent=(-0.5, width - 0.5, height - 0.5, -0.5)
    )
    axes.set(xticks=[], yticks=[])
    axes.set_title(title, pad=3)
    figure.colorbar(drawn, cax=figure.add_axes((0.81, 0.12, 0.03, 0.7))).set_label(bar)
    return figure


def _chart() -> tuple[Figure, Axes]:
    figure = new_figure(*_SIZE_IN)
    axes = figure.add_axes((0.16, 0.18, 0.8, 0.7))
    axes.grid(color=_GRID, alpha=0.35, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes

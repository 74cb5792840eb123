"""The ground seen from above, around the host: x forward is up, y left is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from bench.reporting.canvas import BLACK, LIGHT_GREY


def plan_axes(axes: Axes, *, x_m: tuple[float, float], y_m: tuple[float, float], labels: bool = True) -> None:
    """Set limits in the vehicle frame; data coordinates are (y, x) so that artists take columns swapped.

    Args:
        axes: where to draw.
        x_m: lowest and highest x, forward, m.
        y_m: lowest and highest y, left, m.
        labels: name the axes.
    """
    axes.set(xlim=(y_m[1], y_m[0]), ylim=x_m, aspect="equal")
    axes.xaxis.set_major_locator(MultipleLocator(5))
    axes.yaxis.set_major_locator(MultipleLocator(5))
    axes.tick_params(length=2, pad=2)
    if labels:
        axes.set_xlabel("y (m), left of the host", labelpad=1.5)
        axes.set_ylabel("x (m), ahead of the host", labelpad=1.5)


def draw_vehicle(axes: Axes, outline_m: NDArray[np.float64]) -> None:
    """Draw the host from its outline, (K, 2) in the vehicle frame, with an arrow in its direction of travel."""
    axes.add_patch(PolygonPatch(outline_m[:, ::-1], facecolor=LIGHT_GREY, edgecolor=BLACK, linewidth=0.9, zorder=5))
    low, high = outline_m.min(axis=0), outline_m.max(axis=0)
    (x, y), length = (low + high) / 2, high[0] - low[0]
    axes.annotate(
        "", xy=(y, x + 0.32 * length), xytext=(y, x - 0.32 * length), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


def draw_rings(axes: Axes, radii_m: Sequence[float]) -> None:
    """Circles of constant range about the vehicle's origin, each with its range behind on the right."""
    for radius in radii_m:
        axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor="#606060", linewidth=0.5, linestyle=":", zorder=4))
        at = radius * np.sqrt(0.5)
        axes.text(
            -at, -at, f"{radius:g} m", fontsize=5.5, color="#303030", ha="center", va="center", zorder=4.5,
            clip_on=True, bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.4},
        )  # fmt: skip

"""The paper's maps of the detection rate around the ego vehicle, per class and direction of relative motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import Collection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.evaluation.maps import RangeMap, RangeMaps, range_maps
from bench.harness.stored import StoredRun
from bench.records.reference import Direction
from bench.reporting.canvas import draw_rings, draw_vehicle, new_figure, plan_axes, styled

CLASSES = ("pedestrian", "cyclist", "vehicle")
COLOUR_MAP = "viridis"
HATCH = "//////"
RING_STEP_M = 5.0
_WIDTH_IN, _AROUND_IN = 7.0, 1.3
_LEAST_REACH_M = 10.0
HALF = 0.5
HALF_TITLE = "Detected: at least half of the object's core"


def draw_run_maps(run: StoredRun) -> Figure:
    """Draw the maps of a run, by the paper's rule or, under a protocol with unknown bands, by half of the core.

    Methods that mark much of the image touch every object: "any pixel" says nothing of them.
    """
    outline_m = np.array(run.summary.vehicle_outline_m, dtype=np.float64)
    if run.protocol.reference.unknown_band is None:
        return draw_range_maps(range_maps(run.objects, protocol=run.protocol), vehicle_outline_m=outline_m)
    maps = range_maps(run.objects, protocol=run.protocol, level=HALF)
    return draw_range_maps(maps, vehicle_outline_m=outline_m, title=HALF_TITLE)


@styled
def draw_range_maps(found: RangeMaps, *, vehicle_outline_m: NDArray[np.float64], title: str = "") -> Figure:
    """Draw classes by two directions over the ego vehicle seen from above; the paper's three classes always.

    Args:
        found: counts per cell, of any classes; a class and direction without any is drawn empty.
        vehicle_outline_m: (K, 2) float64, the ego vehicle from above, vehicle frame, m.
        title: what counts as detected; empty for the paper's rule, any pixel.

    Source:
        Mariotti and Eising 2020, the figure of detection ranges.
    """
    by_kind = {(m.object_class, m.direction): m for m in found.maps}
    classes = _classes(found.maps)
    reach_m = _reach(found.maps)
    panel_in = _WIDTH_IN / (len(classes) + 0.5)
    figure = new_figure(_WIDTH_IN, 2 * panel_in + _AROUND_IN, layout="constrained")
    if title:
        figure.suptitle(title, fontsize=8)
    figure.supylabel("x (m), ahead of the ego vehicle", fontsize=8)
    panels = figure.subplots(2, len(classes), sharex=True, sharey=True)
    for line, direction in zip(panels, Direction, strict=True):
        for axes, object_class in zip(line, classes, strict=True):
            range_map = by_kind.get((object_class, direction))
            _draw_panel(axes, range_map, reach_m, vehicle_outline_m)
            total = 0 if range_map is None else int(range_map.object_frames.sum())
            axes.set_title(f"{object_class}, {direction.value}\n{total} object-frames", pad=3, fontsize=7)
    panels[-1, len(classes) // 2].set_xlabel("y (m), left of the ego vehicle")
    scale = ScalarMappable(norm=Normalize(vmin=0.0, vmax=100.0), cmap=COLOUR_MAP)
    bar = figure.colorbar(scale, ax=panels, ticks=range(0, 101, 20), aspect=40, pad=0.01)
    bar.set_label("detection rate (%)", labelpad=2)
    _draw_legend(figure, found)
    return figure


def draw_cells(axes: Axes, range_map: RangeMap) -> tuple[Collection, Collection]:
    """Colour the cells that have enough object-frames, hatch those that have some but too few.

    Returns:
        The coloured and the hatched cells.
    """
    few = (range_map.object_frames > 0) & ~range_map.enough
    edges_m = range_map.edges_m  # columns of the arrays go along y, rows along x
    rate = np.ma.masked_array(range_map.rate, mask=~range_map.enough)
    coloured = axes.pcolor(edges_m, edges_m, rate, cmap=COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=1.0))
    coloured.set(edgecolor="face", linewidth=0.1)
    hatched = axes.pcolor(edges_m, edges_m, np.ma.masked_array(few, mask=~few), hatch=HATCH)
    hatched.set(facecolor="none", edgecolor="#808080", linewidth=0.3)
    return coloured, hatched


def _draw_panel(axes: Axes, range_map: RangeMap | None, reach_m: float, vehicle_outline_m: NDArray[np.float64]) -> None:
    if range_map is not None:
        draw_cells(axes, range_map)
    draw_rings(axes, np.arange(RING_STEP_M, reach_m * np.sqrt(2), RING_STEP_M).tolist())
    draw_vehicle(axes, vehicle_outline_m)
    plan_axes(axes, x_m=(-reach_m, reach_m), y_m=(-reach_m, reach_m), labels=False)
    axes.locator_params(base=RING_STEP_M * (1 if reach_m < 15.0 else 2))  # or the numbers below touch


def _classes(maps: Sequence[RangeMap]) -> tuple[str, ...]:
    """The paper's classes, then any other that was seen, so that no object-frame is dropped."""
    seen = dict.fromkeys(one.object_class for one in maps if one.object_frames.any())
    return (*CLASSES, *(name for name in seen if name not in CLASSES))


def _reach(maps: Sequence[RangeMap]) -> float:
    """Half the side of the square about the vehicle's origin that holds every cell with an object."""
    reach_m = _LEAST_REACH_M
    for one in maps:
        for across in (0, 1):
            filled = np.flatnonzero(one.object_frames.any(axis=across))
            if filled.size:
                reach_m = max(reach_m, -float(one.edges_m[filled[0]]), float(one.edges_m[filled[-1] + 1]))
    return float(np.ceil(reach_m)) + 0.5  # the outermost ticks stay off the corners


def _draw_legend(figure: Figure, found: RangeMaps) -> None:
    least = max((m.min_object_frames for m in found.maps), default=1)
    few = Patch(
        facecolor="white", edgecolor="#808080", hatch=HATCH, linewidth=0.4, label=f"fewer than {least} object-frames"
    )
    none = Patch(facecolor="white", edgecolor="#808080", linewidth=0.4, label="none")
    figure.legend(handles=[few, none], loc="outside lower center", ncols=2, frameon=False)
    if found.unplaced:
        note = f"{found.unplaced} object-frames of unknown direction left out"
        figure.text(0.99, 0.02, note, ha="right", va="bottom", fontsize=6)

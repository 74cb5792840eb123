"""The charts of a run: the paper's maps of the detection rate, curves of coverage and threshold, the image plane.

Each is a figure of matplotlib, for a file or, as SVG in the colours of its page, for a page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import Collection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.evaluation import ImageMap, threshold_sweep
from bench.evaluation.maps import THRESHOLDS, CoverageCurve, RangeMap, RangeMaps, coverage_curves, range_maps
from bench.harness import read_image_maps
from bench.harness.stored import StoredRun, read_run
from bench.records.reference import Category, Direction
from bench.reporting.canvas import (
    GREY,
    VERMILION,
    draw_rings,
    draw_vehicle,
    figure_bytes,
    figure_pixels,
    jpeg_uri,
    new_figure,
    plan_axes,
    styled,
    write_picture,
)
from bench.reporting.document import Drawing
from bench.reporting.formats import LABELS, found_level

_INK = re.compile("#000000|#303030")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One chart.

    Attributes:
        name: of letters, digits, dashes and underscores, used once: of the file, and before its ids on a page.
        figure: drawn in black on white.
        label: says in words what it shows.
        caption: a line below it.
    """

    name: str
    figure: Figure
    label: str
    caption: str = ""

    def drawing(self) -> Drawing:
        """The chart for a page: black becomes the page's text colour and white its background."""
        text = figure_bytes(self.figure, "svg").decode()
        text = text[text.index("<svg") :]
        text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
        text = re.sub(
            r'<(g|path) id="(?:figure|axes|patch|matplotlib|line2d|text|xtick|ytick|legend|Quad)[^"]*"', r"<\1", text
        )
        text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{self.name}-", text)
        text = _INK.sub("currentColor", text).replace("#ffffff", "var(--paper)")
        head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", text[: text.index(">")])
        label = f'aria-label="{escape(self.label)}" xmlns:xlink="http://www.w3.org/1999/xlink"'
        # matplotlib escapes its texts
        return Drawing(Markup(f'{head} class="chart" role="img" {label}{text[text.index(">") :]}'), self.caption)


def figure_uri(figure: Figure, *, scale: float = 1.0) -> str:
    """A figure as a `data:` address, for pictures with photographs in them."""
    image = figure_pixels(figure)
    if scale != 1.0:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return jpeg_uri(image)


CLASSES = ("pedestrian", "cyclist", "vehicle")
COLOUR_MAP = "viridis"
HATCH = "//////"
RING_STEP_M = 5.0
_WIDTH_IN, _AROUND_IN = 7.0, 1.3
_LEAST_REACH_M = 10.0
HALF_TITLE = "Detected: at least half of the object's core"


def draw_run_maps(run: StoredRun) -> Figure:
    """Draw the maps of a run, of what its protocol counts as found."""
    outline_m = np.array(run.summary.vehicle_outline_m, dtype=np.float64)
    level = found_level(run.protocol)
    maps = range_maps(run.objects, protocol=run.protocol, level=level)
    return draw_range_maps(maps, vehicle_outline_m=outline_m, title=HALF_TITLE if level else "")


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


CURVE = "#2a8cc4"  # legible on white and on black
_GRID = "#999999"
_SIZE_IN = 3.2, 2.3


def _axes() -> Axes:
    """Axes of a new figure."""
    axes = new_figure(*_SIZE_IN).add_axes((0.16, 0.18, 0.8, 0.7))
    axes.grid(color=_GRID, alpha=0.35, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


@styled
def draw_coverage_curve(found: CoverageCurve, chance: CoverageCurve, *, title: str) -> Figure:
    """Share of object-frames that are found, against the coverage that counts as found.

    Args:
        found: of the object-frames.
        chance: the same on the masks of other frames.
        title: of the chart.
    """
    axes = _axes()
    for curve, colour, style, label in ((found, CURVE, "-", "this run"), (chance, GREY, "--", "chance")):
        if curve.object_frames:
            axes.step(*coverage_points(curve), where="pre", color=colour, linestyle=style, linewidth=1.5, label=label)
    axes.set(xlim=(0, 100), ylim=(0, 102), xlabel="covered at least (%)", ylabel="object-frames (%)")
    axes.set_title(f"{title} ({found.object_frames})", pad=3)
    axes.legend(frameon=False, loc="lower left")
    return axes.figure.get_figure(root=True)


def coverage_points(curve: CoverageCurve) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Thresholds and the share of object-frames with at least that coverage, both in percent.

    Points on a level line are left out but for its ends: a drawing of few object-frames stays small.
    """
    rate = curve.rate
    corner = np.ones(len(rate), dtype=bool)
    corner[1:-1] = (rate[1:-1] != rate[:-2]) | (rate[1:-1] != rate[2:])
    return 100 * THRESHOLDS[corner], 100 * rate[corner]


@styled
def _draw_threshold_curve(
    x: NDArray[np.float64], y: NDArray[np.float64], *, marked: tuple[float, float], legend: bool, **settings: object
) -> Figure:
    """Two metrics in [0, 1], one point per threshold, with a dot where the run was scored."""
    axes = _axes()
    axes.plot(100 * x, 100 * y, color=CURVE, linewidth=1.5)
    axes.plot(100 * marked[0], 100 * marked[1], "o", color=VERMILION, markersize=6, label="threshold of the run")
    if legend:
        axes.legend(frameon=False, loc="lower right")
    axes.set(ylim=(0, 102), **settings)
    axes.set_title(axes.get_title(), pad=3)
    return axes.figure.get_figure(root=True)


@styled
def _draw_plane_map(share: NDArray[np.float64], found: ImageMap, *, title: str, unit: str) -> Figure:
    """A share in [0, 1] per cell of the image, (rows, columns); cells without cases, NaN, stay empty."""
    figure = new_figure(*_SIZE_IN)
    axes = figure.add_axes((0.03, 0.05, 0.76, 0.84))
    extent = (-0.5, found.width - 0.5, found.height - 0.5, -0.5)
    shown = np.ma.masked_invalid(100 * share)
    drawn = axes.imshow(shown, cmap="viridis", vmin=0, vmax=100, interpolation="nearest", extent=extent)
    axes.set(xticks=[], yticks=[])
    axes.set_title(f"{found.camera}: {title}", pad=3)
    figure.colorbar(drawn, cax=figure.add_axes((0.81, 0.12, 0.03, 0.7))).set_label(unit)
    return figure


def draw_charts(run: StoredRun) -> dict[str, list[Chart]]:
    """The charts of a run by section of its page; a section without data has none."""
    charts = {"range": [_range_chart(run)], "coverage": _coverage_charts(run)}
    return charts if run.category else charts | {"threshold": _threshold_charts(run), "plane": _plane_charts(run)}


def _range_chart(run: StoredRun) -> Chart:
    return Chart(
        name="range_map" if run.category is None else f"range_map-{run.category.value}",
        figure=draw_run_maps(run),
        label="Detection rate around the ego vehicle seen from above, by class and direction of motion",
    )


def _coverage_charts(run: StoredRun) -> list[Chart]:
    """Detection rate against the coverage that counts as found, one chart for each category with cases."""
    return [
        Chart(
            name=f"coverage-{name}",
            figure=draw_coverage_curve(found, chance, title=LABELS[name]),
            label=f"Found against coverage threshold, {name}",
        )
        for name, (found, chance) in coverage_curves(run.objects, protocol=run.protocol).items()
        if found.object_frames
    ]


def _threshold_charts(run: StoredRun) -> list[Chart]:
    """Two metrics over the likelihood's threshold; none where the run holds no likelihoods."""
    sweep = threshold_sweep(run.frames)
    if sweep is None:
        return []
    pixels, area = run.summary.segmentation, run.metrics.false_positives.coverage.value
    recall, precision = pixels.recall.value, pixels.precision.value
    found = _draw_threshold_curve(
        sweep.false_positive_coverage, sweep.recall, marked=(area, recall), legend=True, xlim=(0, None),
        xlabel="false-positive coverage (% of the image)", ylabel="pixel recall (%)",
        title="Found against wrongly marked",
    )  # fmt: skip
    auprc = "n/a" if math.isnan(sweep.auprc) else f"{sweep.auprc:.3f}"
    precise = _draw_threshold_curve(
        sweep.recall, sweep.precision, marked=(recall, precision), legend=False, xlim=(0, 102),
        xlabel="recall (% of moving pixels)", ylabel="precision (%)",
        title=f"Precision against recall, AUPRC {auprc}",
    )  # fmt: skip
    return [
        Chart(name="threshold_sweep", figure=found, label="Pixels found against image wrongly marked"),
        Chart(name="precision_recall", figure=precise, label="Precision against recall"),
    ]


def _plane_charts(run: StoredRun) -> list[Chart]:
    """Misses and false positives on the image plane of every camera; none where the run holds no such maps."""
    charts = []
    for number, one in enumerate(read_image_maps(run.folder).values()):
        caption = f"Camera {one.camera}, {one.frames} images of {one.width} x {one.height} px."
        missed = _draw_plane_map(one.missed_rate, one, title="missed", unit="% of the moving pixels missed")
        false = _draw_plane_map(one.false_rate, one, title="wrongly marked", unit="% of the images")
        charts += [
            Chart(name=f"missed-{number}", figure=missed, label=f"Misses, {caption}", caption=caption),
            Chart(name=f"false-{number}", figure=false, label=f"False, {caption}", caption=caption),
        ]
    return charts


def write_figures(folder: Path, *, category: Category | None = None) -> tuple[Path, ...]:
    """Write the charts of a run's page as `figures/*.pdf` and `.svg` beside its results.

    Raises:
        DataError: a stored result is missing or damaged.
    """
    run = read_run(folder, category=category)
    charts = [chart for section in draw_charts(run).values() for chart in section]
    files = [
        write_picture(run.folder / "figures" / chart.name, chart.figure, formats=("pdf", "svg")) for chart in charts
    ]
    return tuple(file for pair in files for file in pair)

"""Figures: the basis of every picture, and the charts of runs and sweeps.

A chart is a figure of matplotlib, for a file or, as SVG in the colours of its page, for a page. The colours are Okabe
and Ito's, which stay apart for colour-blind readers.

Source:
    Okabe and Ito 2008, Color Universal Design. Mariotti and Eising 2020, the figure of detection ranges.
"""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from markupsafe import Markup, escape
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import Collection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.text import Text
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from bench.atomic import write_bytes
from bench.evaluation.definitions import find_metric
from bench.evaluation.maps import PLACED, RangeMap, RangeMaps, range_maps
from bench.evaluation.summary import Metric
from bench.evaluation.thresholds import threshold_sweep
from bench.harness.stored import StoredRun
from bench.plain_text import counted, plain
from bench.records.reference import Direction
from bench.reporting.document import Drawing
from bench.reporting.formats import found_level

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

BLACK = "#000000"
ORANGE = "#e69f00"
SKY_BLUE = "#56b4e9"
GREEN = "#009e73"
YELLOW = "#f0e442"
BLUE = "#0072b2"
VERMILION = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#999999"
LIGHT_GREY = "#d9d9d9"
DARK_GREY = "#505050"

PictureFormat = Literal["png", "svg", "pdf"]

DPI, JPEG_QUALITY = 200, 85
STYLE: dict[RcKeyType, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "hatch.linewidth": 0.6,
    "savefig.bbox": None,
    "svg.hashsalt": "fisheye-bench",
    "pdf.fonttype": 42,  # TrueType, which publishers ask for
    "text.parse_math": False,  # names may hold dollar signs
}
_UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

styled = rc_context(STYLE)  # decorates every function that draws


def new_figure(width_in: float, height_in: float, *, layout: Literal["constrained"] | None = None) -> Figure:
    """Return an empty figure of whole pixels, unknown to pyplot; a constrained one places its axes itself."""
    size_in = round(width_in * DPI) / DPI, round(height_in * DPI) / DPI
    figure = Figure(figsize=size_in, dpi=DPI, facecolor="white", layout=layout)
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float) -> Axes:
    """New axes, placed in inches from the lower left corner of the figure."""
    full_width_in, full_height_in = figure.get_size_inches()
    return figure.add_axes(
        (left_in / full_width_in, bottom_in / full_height_in, width_in / full_width_in, height_in / full_height_in)
    )


def figure_bytes(figure: Figure, picture_format: PictureFormat | Literal["rgba"]) -> bytes:
    """The figure as a file, or as its pixels; equal figures give equal bytes."""
    for text in figure.findobj(Text):  # names may hold what no font draws
        text.set_text("\n".join(map(plain, text.get_text().split("\n"))))
    buffer = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=picture_format, dpi=DPI, metadata=_UNDATED.get(picture_format))
    return buffer.getvalue()


def figure_pixels(figure: Figure) -> NDArray[np.uint8]:
    """The figure as an image, (H, W, 3) BGR uint8."""
    size = round(figure.bbox.height), round(figure.bbox.width)
    rgba = np.frombuffer(figure_bytes(figure, "rgba"), dtype=np.uint8).reshape(*size, 4)
    return np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGR), dtype=np.uint8)


def figure_uri(figure: Figure) -> str:
    """The figure as the `data:` address of a JPEG, for pictures with photographs in them."""
    written, content = cv2.imencode(".jpg", figure_pixels(figure), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert written, "OpenCV writes JPEG"
    return f"data:image/jpeg;base64,{base64.b64encode(content.tobytes()).decode()}"


def write_picture(stem: Path, figure: Figure, *formats: PictureFormat) -> tuple[Path, ...]:
    """Write a figure as `<stem>.<format>` of each format, whole or not at all."""
    files = {name: stem.with_name(f"{stem.name}.{name}") for name in formats}
    for name, file in files.items():
        write_bytes(file, figure_bytes(figure, name))
    return tuple(files.values())


def drawing(name: str, figure: Figure, label: str) -> Drawing:
    """A chart for a page: black becomes the page's text colour and white its background.

    Args:
        name: of letters, digits, dashes and underscores, once on a page: stands before the ids of the chart.
        figure: drawn in black on white.
        label: says in words what it shows.
    """
    text = figure_bytes(figure, "svg").decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(
        r'<(g|path) id="(?:figure|axes|patch|matplotlib|line2d|text|xtick|ytick|legend|Quad)[^"]*"', r"<\1", text
    )
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", text)
    text = re.sub("#000000|#303030", "currentColor", text).replace("#ffffff", "var(--paper)")
    head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", text[: text.index(">")])
    named = f'aria-label="{escape(label)}" xmlns:xlink="http://www.w3.org/1999/xlink"'
    # matplotlib escapes its texts
    return Drawing(Markup(f'{head} class="chart" role="img" {named}{text[text.index(">") :]}'))


# The ground seen from above.


def plan_axes(axes: Axes, *, x_m: tuple[float, float], y_m: tuple[float, float]) -> None:
    """Set limits in the vehicle frame; data coordinates are (y, x) so that artists take columns swapped.

    Args:
        axes: where to draw.
        x_m: lowest and highest x, forward, m.
        y_m: lowest and highest y, left, m.
    """
    axes.set(xlim=(y_m[1], y_m[0]), ylim=x_m, aspect="equal")
    axes.xaxis.set_major_locator(MultipleLocator(5))
    axes.yaxis.set_major_locator(MultipleLocator(5))
    axes.tick_params(length=2, pad=2)


def draw_vehicle(axes: Axes, outline_m: NDArray[np.float64]) -> None:
    """Draw the ego vehicle from its outline, (K, 2) in the vehicle frame, with an arrow in its direction of travel."""
    axes.add_patch(PolygonPatch(outline_m[:, ::-1], facecolor=LIGHT_GREY, edgecolor=BLACK, linewidth=0.9, zorder=5))
    low, high = outline_m.min(axis=0), outline_m.max(axis=0)
    (x, y), length = (low + high) / 2, high[0] - low[0]
    axes.annotate(
        "", xy=(y, x + 0.32 * length), xytext=(y, x - 0.32 * length), zorder=6,
        arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip


# The charts of a run.

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
    maps = range_maps(run.evaluated("objects", PLACED), protocol=run.protocol, level=level)
    return draw_range_maps(maps, vehicle_outline_m=outline_m, title=HALF_TITLE if level else "")


@styled
def draw_range_maps(found: RangeMaps, *, vehicle_outline_m: NDArray[np.float64], title: str = "") -> Figure:
    """Draw classes by two directions over the ego vehicle seen from above; the paper's three classes always.

    Args:
        found: counts per cell, of any classes; a class and direction without any is drawn empty.
        vehicle_outline_m: (K, 2) float64, the ego vehicle from above, vehicle frame, m.
        title: what counts as detected; empty for the paper's rule, any pixel.
    """
    by_kind = {(m.object_class, m.direction): m for m in found.maps}
    seen = dict.fromkeys(m.object_class for m in found.maps if m.object_frames.any())
    classes = (*CLASSES, *(name for name in seen if name not in CLASSES))  # so that no object-frame is dropped
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
            axes.set_title(f"{object_class}, {direction.value}\n{counted(total, 'object-frame')}", pad=3, fontsize=7)
    panels[-1, len(classes) // 2].set_xlabel("y (m), left of the ego vehicle")
    scale = ScalarMappable(norm=Normalize(vmin=0.0, vmax=100.0), cmap=COLOUR_MAP)
    bar = figure.colorbar(scale, ax=panels, ticks=range(0, 101, 20), aspect=40, pad=0.01)
    bar.set_label("detection rate (%)", labelpad=2)
    least = max((m.min_object_frames for m in found.maps), default=1)
    handles = [
        Patch(facecolor="white", edgecolor="#808080", hatch=hatch, linewidth=0.4, label=label)
        for hatch, label in ((HATCH, f"fewer than {least} object-frames"), (None, "none"))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    if found.unplaced:
        note = f"{counted(found.unplaced, 'object-frame')} of unknown direction left out"
        figure.text(0.99, 0.02, note, ha="right", va="bottom", fontsize=6)
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
    for radius in np.arange(RING_STEP_M, reach_m * np.sqrt(2), RING_STEP_M).tolist():
        axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor="#606060", linewidth=0.5, linestyle=":", zorder=4))
        at = -radius * np.sqrt(0.5)
        axes.text(
            at, at, f"{radius:g} m", fontsize=5.5, color="#303030", ha="center", va="center",
            zorder=4.5, clip_on=True, bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.4},
        )  # fmt: skip
    draw_vehicle(axes, vehicle_outline_m)
    plan_axes(axes, x_m=(-reach_m, reach_m), y_m=(-reach_m, reach_m))
    axes.locator_params(base=RING_STEP_M * (1 if reach_m < 15.0 else 2))  # or the numbers below touch


def _reach(maps: Sequence[RangeMap]) -> float:
    """Half the side of the square about the vehicle's origin that holds every cell with an object."""
    reach_m = [_LEAST_REACH_M]
    for range_map in maps:
        filled = range_map.object_frames.any(axis=0) | range_map.object_frames.any(axis=1)
        edges_m = np.abs(range_map.edges_m)
        reach_m += np.maximum(edges_m[:-1], edges_m[1:])[filled].tolist()
    return float(np.ceil(max(reach_m))) + 0.5  # the outermost ticks stay off the corners


CURVE = "#2a8cc4"  # legible on white and on black
_SIZE_IN = 3.2, 2.3


@styled
def draw_threshold_sweep(
    found: NDArray[np.float64], marked: NDArray[np.float64], *, of_run: tuple[float, float]
) -> Figure:
    """Draw pixel recall against false-positive coverage, in [0, 1], a point per threshold, a dot where it was scored.

    Args:
        found: pixel recall.
        marked: false-positive coverage.
        of_run: both as the run was scored, coverage first.
    """
    figure = new_figure(*_SIZE_IN)
    axes = figure.add_axes((0.16, 0.18, 0.8, 0.7))
    axes.grid(color=GREY, alpha=0.35, linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.plot(100 * marked, 100 * found, color=CURVE, linewidth=1.5)
    at = 100 * np.array(of_run)
    axes.plot(*at[:, None], "o", color=VERMILION, markersize=6, label="threshold of the run")
    axes.legend(frameon=False, loc="lower right")
    axes.set(xlim=(0, None), ylim=(0, 102), xlabel="false-positive coverage (% of the image)",
             ylabel="pixel recall (%)")  # fmt: skip
    axes.set_title("Found against wrongly marked", pad=3)
    return figure


def draw_charts(run: StoredRun) -> dict[str, Figure]:
    """The charts of a run: "range_map" and, of a run that holds likelihoods, "threshold_sweep"."""
    charts = {"range_map": draw_run_maps(run)}
    if sweep := threshold_sweep(run.histograms()):
        of_run = run.metrics.false_positives.coverage.value, run.metrics.segmentation.recall.value
        charts["threshold_sweep"] = draw_threshold_sweep(sweep.recall, sweep.false_positive_coverage, of_run=of_run)
    return charts


# The chart of a sweep.

HEADLINE_STYLES = {
    "iou": (PURPLE, "^"),
    "tpr_all": (GREEN, "s"),
    "detection_rate_50": (BLUE, "o"),
    "false_positive_coverage": (VERMILION, "D"),
}


@styled
def draw_sweep(setting: str, values: Mapping[str, Mapping[str, Metric]], *, title: str) -> Figure:
    """Draw the headline metrics of every value of a setting, in percent, with their 95 % intervals, side by side."""
    figure = new_figure(5.2, 3.4, layout="constrained")
    axes = figure.add_subplot()
    for name in next(iter(values.values())):
        colour, marker = HEADLINE_STYLES[name]
        metrics = [of_value[name] for of_value in values.values()]
        low, high = 100 * np.array([metric.ci95 or (math.nan, math.nan) for metric in metrics]).T
        axes.vlines(list(values), low, high, color=colour, linewidth=1.0, alpha=0.6)
        shown = [100 * metric.value for metric in metrics]
        axes.plot(list(values), shown, color=colour, marker=marker, markersize=3.5, linewidth=1.0,
                  label=find_metric(name).label)  # fmt: skip
    axes.set(xlabel=setting, ylabel="percent", ylim=(-2, 102))
    axes.tick_params(axis="x", labelrotation=20)
    axes.grid(color=LIGHT_GREY, linewidth=0.4)
    axes.set_title(f"{title}\nwith 95 % intervals, by recording", loc="left", pad=18)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.99), ncols=4, frameon=False, handletextpad=0.3)
    return figure

"""The charts of a run: as SVG in the colours of its page, and as PDF for papers."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.evaluation import ImageMap, threshold_sweep
from bench.evaluation.maps import THRESHOLDS, CoverageCurve, coverage_curves
from bench.harness import read_image_maps
from bench.harness.stored import StoredRun, read_run
from bench.reference import Category
from bench.reporting.canvas import (
    GREY,
    VERMILION,
    figure_bytes,
    figure_pixels,
    jpeg_uri,
    new_figure,
    styled,
    write_picture,
)
from bench.reporting.formats import LABELS
from bench.reporting.range_maps import draw_run_maps

_INK = re.compile("#000000|#303030")


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One chart.

    Attributes:
        name: of letters, digits, dashes and underscores, used once: of the file, and before its ids on the page.
        figure: drawn in black on white.
        label: says in words what it shows.
        caption: a line below it.
    """

    name: str
    figure: Figure
    label: str
    caption: str = ""


def inline_svg(chart: Chart) -> Markup:
    """A chart as an `<svg>` element: black becomes the page's text colour and white its background."""
    text = figure_bytes(chart.figure, "svg").decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(
        r'<(g|path) id="(?:figure|axes|patch|matplotlib|line2d|text|xtick|ytick|legend|Quad)[^"]*"', r"<\1", text
    )
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{chart.name}-", text)
    text = _INK.sub("currentColor", text).replace("#ffffff", "var(--paper)")
    head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", text[: text.index(">")])
    label = f'aria-label="{escape(chart.label)}" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return Markup(f'{head} class="chart" role="img" {label}{text[text.index(">") :]}')  # matplotlib escapes its texts


def figure_uri(figure: Figure, *, scale: float = 1.0) -> str:
    """A figure as a `data:` address, for pictures with photographs in them."""
    image = figure_pixels(figure)
    if scale != 1.0:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return jpeg_uri(image)


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
        sweep.false_positive_coverage, sweep.tpr, marked=(area, recall), legend=True, xlim=(0, None),
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

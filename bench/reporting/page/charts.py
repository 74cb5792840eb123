"""The charts of a page as SVG that takes its ink and paper, and as PDF for papers."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bench.errors import DataError
from bench.evaluation.likelihood import ThresholdSweep, threshold_sweep
from bench.evaluation.maps import THRESHOLDS, CoverageCurve, ImageMap, coverage_curves, range_maps
from bench.harness import read_image_maps
from bench.recordings.atomic import write_bytes
from bench.reference import Category
from bench.reporting.canvas import GREY, VERMILION, figure_bytes, new_figure, styled
from bench.reporting.page.source import PageSource, read_source
from bench.reporting.range_maps import draw_range_maps
from bench.reporting.tables import LABELS

_JPEG_QUALITY = 82
_INK = re.compile("#000000|#303030")


def inline_svg(figure: Figure, *, name: str, label: str) -> Markup:
    """A figure as an `<svg>` element.

    Black becomes the page's text colour and white its background; ids carry the name, so that two figures on one page
    do not meet.

    Args:
        figure: drawn in black on white.
        name: of letters, digits and dashes, used once on a page.
        label: says in words what the figure shows.
    """
    text = figure_bytes(figure, "svg").decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(
        r'<(g|path) id="(?:figure|axes|patch|matplotlib|line2d|text|xtick|ytick|legend|Quad)[^"]*"', r"<\1", text
    )
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", text)
    text = _INK.sub("currentColor", text).replace("#ffffff", "var(--paper)")
    head = re.sub(r'\s(width|height|version|xmlns(:xlink)?)="[^"]*"', "", text[: text.index(">")])
    opened = f'{head} class="chart" role="img" aria-label="{escape(label)}" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return Markup(opened + text[text.index(">") :])  # matplotlib escapes its texts


def jpeg_uri(image: NDArray[np.uint8]) -> str:
    """A BGR image as a `data:` address."""
    found, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    assert found, "OpenCV writes JPEG"
    return "data:image/jpeg;base64," + base64.b64encode(content.tobytes()).decode()


def figure_uri(figure: Figure, *, scale: float = 1.0) -> str:
    """A figure as a `data:` address, for pictures with photographs in them."""
    image = cv2.imdecode(np.frombuffer(figure_bytes(figure, "png"), dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None, "matplotlib writes PNG"
    if scale != 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return jpeg_uri(np.asarray(image, dtype=np.uint8))


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One chart: its drawing and a line below."""

    svg: Markup
    caption: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Charts:
    """The charts of a section; without any, `missing` says why."""

    charts: tuple[Chart, ...]
    missing: str = ""


def range_chart(source: PageSource) -> Chart:
    """The range maps."""
    label = "Detection rate around the host seen from above, by class and direction of motion"
    return Chart(svg=inline_svg(range_figure(source), name="range", label=label))


def range_figure(source: PageSource) -> Figure:
    """The range maps as a figure."""
    maps = range_maps(source.objects, protocol=source.protocol)
    return draw_range_maps(maps, vehicle_outline_m=np.array(source.run.vehicle_outline_m, dtype=np.float64))


def coverage_charts(source: PageSource) -> Charts:
    """Detection rate against the coverage that counts as found, one chart a category."""
    charts = tuple(
        Chart(svg=inline_svg(figure, name=f"coverage-{name}", label=f"Found against coverage threshold, {name}"))
        for name, figure in coverage_figures(source)
    )
    return Charts(charts=charts, missing="" if charts else "No object-frame was evaluated.")


def coverage_figures(source: PageSource) -> Iterator[tuple[str, Figure]]:
    """Name and figure of every category with cases."""
    for name, (found, chance) in coverage_curves(source.objects, protocol=source.protocol).items():
        if found.object_frames:
            yield name, draw_coverage_curve(found, chance, title=LABELS[Category(name)].split(" (")[0])


def threshold_charts(source: PageSource) -> Charts:
    """The sweep of the likelihood's threshold."""
    sweep = read_sweep(source)
    if isinstance(sweep, str):
        return Charts(charts=(), missing=sweep)
    names = "sweep", "precision"
    labels = "Pixels found against image wrongly marked", "Precision against recall"
    figures = threshold_figures(source, sweep)
    drawn = zip(names, labels, figures, strict=True)
    return Charts(charts=tuple(Chart(svg=inline_svg(f, name=n, label=label)) for n, label, f in drawn))


def read_sweep(source: PageSource) -> ThresholdSweep | str:
    """The sweep, or why there is none."""
    return threshold_sweep(source.frames) or (
        "The run holds no likelihoods: its method gives masks only, or it was stored before likelihoods were kept."
    )


def threshold_figures(source: PageSource, sweep: ThresholdSweep) -> tuple[Figure, Figure]:
    """Both figures of the sweep; the run itself is marked as it was scored."""
    recall, precision = (figure.value for figure in (source.run.segmentation.recall, source.run.segmentation.precision))
    return (
        draw_threshold_curve(
            sweep.false_positive_coverage,
            sweep.tpr,
            marked=(source.figures.false_positives.coverage.value, recall),
        ),
        draw_precision_curve(sweep.recall, sweep.precision, marked=(recall, precision), auprc=sweep.auprc),
    )


def plane_charts(source: PageSource) -> Charts:
    """Misses and false positives on the image plane of every camera."""
    maps = read_maps(source)
    if isinstance(maps, str):
        return Charts(charts=(), missing=maps)
    charts = []
    for number, one in enumerate(maps):
        missed, false = plane_figures(one)
        caption = f"Camera {one.camera}, {one.frames} images of {one.width} x {one.height} px."
        charts.append(
            Chart(svg=inline_svg(missed, name=f"missed-{number}", label=f"Misses, {caption}"), caption=caption)
        )
        charts.append(Chart(svg=inline_svg(false, name=f"false-{number}", label=f"False, {caption}"), caption=caption))
    return Charts(charts=tuple(charts))


def read_maps(source: PageSource) -> tuple[ImageMap, ...] | str:
    """The image maps, or why there are none."""
    try:
        return tuple(read_image_maps(source.folder).values())
    except DataError:
        return "The run holds no maps of the image plane: it was stored before they were kept."


def plane_figures(one: ImageMap) -> tuple[Figure, Figure]:
    """Misses and false positives of one camera."""
    size = {"width": one.width, "height": one.height}
    return (
        draw_plane_map(one.missed_rate, **size, title=f"{one.camera}: missed", bar="% of the moving pixels missed"),
        draw_plane_map(one.false_rate, **size, title=f"{one.camera}: wrongly marked", bar="% of the images"),
    )


def write_figures(folder: Path, *, category: Category | None = None) -> tuple[Path, ...]:
    """Write the charts of a run's page as `<run>/figures/*.pdf`; those of one kind of motion carry its name.

    Raises:
        DataError: a stored result is missing or damaged.
    """
    source = read_source(folder, category=category)
    suffix = "" if source.category is None else f"-{source.category.value}"
    figures: dict[str, Figure] = {f"range_map{suffix}": range_figure(source)}
    figures |= {f"coverage-{name}": figure for name, figure in coverage_figures(source)}
    if source.category is None:
        sweep, maps = read_sweep(source), read_maps(source)
        if not isinstance(sweep, str):
            figures |= dict(zip(("threshold_sweep", "precision_recall"), threshold_figures(source, sweep), strict=True))
        if not isinstance(maps, str):
            for number, one in enumerate(maps):
                figures |= dict(zip((f"missed-{number}", f"false-{number}"), plane_figures(one), strict=True))
    for name, figure in figures.items():
        write_bytes(source.folder / "figures" / f"{name}.pdf", figure_bytes(figure, "pdf"))
    return tuple(source.folder / "figures" / f"{name}.pdf" for name in figures)

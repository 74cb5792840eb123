"""The charts of a page, each as SVG with the words that go with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from bench.errors import DataError
from bench.evaluation.coverage_curves import coverage_curves
from bench.evaluation.image_maps import ImageMap
from bench.evaluation.likelihood import ThresholdSweep, threshold_sweep
from bench.evaluation.maps import range_maps
from bench.harness import read_image_maps
from bench.reference import Category
from bench.reporting.page.charts import draw_coverage_curve, draw_plane_map, draw_precision_curve, draw_threshold_curve
from bench.reporting.page.source import PageSource
from bench.reporting.page.svg import inline_svg
from bench.reporting.range_maps import draw_range_maps
from bench.reporting.tables import LABELS


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

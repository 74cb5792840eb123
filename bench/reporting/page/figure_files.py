"""The charts of a page as PDF, for papers."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from bench.recordings.atomic import write_bytes
from bench.reference import Category
from bench.reporting.canvas import figure_bytes
from bench.reporting.page.chart_section import (
    coverage_figures,
    plane_figures,
    range_figure,
    read_maps,
    read_sweep,
    threshold_figures,
)
from bench.reporting.page.source import read_source


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

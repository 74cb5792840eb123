"""The page of a run, from stored results to one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from bench.recordings.atomic import write_text
from bench.reference import Category
from bench.reporting.page.charts import coverage_charts, plane_charts, range_chart, threshold_charts
from bench.reporting.page.frames import (
    Card,
    FrameView,
    Progress,
    frame_cards,
    gallery_keys,
    object_cards,
    pick,
    view_frames,
)
from bench.reporting.page.source import FrameKey, PageSource, read_source
from bench.reporting.page.tables import (
    breakdown_tables,
    cause_bars,
    false_positive_lines,
    headline,
    ledger_rows,
    of_recordings,
    provenance_rows,
    remarks,
    script_json,
    stage_bars,
    table_data,
)
from bench.reporting.sheets import NOTE, sheets
from bench.reporting.tables import LABELS, table_rows

WORST, WORST_OF_CATEGORY = 3, 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """What was written.

    Attributes:
        file: the page.
        problems: why pictures are missing, one line each.
    """

    file: Path
    problems: tuple[str, ...]


def write_page(
    folder: Path,
    *,
    category: Category | None = None,
    out: Path | None = None,
    pictures: bool = True,
    progress: Progress | None = None,
) -> Page:
    """Write the page of a run, or of one kind of motion of it.

    Args:
        folder: of the run.
        category: only this kind of motion, with a larger gallery; None for all.
        out: the file; `index.html`, or `index-<category>.html`, in the run without it.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
    """
    source = read_source(folder, category=category)
    picked = pick(source, most=WORST if category is None else WORST_OF_CATEGORY)
    views: dict[FrameKey, FrameView] = {}
    problems: list[str] = []
    if pictures:
        views, problems = view_frames(source, gallery_keys(picked), progress=progress)
    objects, images = object_cards(source, picked, views), frame_cards(source, picked, views)
    file = out or folder / ("index.html" if category is None else f"index-{category.value}.html")
    write_text(file, _render(source, objects, images, problems=problems, pictures=pictures))
    return Page(file=file, problems=tuple(problems))


def _render(
    source: PageSource,
    objects: Mapping[str, Sequence[Card]],
    images: Sequence[Card],
    *,
    problems: Sequence[str],
    pictures: bool,
) -> str:
    rows = [row for row in table_rows(source.figures) if source.category in (None, row.name)]
    whole = source.category is None
    cards = [*(card for some in objects.values() for card in some), *images]
    pictured: dict[tuple[str, str, int, str], str] = {}
    for card in reversed(cards):  # of several cards of an image the first
        if card.view is not None:
            pictured |= {(*card.key, track): card.element for track in ("", card.track)}
    table = table_data(source, pictured=pictured)
    context: dict[str, Any] = {
        "run": source.run,
        "folder": source.folder.resolve().name,
        "whole": whole,
        "category": None if source.category is None else LABELS[source.category],
        "remarks": remarks(source.figures, category=source.category),
        "headline": headline(rows),
        "sheets": sheets(rows)[1 : 4 if whole else 3],
        "false_positives": false_positive_lines(source.figures) if whole else None,
        "note": NOTE,
        "caveats": source.run.caveats,
        "breakdowns": breakdown_tables(source.figures),
        "range_map": range_chart(source),
        "plane_maps": plane_charts(source) if whole else None,
        "coverage": coverage_charts(source),
        "thresholds": threshold_charts(source) if whole else None,
        "causes": cause_bars(source.figures) if whole else None,
        "of_recordings": of_recordings(source.figures.false_positives.recordings),
        "galleries": objects,
        "labels": {category.value: label for category, label in LABELS.items()},
        "images": images,
        "problems": problems,
        "pictures": pictures,
        "rows": script_json(table),
        "listed": table["rows"],
        "annotated": table["annotated"],
        "stages": stage_bars(source.run.provenance),
        "provenance": provenance_rows(source.run),
        "ledger": ledger_rows(source.figures),
        "style": _packaged("page.css"),
        "script": _packaged("page.js"),
    }
    text: str = _template().render(context)
    return text


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("bench.reporting.page", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2")


def _packaged(name: str) -> Markup:
    return Markup(resources.files("bench.reporting.page").joinpath(name).read_text("utf-8"))  # ours

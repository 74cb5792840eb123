"""The page of a run, from stored results to one file."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from bench.evaluation import published
from bench.recordings.atomic import write_text
from bench.reference import Category
from bench.reporting.formats import LABELS, chance_of, count, mean, percent, with_interval
from bench.reporting.page.beside import Beside, beside
from bench.reporting.page.charts import draw_charts, inline_svg
from bench.reporting.page.object_table import table_data
from bench.reporting.page.recordings import recording_rows
from bench.reporting.page.summary import breakdowns, remarks, tiles
from bench.reporting.page.worst import Progress, WorstCases, worst_cases
from bench.reporting.stored_run import StoredRun, read_stored_run
from bench.reporting.tables import (
    COVERAGES,
    detection_columns,
    further_columns,
    left_out_note,
    rows_with_cases,
    table_note,
    table_rows,
    text_tables,
)

WORST, WORST_OF_CATEGORY = 3, 12
# TPR over all stands at a glance and in every breakdown; with it here, the table would be wider than most screens.
_HEADLINE = {name: heading for name, heading in COVERAGES.items() if name != "tpr_all"}


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
    other: Path | None = None,
    pictures: bool = True,
    progress: Progress | None = None,
) -> Page:
    """Write the page of a run, or of one kind of motion of it.

    Args:
        folder: of the run.
        category: only this kind of motion, with a larger gallery; None for all.
        out: the file; `index.html`, or `index-<category>.html`, in the run without it.
        other: folder of a run to stand beside on the same images; None for none.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
        UsageError: `other` does not compare.
    """
    run = read_stored_run(folder, category=category)
    pair = None if other is None else beside(run, other, pictures=pictures, progress=progress)
    most = WORST if category is None else WORST_OF_CATEGORY
    worst = worst_cases(run, most=most, pictures=pictures, progress=progress)
    file = out or folder / ("index.html" if category is None else f"index-{category.value}.html")
    write_text(file, _render(run, worst, pair, pictures=pictures))
    problems = dict.fromkeys([*worst.problems, *(pair.problems if pair else ())])
    return Page(file=file, problems=tuple(problems))


def _render(run: StoredRun, worst: WorstCases, pair: Beside | None, *, pictures: bool) -> str:
    rows = [row for row in table_rows(run.metrics) if run.category in (None, row.name)]
    shown = rows_with_cases(rows)
    whole, found, made = run.category is None, run.metrics, run.summary.provenance
    (_, any_pixel), *levels = detection_columns(rows).items()
    rates = {name: f"found {heading}" for name, heading in reversed(levels)} | {
        "detection_rate": f"{any_pixel} (any pixel)"
    }
    further = further_columns(rows)
    listed, all_recordings = recording_rows(run, worst)
    recordings = found.false_positives.recordings
    causes = [(name, cause) for name, cause in found.false_positive_causes.items() if not math.isnan(cause.value)]
    context: dict[str, Any] = {
        "run": run.summary,
        "made": made,
        "found": found,
        "folder": run.label,
        "whole": whole,
        "category": None if run.category is None else LABELS[run.category],
        "remarks": remarks(found, category=run.category),
        "rows": shown,
        "left_out": left_out_note(rows),
        "columns": _HEADLINE | rates,
        "tiles": tiles(found, category=run.category),
        "paper": published.SOURCE,
        "changed_settings": run.summary.manifest.method.changed_settings(),
        "recordings": listed,
        "all_recordings": all_recordings,
        "tables": text_tables(shown)[1 : 4 if whole else 3] if shown else (),
        "note": table_note(rows),
        "unknown": "unknown_share" in further,
        "breakdowns": breakdowns(found),
        "sections": draw_charts(run),
        "causes": sorted(causes, key=lambda item: -item[1].value),
        "of_recordings": "" if recordings is None else f" of {recordings} recordings",
        "worst": worst,
        "beside": pair,
        "labels": {category.value: label for category, label in LABELS.items()},
        "pictures": pictures,
        "objects": table_data(run, pictured=_pictured(worst)),
        "stages": sorted(made.stage_seconds.items(), key=lambda item: -item[1]),
        "computed": made.images if made.work is None else made.work.images_computed,
        "settings": json.dumps(run.summary.manifest.method.settings),
        "style": _packaged("page.css"),
        "script": _packaged("page.js"),
    }
    text: str = environment().get_template("page.html.j2").render(context)
    return text


def _pictured(worst: WorstCases) -> dict[tuple[str, str, int, str], str]:
    """The card of every object and, under track "", of every image; of several cards of an image the first."""
    cards = [*(card for some in worst.objects.values() for card in some), *worst.images]
    return {(*card.key, track): card.element for card in reversed(cards) if card.view for track in ("", card.track)}


@cache
def environment() -> jinja2.Environment:
    """The templates, which escape what they are given."""
    made = jinja2.Environment(
        loader=jinja2.PackageLoader("bench.reporting.page", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"percent": percent, "with_interval": with_interval, "mean": mean, "count": count}
    made.filters |= {"chance_of": chance_of, "svg": inline_svg}
    made.tests["nan"] = math.isnan
    # Inside of a <script> element nothing may close it: `tojson` escapes what could.
    made.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "ensure_ascii": False, "allow_nan": False}
    return made


def _packaged(name: str) -> Markup:
    return Markup(resources.files("bench.reporting.page").joinpath(name).read_text("utf-8"))  # ours

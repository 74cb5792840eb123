"""The page of a run, from stored results to one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.atomic import write_output
from bench.evaluation import published
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun, read_run
from bench.reference import Category
from bench.reporting.document import Block, Folded, Paragraph, packaged, render
from bench.reporting.findings import run_findings
from bench.reporting.formats import LABELS
from bench.reporting.page import tables
from bench.reporting.page.beside import Beside, beside
from bench.reporting.page.charts import draw_charts, inline_svg
from bench.reporting.page.object_table import table_data
from bench.reporting.page.summary import breakdowns, kind_tables, remarks, tiles
from bench.reporting.page.worst import IMAGE_NOTE, OBJECT_NOTE, Card, Gallery, worst_cases
from bench.reporting.tables import left_out_note, rows_with_cases, table_note, table_rows, text_tables

WORST, WORST_OF_CATEGORY = 3, 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Page that was written.

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
        folder: of the run or of its results by a protocol.
        category: only this kind of motion, with a larger gallery; None for all.
        out: the file; `index.html`, or `index-<category>.html`, beside the results without it.
        other: folder of a run to stand beside on the same images; None for none.
        pictures: process the worst images once more and show them.
        progress: called with the images done and their number.

    Raises:
        DataError: a stored result is missing or damaged. Missing data for pictures is no error; it is said.
        UsageError: `other` does not compare.
    """
    run = read_run(folder, category=category)
    pair = None if other is None else beside(run, other, pictures=pictures, progress=progress)
    most = WORST if category is None else WORST_OF_CATEGORY
    worst, problems = worst_cases(run, most=most, pictures=pictures, progress=progress)
    file = out or run.folder / ("index.html" if category is None else f"index-{category.value}.html")
    write_output(file, _render(run, worst, problems, pair, pictures=pictures))
    return Page(file=file, problems=tuple(dict.fromkeys([*problems, *(pair[-1] if pair else ())])))


def _render(run: StoredRun, worst: list[Gallery], problems: list[str], pair: Beside | None, *, pictures: bool) -> str:
    whole, found, made = run.category is None, run.metrics, run.summary.provenance
    cards = [card for *_, of_gallery in worst for card in of_gallery]
    recordings = found.false_positives.recordings
    of_recordings = "" if recordings is None else f" of {recordings} recordings"
    context: dict[str, Any] = {
        "run": run.summary,
        "manifest": run.manifest,
        "made": made,
        "found": found,
        "folder": run.label,
        "whole": whole,
        "category": None if run.category is None else LABELS[run.category],
        "of_recordings": of_recordings,
        "paper": published.SOURCE,
        "changed_settings": run.manifest.method.changed_settings(),
        "tiles": tiles(found, category=run.category),
        "kinds": kind_tables(found),
        "remarks": remarks(found),
        "results": _results(run),
        "unknown": "unknown_share" in found.all_moving.metric_names(),
        "breakdowns": breakdowns(found),
        "recordings": [tables.recording_table(run, cards)],
        "charts": draw_charts(run),
        "causes": tables.cause_table(found, of_recordings=of_recordings),
        "problems": problems,
        "worst_notes": [Paragraph(note, "dim") for note in (OBJECT_NOTE, *([IMAGE_NOTE] if whole else []))],
        "galleries": worst,
        "beside": pair,
        "pictures": pictures,
        "objects": table_data(run, pictured=_pictured(cards)),
        "time": [tables.time_table(made.stage_seconds, images=made.images)],
        "computed": made.images_asked,
        "origin": [tables.origin_table(run)],
        "ledger": tables.ledger_tables(found),
        "findings": run_findings(run.folder),
        "style": packaged("page/page.css"),
        "script": packaged("page/page.js"),
        "svg": inline_svg,
    }
    return render("page/page.html.j2", **context)


def _results(run: StoredRun) -> list[Block]:
    """Ours beside the paper's, and all metrics with their intervals behind a line."""
    rows = [row for row in table_rows(run.metrics) if run.category in (None, row.name)]
    blocks: list[Block] = []
    if shown := rows_with_cases(rows):
        beside_papers, *others = (replace(table, note="") for table in text_tables(shown) if table.rows)
        blocks += [beside_papers, Folded("All metrics with their intervals", others)]
    if left_out := left_out_note(rows):
        blocks.append(Paragraph(left_out, "dim"))
    return [*blocks, Paragraph(table_note(rows), "dim")]


def _pictured(cards: Sequence[Card]) -> dict[tuple[str, str, int, str], str]:
    """The card of every object and, under track "", of every image; of several cards of an image the first."""
    shown = [card for card in reversed(cards) if card.view]
    return {(*card.key, track): card.element for card in shown for track in ("", card.track or "")}

"""The files of a run's report: the table as Markdown, LaTeX, CSV and JSON from the same rows, and the range maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bench.reporting import document
from bench.reporting.canvas import write_picture
from bench.reporting.document import Paragraph, latex_label
from bench.reporting.formats import annotations_field, metric_record, shortened, write_texts
from bench.reporting.range_maps import draw_run_maps
from bench.reporting.stored_run import StoredRun, read_stored_run
from bench.reporting.tables import TableRow, table_note, table_rows, text_tables, threshold_free_line

SCHEMA_VERSION = 1
_LONGEST_SETTINGS = 80  # characters in a caption


def to_markdown(rows: Sequence[TableRow], *, threshold_free: str = "", caveats: str = "") -> str:
    """The table as GitHub's Markdown, with metrics over all thresholds and what a reader has to know of the data."""
    tables = [replace(table, note="") for table in text_tables(rows)]
    notes = [threshold_free, table_note(rows), f"The data: {' '.join(caveats.split())}" if caveats.strip() else ""]
    return document.to_markdown([*tables, *(Paragraph(note) for note in notes if note)])


def to_latex(rows: Sequence[TableRow], *, label: str, about: str) -> str:
    r"""The table in the paper's LaTeX; kinds of motion without cases are left out.

    Args:
        rows: of the table.
        label: of the floats, the first has the `\label` "tab:<label>-paper".
        about: in the captions, behind the title.
    """
    return document.to_latex(text_tables([row for row in rows if row.frames]), label=label, about=about)


def _about(run: StoredRun) -> str:
    """Method, data set and protocol; settings that are not the method's defaults; annotations that nobody reviewed."""
    summary = run.summary
    method, data = summary.manifest.method, summary.manifest.dataset
    settings = [f"{name} = {value}" for name, value in method.changed_settings().items()]
    shown = shortened(", ".join(settings), _LONGEST_SETTINGS) or "default settings"
    split = f", split {data.split}" if data.split else ""
    told = f"method {method.name} ({shown}), data set {data.name}{split}, {run.protocol.name}"
    return ", ".join(part for part in (told, summary.unreviewed.rstrip(".")) if part)


def to_csv(rows: Sequence[TableRow], *, unreviewed: str = "") -> str:
    """One line per row and metric, ratios in [0, 1] at full precision; empty where there is no number.

    Args:
        rows: of the table.
        unreviewed: `RunSummary.unreviewed`, which stands in each line of such a run.
    """
    return document.to_csv(_records(rows, unreviewed))


def to_json(rows: Sequence[TableRow], *, unreviewed: str = "") -> str:
    """The same lines with null where there is no number, and how to read them."""
    content = {"schema_version": SCHEMA_VERSION, "note": table_note(rows), "rows": _records(rows, unreviewed)}
    return document.to_json(content)


def _records(rows: Sequence[TableRow], unreviewed: str) -> list[dict[str, object]]:
    return [
        {"row": row.name, "label": row.label, "frames": row.frames, "paper_frames": row.paper_frames,
         "tracks": row.tracks, "metric": name} | metric_record(metric)
        | {"recordings": row.recordings, "paper": row.paper.get(name), "difference_points": row.difference_points(name)}
        | annotations_field(unreviewed)
        for row in rows
        for name, metric in row.metrics.items()
    ]  # fmt: skip


def write_report_files(run: Path) -> tuple[list[TableRow], tuple[Path, ...]]:
    """Write `table.md`, `.csv`, `.tex`, `.json` and `range_map.png`, `.svg` into the folder of a run.

    Returns:
        rows: of the table, for the terminal.
        files: paths, tables first.

    Raises:
        DataError: a stored result is missing or damaged, or the files are not of one run.
    """
    stored = read_stored_run(run)
    summary, rows = stored.summary, table_rows(stored.summary)
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    texts = {
        "table.md": to_markdown(rows, threshold_free=over_all, caveats=summary.caveats),
        "table.csv": to_csv(rows, unreviewed=summary.unreviewed),
        "table.tex": to_latex(rows, label=latex_label(stored.label), about=_about(stored)),
        "table.json": to_json(rows, unreviewed=summary.unreviewed),
    }
    return rows, (*write_texts(run, texts), *write_picture(run / "range_map", draw_run_maps(stored)))

"""The files of a run's report: the table as Markdown, LaTeX and CSV from the same rows, and the range maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bench.harness.stored import StoredRun
from bench.reporting.canvas import write_picture
from bench.reporting.document import Paragraph, Report, latex_label, to_latex
from bench.reporting.formats import annotations_field, metric_record, shortened
from bench.reporting.range_maps import draw_run_maps
from bench.reporting.tables import TableRow, table_note, table_rows, text_tables, threshold_free_line

_LONGEST_SETTINGS = 80  # characters in a caption


def report(
    rows: Sequence[TableRow], *, notes: Sequence[str] = (), unreviewed: str = "", label: str = "", about: str = ""
) -> Report:
    r"""The table of a run; a line of numbers per row and metric, ratios in [0, 1].

    In LaTeX, kinds of motion without cases are left out.

    Args:
        rows: of the table.
        notes: on the method and the data, around the note on how to read the table.
        unreviewed: `RunSummary.unreviewed`, which stands in each line of numbers of such a run.
        label: of the floats of LaTeX, the first has the `\label` "tab:<label>-paper".
        about: in their captions, behind the title.
    """
    numbers: list[dict[str, object]] = [
        {"row": row.name, "label": row.label, "frames": row.frames, "paper_frames": row.paper_frames,
         "tracks": row.tracks, "metric": name} | metric_record(metric)
        | {"recordings": row.recordings, "paper": row.paper.get(name), "difference_points": row.difference_points(name)}
        | annotations_field(unreviewed)
        for row in rows
        for name, metric in row.metrics.items()
    ]  # fmt: skip
    tables = [replace(table, note="") for table in text_tables(rows)]
    return Report(
        title="",
        blocks=[*tables, *map(Paragraph, filter(None, [*notes[:1], table_note(rows), *notes[1:]]))],
        numbers=numbers,
        latex=to_latex(text_tables([row for row in rows if row.frames]), label=label, about=about),
    )


def _about(run: StoredRun) -> str:
    """Method, data set and protocol; settings that are not the method's defaults; annotations that nobody reviewed."""
    method, data = run.manifest.method, run.manifest.dataset
    settings = [f"{name} = {value}" for name, value in method.changed_settings().items()]
    shown = shortened(", ".join(settings), _LONGEST_SETTINGS) or "default settings"
    split = f", split {data.split}" if data.split else ""
    told = f"method {method.name} ({shown}), data set {data.name}{split}, {run.protocol.name}"
    return ", ".join(part for part in (told, run.summary.unreviewed.rstrip(".")) if part)


def write_report_files(run: StoredRun) -> tuple[list[TableRow], tuple[Path, ...]]:
    """Write `table.md`, `.csv`, `.tex` and `range_map.png`, `.svg` into the folder of a run.

    Returns:
        rows: of the table, for the terminal.
        files: paths, tables first.

    Raises:
        DataError: a table of the run is damaged.
    """
    summary, rows = run.summary, table_rows(run.summary)
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    caveats = f"The data: {' '.join(summary.caveats.split())}" if summary.caveats.strip() else ""
    tables = report(
        rows,
        notes=[over_all, caveats],
        unreviewed=summary.unreviewed,
        label=latex_label(run.label),
        about=_about(run),
    )
    return rows, (*tables.write(run.folder, "table"), *write_picture(run.folder / "range_map", draw_run_maps(run)))

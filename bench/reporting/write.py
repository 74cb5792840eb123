"""The files of a report, from the stored results of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.evaluation.maps import range_maps
from bench.harness import open_tables, read_protocol, read_run
from bench.recordings.atomic import write_bytes, write_text
from bench.reporting.canvas import PictureFormat, figure_bytes
from bench.reporting.range_maps import draw_range_maps
from bench.reporting.table_files import to_csv, to_json, to_latex, to_markdown
from bench.reporting.tables import TableRow, table_rows
from bench.reporting.threshold_free_line import threshold_free_line

PICTURE_FORMATS: tuple[PictureFormat, ...] = ("png", "svg")


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What was written.

    Attributes:
        rows: of the table, for the terminal.
        files: paths, tables first.
    """

    rows: tuple[TableRow, ...]
    files: tuple[Path, ...]


def write_report_files(run: Path) -> Report:
    """Write `table.md`, `.csv`, `.tex`, `.json` and `range_map.png`, `.svg` into the folder of a run.

    Raises:
        DataError: a stored result is missing or damaged, or the files are not of one run.
    """
    summary = read_run(run)
    rules = read_protocol(run, summary)
    objects, _ = open_tables(run)
    rows = table_rows(summary)
    outline_m = np.array(summary.vehicle_outline_m, dtype=np.float64)
    picture = draw_range_maps(range_maps(objects, protocol=rules), vehicle_outline_m=outline_m)
    over_all = "" if summary.threshold_free is None else threshold_free_line(summary.threshold_free)
    tables = {
        run / "table.md": to_markdown(rows, threshold_free=over_all, caveats=summary.caveats),
        run / "table.csv": to_csv(rows),
        run / "table.tex": to_latex(rows),
        run / "table.json": to_json(rows),
    }
    for file, text in tables.items():
        write_text(file, text)
    return Report(rows=tuple(rows), files=(*tables, *write_picture(run / "range_map", picture)))


def write_picture(stem: Path, figure: Figure) -> tuple[Path, ...]:
    """Write a figure as `<stem>.png` and `<stem>.svg`, each whole or not at all."""
    files = tuple(stem.with_name(f"{stem.name}.{picture_format}") for picture_format in PICTURE_FORMATS)
    for file, picture_format in zip(files, PICTURE_FORMATS, strict=True):
        write_bytes(file, figure_bytes(figure, picture_format))
    return files

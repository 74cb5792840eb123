"""The files of a report, from the stored results of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.errors import DataError
from bench.evaluation.maps import range_maps
from bench.evaluation.protocol import Protocol
from bench.harness import RunSummary, read_protocol, read_run, read_tables
from bench.recordings.atomic import write_bytes, write_text
from bench.reporting.canvas import PictureFormat, figure_bytes
from bench.reporting.range_maps import draw_range_maps
from bench.reporting.table_files import to_csv, to_json, to_latex, to_markdown
from bench.reporting.tables import TableRow, table_rows

TABLES = {"table.md": to_markdown, "table.csv": to_csv, "table.tex": to_latex, "table.json": to_json}
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
    rules = read_rules(run, summary)
    objects, _ = read_tables(run)
    rows = table_rows(summary)
    outline_m = np.array(summary.vehicle_outline_m, dtype=np.float64)
    picture = draw_range_maps(range_maps(objects, protocol=rules), vehicle_outline_m=outline_m)
    tables = [_write_table(run / name, rows) for name in TABLES]
    return Report(rows=tuple(rows), files=(*tables, *write_picture(run / "range_map", picture)))


def write_picture(stem: Path, figure: Figure) -> tuple[Path, ...]:
    """Write a figure as `<stem>.png` and `<stem>.svg`, each whole or not at all."""
    files = tuple(stem.with_name(f"{stem.name}.{picture_format}") for picture_format in PICTURE_FORMATS)
    for file, picture_format in zip(files, PICTURE_FORMATS, strict=True):
        write_bytes(file, figure_bytes(figure, picture_format))
    return files


def read_rules(run: Path, summary: RunSummary) -> Protocol:
    """The protocol of a run.

    Raises:
        DataError: missing, or not that of the summary.
    """
    rules = read_protocol(run)
    if rules.digest != summary.protocol.digest:
        raise DataError(
            run / "protocol.json",
            wanted=f"the protocol of summary.json, with digest {summary.protocol.digest[:12]}",
            came=f"{rules.name!r} with digest {rules.digest[:12]}",
        )
    return rules


def _write_table(file: Path, rows: list[TableRow]) -> Path:
    write_text(file, TABLES[file.name](rows))
    return file

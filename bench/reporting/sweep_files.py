"""The files of a sweep, from its stored result."""

from __future__ import annotations

from pathlib import Path

from bench.harness.sweep import FILE, read_sweep
from bench.recordings import write_text
from bench.reporting.sweep_chart import draw_sweep
from bench.reporting.sweep_report import to_csv, to_markdown
from bench.reporting.write import write_picture


def write_sweep_files(folder: Path) -> tuple[Path, ...]:
    """Write `sweep.md`, `.csv`, `.png` and `.svg` beside `sweep.json`; all of their paths.

    Raises:
        DataError: the stored sweep is missing or damaged.
    """
    result = read_sweep(folder)
    tables = {folder / "sweep.md": to_markdown(result), folder / "sweep.csv": to_csv(result)}
    for file, text in tables.items():
        write_text(file, text)
    return (folder / FILE, *tables, *write_picture(folder / "sweep", draw_sweep(result)))

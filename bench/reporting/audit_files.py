"""The files of an audit for people, from its stored results."""

from __future__ import annotations

from pathlib import Path

from bench.harness.audit import AUDIT, read_audit, read_polygons
from bench.recordings import write_text
from bench.reporting.audit_chart import draw_fit_by_distance
from bench.reporting.audit_text import to_csv, to_markdown
from bench.reporting.write import write_picture


def write_audit_files(folder: Path) -> tuple[Path, ...]:
    """Write `audit.md`, `audit.csv`, `fit.png` and `fit.svg` beside `audit.json`; all of their paths.

    Raises:
        DataError: the stored audit is missing or damaged.
    """
    audit = read_audit(folder)
    tables = {folder / "audit.md": to_markdown(audit), folder / "audit.csv": to_csv(audit)}
    for file, text in tables.items():
        write_text(file, text)
    chart = draw_fit_by_distance(audit, read_polygons(folder))
    return (folder / AUDIT, *tables, *write_picture(folder / "fit", chart))

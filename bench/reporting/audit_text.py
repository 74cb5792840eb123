"""The tables of an audit as Markdown, CSV and `rich` tables."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.harness.audit import AuditSummary
from bench.plain_text import escape_markdown, plain
from bench.reporting.audit_figure_rows import figure_rows
from bench.reporting.audit_sheet import AuditTable
from bench.reporting.audit_tables import audit_tables

_WIDEST = 8  # columns of a table that a terminal holds
_COLUMNS = ("table", "kind", "compensation", "slice", "range_m", "figure", "cases", "value")


def to_markdown(audit: AuditSummary) -> str:
    """All tables with their notes, GitHub's Markdown."""
    made = audit.method
    dataset, method, protocol = map(escape_markdown, (audit.dataset, made.name, audit.protocol.name))
    head = [
        f"# Audit of {dataset}: lidar reference and {method}",
        f"{audit.recordings} recordings, protocol {protocol}, method {method}. {audit.not_seen} evaluated "
        "object-frames of which the camera sees no pixel are in none of the figures.",
    ]
    if audit.left_out:
        head.append(f"Without exact flow: {escape_markdown(audit.left_out)}.")
    return "\n\n".join([*head, *(_markdown(table) for table in audit_tables(audit))]) + "\n"


def to_csv(audit: AuditSummary) -> str:
    """One line per figure, at full precision; empty where there is no number."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, _COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for row in figure_rows(audit):
        value = row["value"]
        text = "" if isinstance(value, float) and math.isnan(value) else repr(value)
        writer.writerow({**row, "value": text})
    return buffer.getvalue()


def to_rich(audit: AuditSummary) -> Iterator[tuple[Table, str]]:
    """The tables for a console of at least 110 columns, each with its note; nothing is printed here."""
    for item in audit_tables(audit):
        turned = item.labels < 2 and len(item.sheet.headings) > _WIDEST
        headings, rows = _turned(item) if turned else (item.sheet.headings, item.sheet.rows)
        table = Table(
            box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, title=item.sheet.title, title_justify="left"
        )
        words = max(item.labels, 1)
        for number, heading in enumerate(map(plain, headings)):
            table.add_column(
                Text(heading if number < words else heading.replace(" ", "\n", 1)),
                justify="left" if number < words else "right",
                no_wrap=not turned and number > 0,
            )
        before = ""
        for row in rows:
            table.add_row("" if row[0] == before else row[0], *row[1:])
            before = row[0]
        yield table, item.note


def _turned(item: AuditTable) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """A table too wide for a terminal, with rows for columns."""
    sheet = item.sheet
    if item.labels:
        return ("", *(row[0] for row in sheet.rows)), tuple(
            (heading, *(row[k] for row in sheet.rows)) for k, heading in enumerate(sheet.headings) if k
        )
    return ("", ""), tuple((heading, *(row[k] for row in sheet.rows)) for k, heading in enumerate(sheet.headings))


def _markdown(item: AuditTable) -> str:
    sheet = item.sheet
    rule = ["---"] * item.labels + ["---:"] * (len(sheet.headings) - item.labels)
    lines = [f"| {' | '.join(map(escape_markdown, row))} |" for row in (sheet.headings, rule, *sheet.rows)]
    return "\n".join([f"## {sheet.title}", "", *lines, "", item.note])

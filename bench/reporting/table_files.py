"""The table as Markdown, LaTeX, CSV and JSON, from the same rows."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from bench.plain_text import escape_markdown, plain
from bench.reporting.sheets import NOTE, Sheet, sheets
from bench.reporting.tables import Comparison, TableRow

SCHEMA_VERSION = 1
_SCRIPT_SIZE_HOLDS = 150  # letters across both columns of IEEEtran
_LATEX_SPECIAL = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        **{character: f"\\{character}" for character in "%&#_${}"},
    }
)


def to_markdown(rows: Sequence[TableRow], *, threshold_free: str = "", caveats: str = "") -> str:
    """The table as GitHub's Markdown, with figures over all thresholds and what a reader has to know of the data."""
    notes = [note for note in (threshold_free, NOTE) if note]
    notes += [f"The data: {escape_markdown(' '.join(caveats.split()))}"] if caveats.strip() else []
    return "\n\n".join([*(_markdown_sheet(sheet) for sheet in sheets(rows)), *notes]) + "\n"


def to_latex(rows: Sequence[TableRow]) -> str:
    """The table in the paper's LaTeX, for plain `article` or `IEEEtran` without further packages."""
    return "\n".join([*(_latex_sheet(sheet) for sheet in sheets(rows)), f"% {NOTE}"]) + "\n"


def to_csv(rows: Sequence[TableRow]) -> str:
    """One line per row and figure, ratios in [0, 1] at full precision; empty where there is no number."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(
        ["row", "label", "frames", "paper_frames", "tracks", "figure", "value", "ci95_low", "ci95_high", "cases",
         "paper", "difference_points", "recordings"]
    )  # fmt: skip
    for row in rows:
        for name, figure in row.figures.items():
            low, high = figure.ci95 or (math.nan, math.nan)
            numbers = [figure.value, low, high, figure.cases, figure.paper, figure.difference_points]
            writer.writerow(
                [
                    row.name,
                    row.label,
                    row.frames,
                    row.paper_frames,
                    row.tracks,
                    name,
                    *map(_or_empty, numbers),
                    row.recordings,
                ]
            )
    return buffer.getvalue()


def to_json(rows: Sequence[TableRow]) -> str:
    """The rows with ratios in [0, 1] at full precision; null where there is no number."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": NOTE,
        "rows": [
            {
                "name": row.name,
                "label": row.label,
                "frames": row.frames,
                "paper_frames": row.paper_frames,
                "tracks": row.tracks,
                "recordings": row.recordings,
                "figures": {name: _json_figure(figure) for name, figure in row.figures.items()},
            }
            for row in rows
        ],
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def escape_latex(text: str) -> str:
    """Text in which LaTeX's special characters stand for themselves."""
    return plain(text).translate(_LATEX_SPECIAL)


def _markdown_sheet(sheet: Sheet) -> str:
    cells = [[escape_markdown(cell) for cell in line] for line in (sheet.headings, *sheet.rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(sheet.headings))]
    padded = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in cells]
    first_is_text = sheet.headings[0] == "Type"
    rule = [":" + "-" * (w - 1) if i == 0 and first_is_text else "-" * (w - 1) + ":" for i, w in enumerate(widths)]
    return "\n".join([f"**{sheet.title}**", "", padded[0], "| " + " | ".join(rule) + " |", *padded[1:]])


def _latex_sheet(sheet: Sheet) -> str:
    """A floating table of the paper's form; `*` spans both columns, since ours is wider."""
    columns = "l | " + " ".join("r" * (len(sheet.headings) - 1))
    head = " & ".join(rf"\textbf{{{escape_latex(heading)}}}" for heading in sheet.headings)
    lines = [" & ".join(escape_latex(cell) for cell in line) + r" \\ \hline" for line in sheet.rows]
    return "\n".join(
        [
            r"\begin{table*}",
            rf"\caption{{{escape_latex(sheet.title)}}}",
            r"\begin{center}",
            r"\fontsize{6}{7}\selectfont" if _width(sheet) > _SCRIPT_SIZE_HOLDS else r"\scriptsize",
            r"\setlength{\tabcolsep}{3pt}",
            r"\renewcommand{\arraystretch}{1.5}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\hline",
            rf"{head} \\ \hline",
            *lines,
            r"\end{tabular}",
            r"\end{center}",
            r"\end{table*}",
        ]
    )


def _width(sheet: Sheet) -> int:
    """Letters in a line of the table, each column as wide as its widest cell."""
    return sum(max(len(cell) for cell in column) for column in zip(sheet.headings, *sheet.rows, strict=True))


def _json_figure(figure: Comparison) -> dict[str, Any]:
    return {
        "value": _or_none(figure.value),
        "ci95": None if figure.ci95 is None else list(figure.ci95),
        "cases": figure.cases,
        "paper": _or_none(figure.paper),
        "difference_points": _or_none(figure.difference_points),
    }


def _or_none(number: float) -> float | None:
    return None if math.isnan(number) else number


def _or_empty(number: float) -> str:
    return "" if math.isnan(number) else repr(number)

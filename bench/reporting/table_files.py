"""The files of a run's report: the table as Markdown, LaTeX, CSV and JSON from the same rows, and the range maps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.plain_text import escape_markdown, plain
from bench.reporting.canvas import write_picture
from bench.reporting.formats import TextTable, csv_text, json_text, write_texts
from bench.reporting.range_maps import draw_run_maps
from bench.reporting.stored_run import read_stored_run
from bench.reporting.tables import TableRow, table_note, table_rows, text_tables, threshold_free_line

SCHEMA_VERSION = 1
_SCRIPT_SIZE_HOLDS = 150  # letters across both columns of IEEEtran
_LATEX_SPECIAL = str.maketrans(
    {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {character: f"\\{character}" for character in "%&#_${}"}
)


def to_markdown(rows: Sequence[TableRow], *, threshold_free: str = "", caveats: str = "") -> str:
    """The table as GitHub's Markdown, with metrics over all thresholds and what a reader has to know of the data."""
    notes = [note for note in (threshold_free, table_note(rows)) if note]
    notes += [f"The data: {escape_markdown(' '.join(caveats.split()))}"] if caveats.strip() else []
    return "\n\n".join([*map(_markdown, text_tables(rows)), *notes]) + "\n"


def _markdown(table: TextTable) -> str:
    """A table whose columns are as wide in the file as on the page."""
    cells = [[escape_markdown(cell) for cell in line] for line in (table.headings, *table.rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    head, *body = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in cells]
    rule = [":" + "-" * (w - 1) if n < table.labels else "-" * (w - 1) + ":" for n, w in enumerate(widths)]
    return "\n".join([f"**{table.title}**", "", head, f"| {' | '.join(rule)} |", *body])


def to_latex(rows: Sequence[TableRow]) -> str:
    """The table in the paper's LaTeX, for plain `article` or `IEEEtran` without further packages."""
    return "\n".join([*map(_latex, text_tables(rows)), f"% {table_note(rows)}"]) + "\n"


def escape_latex(text: str) -> str:
    """Text in which LaTeX's special characters stand for themselves."""
    return plain(text).translate(_LATEX_SPECIAL)


def _latex(table: TextTable) -> str:
    """A floating table of the paper's form; `*` spans both columns, since ours is wider."""
    letters = sum(max(map(len, column)) for column in zip(table.headings, *table.rows, strict=True))
    size = r"\fontsize{6}{7}\selectfont" if letters > _SCRIPT_SIZE_HOLDS else r"\scriptsize"
    head = " & ".join(rf"\textbf{{{escape_latex(heading)}}}" for heading in table.headings)
    body = [" & ".join(map(escape_latex, line)) + r" \\ \hline" for line in table.rows]
    return "\n".join(
        [
            r"\begin{table*}",
            rf"\caption{{{escape_latex(table.title)}}}",
            r"\begin{center}",
            size,
            r"\setlength{\tabcolsep}{3pt}",
            r"\renewcommand{\arraystretch}{1.5}",
            rf"\begin{{tabular}}{{l | {' '.join('r' * (len(table.headings) - 1))}}}",
            r"\hline",
            rf"{head} \\ \hline",
            *body,
            r"\end{tabular}",
            r"\end{center}",
            r"\end{table*}",
        ]
    )


def to_csv(rows: Sequence[TableRow]) -> str:
    """One line per row and metric, ratios in [0, 1] at full precision; empty where there is no number."""
    lines = []
    for row in rows:
        for name, metric in row.metrics.items():
            low, high = metric.ci95 or (None, None)
            lines.append(
                {"row": row.name, "label": row.label, "frames": row.frames, "paper_frames": row.paper_frames,
                 "tracks": row.tracks, "figure": name, "value": metric.value, "ci95_low": low, "ci95_high": high,
                 "cases": metric.cases, "paper": row.paper.get(name),
                 "difference_points": row.difference_points(name), "recordings": row.recordings}
            )  # fmt: skip
    return csv_text(lines)


def to_json(rows: Sequence[TableRow]) -> str:
    """The rows with ratios in [0, 1] at full precision; null where there is no number."""
    fields = ("name", "label", "frames", "paper_frames", "tracks", "recordings")
    content = {
        "schema_version": SCHEMA_VERSION,
        "note": table_note(rows),
        "rows": [
            {field: getattr(row, field) for field in fields}
            | {
                "figures": {
                    name: {"value": metric.value, "ci95": metric.ci95, "cases": metric.cases,
                           "paper": row.paper.get(name), "difference_points": row.difference_points(name)}
                    for name, metric in row.metrics.items()
                }
            }
            for row in rows
        ],
    }  # fmt: skip
    return json_text(content, indent=2)


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
        "table.csv": to_csv(rows),
        "table.tex": to_latex(rows),
        "table.json": to_json(rows),
    }
    return rows, (*write_texts(run, texts), *write_picture(run / "range_map", draw_run_maps(stored)))

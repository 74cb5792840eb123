"""The files of a run's report: the table as Markdown, LaTeX, CSV and JSON from the same rows, and the range maps."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.plain_text import escape_markdown, plain
from bench.reporting.canvas import write_picture
from bench.reporting.formats import TextTable, csv_text, json_text, shortened, write_texts
from bench.reporting.range_maps import draw_run_maps
from bench.reporting.stored_run import StoredRun, read_stored_run
from bench.reporting.tables import TableRow, table_note, table_rows, text_tables, threshold_free_line

SCHEMA_VERSION = 1
LATEX_FLOATS = ("paper", "detection", "coverage", "false-positives")  # as `text_tables` gives them
_SHORT_HEADING = 8  # letters, in one line
_LONGEST_SETTINGS = 80  # characters in a caption
_SCRIPT_SIZE_HOLDS = 100  # letters across both columns of `article`, which are narrower than IEEEtran's
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LatexNames:
    """What floats of LaTeX are called.

    Attributes:
        label: before the name of each float, of letters, digits and dashes.
        about: method, data set and protocol, behind the title of each caption.
    """

    label: str
    about: str

    @classmethod
    def of(cls, run: StoredRun) -> LatexNames:
        """Of a run: its folder's name; the settings that are not the method's defaults are said."""
        summary = run.summary
        method, data = summary.manifest.method, summary.manifest.dataset
        settings = [f"{name} = {value}" for name, value in method.changed_settings().items()]
        told = shortened(", ".join(settings), _LONGEST_SETTINGS) or "default settings"
        split = f", split {data.split}" if data.split else ""
        about = f"method {method.name} ({told}), data set {data.name}{split}, {run.protocol.name}"
        return cls(label=latex_label(run.label), about=about)


def to_latex(rows: Sequence[TableRow], names: LatexNames) -> str:
    r"""The table in the paper's LaTeX, for plain `article` or `IEEEtran` in two columns, without further packages.

    Each float has a `\label`, "tab:<run>-paper" for the first, a caption with method and data set, and a note that says
    how to read it. Kinds of motion without cases are left out.
    """
    floats = zip(text_tables([row for row in rows if row.frames]), LATEX_FLOATS, strict=True)
    return "\n".join(
        latex_table(table, LatexNames(label=f"{names.label}-{name}", about=names.about)) for table, name in floats
    )


def latex_label(name: str) -> str:
    """A name of letters, digits and dashes, as part of a label."""
    return re.sub(r"[^A-Za-z0-9-]+", "-", name).strip("-")


def escape_latex(text: str) -> str:
    """Text in which LaTeX's special characters stand for themselves."""
    return plain(text).translate(_LATEX_SPECIAL)


def latex_table(table: TextTable, names: LatexNames) -> str:
    """A floating table of the paper's form with its note; `*` spans both columns, since ours is wider."""
    head = _two_lines(table.headings, _middle_space)
    body = [_two_lines(line, _interval_or_kind) for line in table.rows]
    every = [line for lines in (head, *body) for line in lines]
    letters = sum(max(map(len, column)) for column in zip(*every, strict=True))
    size = r"\fontsize{6}{7}\selectfont" if letters > _SCRIPT_SIZE_HOLDS else r"\scriptsize"
    bold = [[rf"\textbf{{{escape_latex(cell)}}}" if cell else "" for cell in line] for line in head]
    return "\n".join(
        [
            r"\begin{table*}",
            rf"\caption{{{escape_latex(table.title)}: {escape_latex(names.about)}.}}",
            rf"\label{{tab:{names.label}}}",
            r"\begin{center}",
            size,
            r"\setlength{\tabcolsep}{2.5pt}",
            r"\renewcommand{\arraystretch}{1.2}",
            rf"\begin{{tabular}}{{{'l ' * table.labels}| {' '.join('r' * (len(table.headings) - table.labels))}}}",
            r"\hline",
            _latex_row(bold),
            *(_latex_row([list(map(_latex_cell, line)) for line in lines]) for lines in body),
            r"\end{tabular}",
            rf"\par\smallskip\parbox{{\linewidth}}{{\scriptsize {escape_latex(table.note)}}}",
            r"\end{center}",
            r"\end{table*}",
        ]
    )


def _latex_cell(cell: str) -> str:
    """A cell in which the sign of a number is that of mathematics."""
    return re.sub(r"^[-+](?=\d)", lambda sign: f"${sign[0]}$", escape_latex(cell))


def _two_lines(cells: Sequence[str], split: Callable[[str, int], int]) -> list[list[str]]:
    """A row as one or two lines, so that columns are as narrow as their numbers; `split` says where a cell breaks."""
    places = [split(cell, column) for column, cell in enumerate(cells)]
    lines = [
        [cell[:place] if place > 0 else cell for cell, place in zip(cells, places, strict=True)],
        [cell[place + 1 :] if place > 0 else "" for cell, place in zip(cells, places, strict=True)],
    ]
    return lines if any(lines[1]) else lines[:1]


def _interval_or_kind(cell: str, _: int) -> int:
    """Before the interval of a number, or what stands in parentheses."""
    return max(cell.find(" ["), cell.find(" ("))


def _middle_space(heading: str, _: int) -> int:
    """The space nearest to the middle; -1 for none."""
    spaces = [place for place, letter in enumerate(heading) if letter == " " and len(heading) > _SHORT_HEADING]
    return min(spaces, key=lambda place: abs(2 * place - len(heading)), default=-1)


def _latex_row(lines: Sequence[Sequence[str]]) -> str:
    r"""Lines of a tabular with `\\hline` below the last one."""
    return " \\\\\n".join(map(" & ".join, lines)) + r" \\ \hline"


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
        "table.tex": to_latex(rows, LatexNames.of(stored)),
        "table.json": to_json(rows),
    }
    return rows, (*write_texts(run, texts), *write_picture(run / "range_map", draw_run_maps(stored)))

"""The table for the terminal, readable at 100 columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.reporting.sheets import COMPARED, COVERAGES, count, detection_figures, difference
from bench.reporting.tables import FALSE_POSITIVES, Comparison, TableRow

MIN_COLUMNS = 100  # a console narrower than this cuts the table
_NO_CASES = "n/a"
_HEADINGS = {
    "detection_rate": "Detec-\ntion",
    "tpr": "TPR\ndet.",
    "tpr_all": "TPR\nall",
    "iou": "IoU\nall",
    "iou_detected": "IoU\ndet.",
}


def to_rich(rows: Sequence[TableRow]) -> Table:
    """Five lines per category: ours, its 95 % interval, its chance level, the paper's, the difference; in percent.

    Returns:
        A table to print on a `rich.console.Console` of at least `MIN_COLUMNS`; nothing is printed here.
    """
    rates = detection_figures(rows)
    shown = rates | COVERAGES
    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 0, 1, 0),
        show_edge=False,
        title="Ours beside the paper's, in percent",
        title_justify="left",
        caption=_caption(rows),
        caption_justify="left",
    )
    table.add_column("Type", no_wrap=True)
    table.add_column("", style="dim", no_wrap=True)
    table.add_column("Recs", justify="right", no_wrap=True)
    table.add_column("Frames", justify="right", no_wrap=True)
    table.add_column("Objects", justify="right", no_wrap=True)
    for name, heading in shown.items():
        lines = Text(_HEADINGS.get(name, heading.replace(" ", "\n", 1)))
        table.add_column(lines, justify="right", no_wrap=True, min_width=6)
    for row in rows:
        if row.name == FALSE_POSITIVES:
            table.add_row(*_stacked(row, ["coverage"], lines=["ours", "95 %", "paper", "diff."]))
        else:
            table.add_row(*_stacked(row, list(shown), lines=["ours", "95 %", "chance", "paper", "diff."]))
    return table


def _stacked(row: TableRow, names: Sequence[str], *, lines: Sequence[str]) -> list[Text]:
    """The cells of a category, one below the other in each column."""
    frames = {"ours": count(row.frames), "paper": count(row.paper_frames)}
    return [
        Text(row.label.replace(" (", "\n(")),
        Text("\n".join(lines)),
        Text(count(row.recordings)),
        Text("\n".join(frames.get(line, "") for line in lines)),
        Text(count(row.tracks)),
        *(_figure_cell(_figure_lines(row, name), lines) for name in names),
    ]


def _figure_cell(figure: Mapping[str, str], lines: Sequence[str]) -> Text:
    text = Text(figure["ours"], style="" if figure["ours"] == _NO_CASES else "bold")
    return text.append("".join(f"\n{figure.get(line, '')}" for line in lines[1:]), style="not bold")


def _figure_lines(row: TableRow, name: str) -> dict[str, str]:
    figure = row.figures[name]
    found = {"ours": _NO_CASES if math.isnan(figure.value) else _number(figure.value), "95 %": _bounds(figure)}
    if name.startswith("detection_rate"):
        chance = row.figures[name.replace("detection_rate", "chance")]
        found["chance"] = "" if math.isnan(chance.value) else _number(chance.value)
    if name in COMPARED or row.name == FALSE_POSITIVES:
        known = not math.isnan(figure.paper)
        found |= {"paper": f"{100 * figure.paper:.0f}" if known else "", "diff.": difference(figure)}
    return found


def _number(ratio: float) -> str:
    return f"{100 * ratio:.1f}"


def _bounds(figure: Comparison) -> str:
    if math.isnan(figure.value):
        return f"({figure.cases})"
    return "" if figure.ci95 is None else f"{100 * figure.ci95[0]:.0f}-{100 * figure.ci95[1]:.0f}"


def _caption(rows: Sequence[TableRow]) -> Text:
    notes = [
        f"95 %: interval by recording; none where fewer than {FEWEST_RECORDINGS} recordings (recs) hold cases.",
        "Detection: object-frames with any pixel found, or at least the stated share of them.",
        "Chance: the same on the mask of another frame. n/a (0): no cases.",
        "TPR and IoU: det. over detected object-frames, the paper's reading; all over all of them.",
    ]
    for row in rows:
        rate = row.figures.get("frame_rate")
        if row.name == FALSE_POSITIVES and rate is not None and not math.isnan(rate.value):
            notes.append(
                f"False positives: share of the image; {100 * rate.value:.1f} % of the frames have a large one."
            )
    return Text("\n".join(notes))

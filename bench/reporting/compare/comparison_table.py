"""The comparison for the terminal, readable at 100 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.reporting.compare.changes import FALSE_POSITIVE_COVERAGE, MetricChange, RowChange
from bench.reporting.compare.comparison import RunComparison
from bench.reporting.compare.comparison_text import p_text, points, share
from bench.reporting.compare.verdicts import Verdict

MIN_COLUMNS = 100  # a console narrower than this cuts the table
_SHORT = {
    Verdict.BETTER: "better",
    Verdict.WORSE: "worse",
    Verdict.NOT_SHOWN: "not shown",
    Verdict.THE_SAME: "the same",
    Verdict.TOO_FEW: "few: {}",
    Verdict.NO_CASES: "",
}
_STYLES = {Verdict.BETTER: "green", Verdict.WORSE: "red"}
_LINES = ("before", "after", "diff.", "95 %", "p Holm", "verdict", "chance")
_CAPTION = (
    "Diff.: percentage points, 95 % interval in pairs over recordings. p: corrected over a column.\n"
    "Not shown: no difference that the data can show. Few: 4: cases of both in 4 recordings, a verdict needs 6.\n"
    "Chance: before/after, on the mask of another frame. False positives: share of the image."
)


def to_rich(comparison: RunComparison) -> Table:
    """Seven lines per row: before, after, difference, its interval, corrected p-value, verdict, chance levels.

    Returns:
        A table to print on a `rich.console.Console` of at least `MIN_COLUMNS`; nothing is printed here.
    """
    shown = _shown(comparison.rows)
    table = Table(
        box=SIMPLE_HEAD,
        padding=(0, 0, 1, 0),
        show_edge=False,
        min_width=MIN_COLUMNS,
        title=f"{comparison.after.label} (after) against {comparison.before.label} (before), in percent",
        title_justify="left",
        caption=Text(_CAPTION),
        caption_justify="left",
    )
    table.add_column("Type", no_wrap=True)
    table.add_column("", style="dim", no_wrap=True)
    for heading in shown.values():
        table.add_column(Text(heading), justify="right", no_wrap=True, min_width=9)
    for row in comparison.rows:
        metrics = [FALSE_POSITIVE_COVERAGE] if FALSE_POSITIVE_COVERAGE in row.metrics else list(shown)
        lines = _LINES[:-1] if FALSE_POSITIVE_COVERAGE in row.metrics else _LINES
        label = f"{row.label}\n{row.frames} frames\n{row.recordings} recordings"
        table.add_row(Text(label), Text("\n".join(lines)), *(_cell(row.metrics[metric], lines) for metric in metrics))
    return table


def _shown(rows: Sequence[RowChange]) -> dict[str, str]:
    """Any detection and that at the highest level; TPR and IoU over detected and over all."""
    levels = [name for name in rows[0].metrics if name.startswith("detection_rate_")]
    highest = max(levels, key=lambda name: float(name.removeprefix("detection_rate_")), default=None)
    at_level = {} if highest is None else {highest: f"Detection\nat {highest.removeprefix('detection_rate_')} %"}
    return {
        "detection_rate": "Detection\nany pixel",
        **at_level,
        "tpr": "TPR\ndetected",
        "iou_detected": "IoU\ndetected",
        "tpr_all": "TPR\nall",
        "iou": "IoU\nall",
    }


def _cell(cell: MetricChange, lines: Sequence[str]) -> Text:
    change = cell.change
    ends = "" if change.ci95 is None else ",".join(points(end) for end in change.ci95)
    found = {
        "before": share(change.before),
        "after": share(change.after),
        "diff.": points(change.difference),
        "95 %": ends,
        "p Holm": p_text(cell.p_holm),
        "verdict": "" if cell.verdict is None else _SHORT[cell.verdict].format(change.recordings),
        "chance": "" if cell.chance is None else "/".join(share(figure.value) for figure in cell.chance),
    }
    text = Text()
    for place, line in enumerate(lines):
        style = "bold" if line == "diff." else ""
        if line == "verdict" and cell.verdict is not None:
            style = _STYLES.get(cell.verdict, "")
        text.append(("\n" if place else "") + found[line], style=style)
    return text

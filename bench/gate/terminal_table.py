"""The verdict for the terminal: what failed first, what passed last."""

from __future__ import annotations

from collections import Counter

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation.metric_sums import NOT_RATIOS
from bench.evaluation.slices import ALL_MOVING, FRAMES
from bench.gate.verdict import Outcome, Row, Verdict

STYLES = {
    Outcome.FAILED: "bold red",
    Outcome.SUSPECT: "yellow",
    Outcome.IMPROVED: "green",
    Outcome.PASSED: "",
    Outcome.NOT_JUDGED: "dim",
}


def to_rich(verdict: Verdict) -> Table:
    """Every row that failed, is suspect or improved, worst first; of those within tolerance, the ones over everything.

    Returns:
        A table to print on a `rich.console.Console`; nothing is printed here.
    """
    table = Table(
        box=SIMPLE_HEAD,
        show_edge=False,
        title=f"{verdict.method} on {verdict.dataset} against the baseline, tolerances {verdict.tolerances}",
        title_justify="left",
        caption="Recs: recordings with cases of both. Percent and percentage points; components per image.",
        caption_justify="left",
    )
    table.add_column("", no_wrap=True)
    for heading in ("Slice", "Metric"):
        table.add_column(heading, overflow="fold")
    for heading in ("Recs", "Base-\nline", "Run", "Change", "95 % of\nthe change", "Toler-\nated"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for outcome in (Outcome.FAILED, Outcome.SUSPECT, Outcome.IMPROVED):
        for row in verdict.rows_with(outcome):
            table.add_row(*_cells(row))
    for row in verdict.rows:
        if row.outcome is Outcome.PASSED and row.slice_name in {ALL_MOVING, FRAMES}:
            table.add_row(*_cells(row))
    return table


def told_lines(verdict: Verdict) -> list[tuple[str, str]]:
    """A line and its style for each check that did not pass, then for each reason not to judge."""
    told = [check for check in verdict.checks if check.outcome is not Outcome.PASSED]
    lines = [(f"{check.outcome}: {check.message}", STYLES[check.outcome]) for check in told]
    return lines + [(line, STYLES[Outcome.NOT_JUDGED]) for line in _not_judged_lines(verdict)]


def _not_judged_lines(verdict: Verdict) -> list[str]:
    """Each reason with the slices that it concerns."""
    rows = verdict.rows_with(Outcome.NOT_JUDGED)
    slices: dict[str, dict[str, None]] = {}
    for row in rows:
        slices.setdefault(row.reason, {})[row.slice_name] = None
    count = Counter(row.reason for row in rows)
    return [
        f"not judged: {count[reason]} metrics, {reason}: {', '.join(names)}" for reason, names in sorted(slices.items())
    ]


def _cells(row: Row) -> list[str | Text]:
    change, style = row.change, STYLES[row.outcome]
    unit = 1.0 if row.metric in NOT_RATIOS else 100.0
    interval = "" if change.ci95 is None else "{:+.1f} {:+.1f}".format(*(unit * end for end in change.ci95))
    return [
        Text(row.outcome, style=style),
        row.slice_name,
        row.metric.replace("false_positive", "fp"),
        str(change.recordings),
        f"{unit * change.before:.1f}",
        f"{unit * change.after:.1f}",
        Text(f"{unit * change.difference:+.1f}", style=style),
        interval,
        f"{unit * row.allowed:.1f}",
    ]

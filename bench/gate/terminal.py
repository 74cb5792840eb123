"""The verdict in a terminal or a log: tables, and lines with their styles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from bench.evaluation import find_metric
from bench.gate.brief import NOTABLE, change_lines, check_lines, main_rows, overall_rows
from bench.gate.verdict import Outcome, Row, Verdict

STYLES = {
    Outcome.FAILED: "bold red",
    Outcome.SUSPECT: "yellow",
    Outcome.IMPROVED: "green",
    Outcome.PASSED: "",
    Outcome.NOT_JUDGED: "dim",
}
CAPTION = (
    "Recs: recordings with cases of both. Percent and percentage points; components per image. Suspect: worse than "
    "tolerated, but the interval includes no change."
)
Line = tuple[str, str]  # and its style


def head_lines(verdict: Verdict) -> list[Line]:
    """The subject, the checks that failed, and what changed."""
    failed = [(line, STYLES[Outcome.FAILED]) for line in check_lines(verdict)]
    return [(verdict.subject, ""), *failed, *((line, "") for line in change_lines(verdict))]


def overall_table(verdict: Verdict) -> Table:
    """The headline metrics over everything, whatever became of them."""
    return _table(overall_rows(verdict))


def main_table(verdict: Verdict) -> Table:
    """What else failed, is suspect or improved over everything and by kind of motion; worst first."""
    return _table(main_rows(verdict), caption=CAPTION)


def full_table(verdict: Verdict) -> Table:
    """Every row that failed, is suspect or improved, worst first, then those within tolerance."""
    outcomes = (*NOTABLE, Outcome.PASSED)
    return _table([row for outcome in outcomes for row in verdict.rows_with(outcome)], caption=CAPTION)


def full_lines(verdict: Verdict) -> list[Line]:
    """The checks that are only reported, then each reason not to judge."""
    suspect = [check for check in verdict.checks if check.outcome is Outcome.SUSPECT]
    lines = [(f"{check.outcome}: {check.message}", STYLES[check.outcome]) for check in suspect]
    rows = verdict.rows_with(Outcome.NOT_JUDGED)
    for reason, count in sorted(Counter(row.reason for row in rows).items()):
        slices = dict.fromkeys(row.slice_name for row in rows if row.reason == reason)
        line = f"not judged: {count} metrics, {reason}: {', '.join(slices)}"
        lines.append((line, STYLES[Outcome.NOT_JUDGED]))
    return lines


def _table(rows: Sequence[Row], *, caption: str | None = None) -> Table:
    table = Table(box=None, pad_edge=False, caption=caption, caption_justify="left")
    table.add_column("", no_wrap=True)
    for heading in ("Slice", "Metric"):
        table.add_column(heading, overflow="fold")
    for heading in ("Recs", "Old", "New", "Change", "95 %", "Tolerated"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row))
    return table


def _cells(row: Row) -> list[str | Text]:
    change, style = row.change, STYLES[row.outcome]
    unit = 100.0 if find_metric(row.metric).is_ratio else 1.0
    interval = "" if change.ci95 is None else "{:+.1f} {:+.1f}".format(*(unit * end for end in change.ci95))
    return [
        Text("within" if row.outcome is Outcome.PASSED else row.outcome, style=style),
        row.slice_name,
        row.metric,
        str(change.recordings),
        f"{unit * change.before:.1f}",
        f"{unit * change.after:.1f}",
        Text(f"{unit * change.difference:+.1f}", style=style),
        interval,
        f"{unit * row.allowed:.1f}",
    ]

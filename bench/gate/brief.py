"""The verdict within a minute: what changed, the overall rows, where most was lost; the rest is folded.

Breakdowns, as "range_m=[0, 2)", cut the same object-frames once more, so that one fault fails many of their rows. They
are judged like all others, and named here by their number and the worst of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from bench.evaluation import headlines
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.gate.verdict import Check, Outcome, Row, Verdict, row_text, value_text

NOTABLE = (Outcome.FAILED, Outcome.SUSPECT, Outcome.IMPROVED)


def is_overlapping(row: Row) -> bool:
    """Tell whether a row is of a breakdown, whose object-frames are in other rows too."""
    return "=" in row.slice_name


def overall_rows(verdict: Verdict) -> list[Row]:
    """The headline metrics over everything."""
    rows = {row.metric: row for row in verdict.rows if row.slice_name in {ALL_MOVING, FRAMES}}
    return [rows[metric.name] for metric in headlines() if metric.name in rows]


def main_rows(verdict: Verdict) -> list[Row]:
    """Other rows over everything and by kind of motion that failed, are suspect or improved, worst first."""
    shown = {(row.slice_name, row.metric) for row in overall_rows(verdict)}
    rows = [row for outcome in NOTABLE for row in verdict.rows_with(outcome) if not is_overlapping(row)]
    return [row for row in rows if (row.slice_name, row.metric) not in shown]


def folded_lines(verdict: Verdict) -> list[str]:
    """Lines of what the breakdowns say, and of how many metrics were not judged."""
    lines = []
    for outcome in NOTABLE:
        rows = [row for row in verdict.rows_with(outcome) if is_overlapping(row)]
        if rows:
            kinds = Counter(row.slice_name.partition("=")[0] for row in rows)
            counted = ", ".join(f"{name} {count}" for name, count in kinds.items())
            first = f"; the worst: {row_text(rows[0])}" if outcome is Outcome.FAILED else ""
            lines.append(f"{outcome} in breakdowns: {len(rows)} ({counted}){first}")
    if skipped := not_judged_line(verdict):
        lines.append(skipped)
    return lines


def not_judged_line(verdict: Verdict) -> str:
    """Number of metrics that were not judged; "" where all were. The JSON has the reason for each."""
    count = len(verdict.rows_with(Outcome.NOT_JUDGED))
    return f"not judged: {count} metrics, for too few cases or recordings, or by the tolerances" if count else ""


def check_lines(verdict: Verdict) -> list[str]:
    """The checks that failed, a line each: the cause, then what probably follows from it."""
    told = [check.message for check in verdict.failed_checks]
    return [f"failed: {told[0]}", *(f"probably as a consequence: {message}" for message in told[1:])] if told else []


def change_lines(verdict: Verdict) -> list[str]:
    """ "changed: settings: flow = dis, was farneback" for everything that changed and that no failed check tells
    already, then what did not; none where the two were not compared."""
    if verdict.refusal:
        return []
    told = {check.name.removesuffix("_digest") for check in verdict.failed_checks}
    lines = [f"changed: {change.what}: {change.text}" for change in verdict.changes if change.what not in told]
    lines += [f"note: {check.message}" for check in verdict.checks if _is_note(check)]
    return [*lines, f"as in the baseline: {', '.join(verdict.unchanged) or 'nothing'}"]


def _is_note(check: Check) -> bool:
    """The reference is another one, or one that nobody reviewed, and yet no reason to fail."""
    return check.name in {"reference_digest", "annotations"} and check.outcome is Outcome.SUSPECT


def worst_line(verdict: Verdict) -> str:
    """Recordings that most of the worst loss comes from; "" where nothing is worse than tolerated."""
    worse = (Outcome.FAILED, Outcome.SUSPECT)
    groups: Sequence[Sequence[Row]] = (overall_rows(verdict), main_rows(verdict), verdict.rows)
    for rows in groups:
        for outcome in worse:
            found = [row for row in rows if row.outcome is outcome and row.worst_recordings]
            if found:
                row = max(found, key=lambda one: one.severity)
                parts = [
                    f"{one.name} {value_text(row.metric, one.before)} -> {value_text(row.metric, one.after)}"
                    for one in row.worst_recordings
                ]
                return f"most of {row.metric} of {row.slice_name} is lost in: {'; '.join(parts)}"
    return ""

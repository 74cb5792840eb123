"""Markdown for the summary page of a CI step; GitHub refuses more than 1 MiB of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bench.gate.verdict import Outcome, Row, Verdict
from bench.gate.wording import allowed_text, change_text, interval_text, value_text
from bench.plain_text import escape_markdown

LARGEST_BYTES = 1024 * 1024 - 1  # of the file, whoever wrote into it
_SPARE_BYTES = 200  # for the line that says how many rows were left out
_HEADING = (
    "| | Slice | Metric | Recordings | Baseline | Run | Change | 95 % | Tolerated | Note |",
    "|---|---|---|---:|---:|---:|---:|---:|---:|---|",
)
_MARKS = {
    Outcome.FAILED: "❌ failed",
    Outcome.SUSPECT: "⚠️ suspect",
    Outcome.IMPROVED: "✅ improved",
    Outcome.PASSED: "within tolerance",
    Outcome.NOT_JUDGED: "not judged",
}


def to_markdown(verdict: Verdict, *, largest_bytes: int = LARGEST_BYTES) -> str:
    """The verdict as Markdown, failures first, cut after a whole row where it would be too large.

    Args:
        verdict: to be told.
        largest_bytes: of the text in UTF-8; what the file already holds is the caller's to subtract.

    Returns:
        The text; "" where not even the headline fits.
    """
    lines = list(_lines(verdict))
    sizes = [len(line.encode()) + 1 for line in lines]
    if sum(sizes) <= largest_bytes:
        return "\n".join(lines) + "\n"
    kept = _fitting(sizes, largest_bytes - _SPARE_BYTES)
    if kept == 0:
        return ""
    cut = sum(line.startswith("| ") and line != _HEADING[0] for line in lines[kept:])
    return "\n".join([*lines[:kept], "", f"{cut} more rows are left out, all are in the JSON and JUnit files."]) + "\n"


def _fitting(sizes: Sequence[int], budget: int) -> int:
    """How many lines fit."""
    used = 0
    for number, size in enumerate(sizes):
        used += size
        if used > budget:
            return number
    return len(sizes)


def _lines(verdict: Verdict) -> Iterable[str]:
    yield f"## {escape_markdown(verdict.headline)}"
    yield ""
    yield escape_markdown(f"{verdict.method} on {verdict.dataset}, tolerances {verdict.tolerances}")
    yield ""
    told = [check for check in verdict.checks if check.outcome is not Outcome.PASSED]
    for check in told:
        yield f"- {_MARKS[check.outcome]}: {escape_markdown(check.message)}"
    if told:
        yield ""
    yield from _HEADING
    for outcome in (Outcome.FAILED, Outcome.SUSPECT, Outcome.IMPROVED, Outcome.PASSED, Outcome.NOT_JUDGED):
        for row in verdict.rows_with(outcome):
            yield _row(row)


def _row(row: Row) -> str:
    metric, change = row.metric, row.change
    note = row.reason
    if row.worst_recording is not None and row.outcome in {Outcome.FAILED, Outcome.SUSPECT}:
        note = f"most in {row.worst_recording}" + (f"; {note}" if note else "")
    cells = [
        _MARKS[row.outcome],
        row.slice_name,
        metric,
        str(change.recordings),
        value_text(metric, change.before),
        value_text(metric, change.after),
        change_text(metric, change.difference),
        interval_text(metric, change.ci95),
        allowed_text(metric, row.allowed),
        note,
    ]
    return f"| {' | '.join(escape_markdown(cell) for cell in cells)} |"

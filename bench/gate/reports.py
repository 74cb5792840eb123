"""The verdict for people and programs: terminal, Markdown, JUnit XML, GitHub annotations, JSON.

Source of the annotations:
    GitHub documentation, "Workflow commands for GitHub Actions"; the escapes are those of `actions/toolkit`
    (`packages/core/src/command.ts`). A step shows at most ten annotations of a kind.
"""

from __future__ import annotations

import io
import json
import math
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict
from itertools import accumulate

from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from bench.evaluation.paired import NOT_RATIOS
from bench.evaluation.slices import ALL_MOVING, FRAMES
from bench.gate.verdict import (
    Outcome,
    Row,
    Verdict,
    allowed_text,
    change_text,
    interval_text,
    row_text,
    value_text,
    worst_text,
)
from bench.plain_text import escape_markdown, plain

MOST = 10


def to_annotations(verdict: Verdict) -> list[str]:
    """Lines for the standard output: at most ten errors, checks first, then the worst metric first, and how many more.

    The last line is no command, since an eleventh would not be shown.
    """
    failed = [("gate: data", check.message) for check in verdict.failed_checks]
    failed += [(f"gate: {row.slice_name} {row.metric}", row_text(row)) for row in verdict.rows_with(Outcome.FAILED)]
    lines = [_error(title, message) for title, message in failed[:MOST]]
    return [*lines, f"and {len(failed) - MOST} more"] if len(failed) > MOST else lines


def _error(title: str, message: str) -> str:
    return f"::error title={_escape_property(title)}::{_escape(message)}"


def _escape(text: str) -> str:
    return plain(text).replace("%", "%25")  # what is plain has no line ends, which would be escaped too


def _escape_property(text: str) -> str:
    return _escape(text).replace(":", "%3A").replace(",", "%2C")


# What XML 1.0 cannot hold, even escaped; file names and messages may.
_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def to_junit(verdict: Verdict) -> bytes:
    """JUnit XML, UTF-8: failed is a failure, not judged is skipped with the reason, the rest passes with its line."""
    suite = TestSuite(_clean(f"fisheye-bench gate {verdict.dataset} {verdict.method}"))
    for check in verdict.checks:
        suite.add_testcase(_case(check.name, "data", check.outcome, message=check.message, reason=""))
    for row in verdict.rows:
        suite.add_testcase(_case(row.metric, row.slice_name, row.outcome, message=row_text(row), reason=row.reason))
    document = JUnitXml()
    document.add_testsuite(suite)
    document.update_statistics()  # type: ignore[no-untyped-call]
    text = io.BytesIO()
    document.write(text)
    return text.getvalue()


def _case(name: str, group: str, outcome: Outcome, *, message: str, reason: str) -> TestCase:
    case = TestCase(_clean(name), classname=_clean(f"gate.{group}"), time=0.0)
    if outcome is Outcome.FAILED:
        failure = Failure(_clean(message), "data" if group == "data" else "regression")
        failure.text = _clean(message)
        case.result = [failure]
        return case
    if outcome is Outcome.NOT_JUDGED:
        case.result = [Skipped(_clean(reason), "not judged")]
    case.system_out = _clean(f"{outcome}: {message}")
    return case


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)


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
        verdict: of a run.
        largest_bytes: of the text in UTF-8; what the file already holds is the caller's to subtract.

    Returns:
        The text; "" where not even the headline fits.
    """
    lines = list(_lines(verdict))
    ends = list(accumulate(len(line.encode()) + 1 for line in lines))
    if ends[-1] <= largest_bytes:
        return "\n".join(lines) + "\n"
    fitting = bisect_right(ends, largest_bytes - _SPARE_BYTES)
    if fitting == 0:
        return ""
    cut = sum(line.startswith("| ") and line != _HEADING[0] for line in lines[fitting:])
    left_out = f"{cut} more rows are left out, all are in the JSON and JUnit files."
    return "\n".join([*lines[:fitting], "", left_out]) + "\n"


def _lines(verdict: Verdict) -> Iterable[str]:
    yield f"## {escape_markdown(verdict.headline)}"
    yield ""
    yield escape_markdown(f"{verdict.method} on {verdict.dataset}, tolerances {verdict.tolerances}")
    yield ""
    notable = [check for check in verdict.checks if check.outcome is not Outcome.PASSED]
    for check in notable:
        yield f"- {_MARKS[check.outcome]}: {escape_markdown(check.message)}"
    if notable:
        yield ""
    yield from _HEADING
    for outcome in (Outcome.FAILED, Outcome.SUSPECT, Outcome.IMPROVED, Outcome.PASSED, Outcome.NOT_JUDGED):
        for row in verdict.rows_with(outcome):
            yield _row(row)


def _row(row: Row) -> str:
    metric, change = row.metric, row.change
    note = "; ".join(part for part in (worst_text(row), row.reason) if part)
    values = (value_text(metric, value) for value in (change.before, change.after))
    cells = [_MARKS[row.outcome], row.slice_name, metric, str(change.recordings), *values]
    cells += [change_text(metric, change.difference), interval_text(metric, change.ci95)]
    cells += [allowed_text(metric, row.allowed), note]
    return f"| {' | '.join(map(escape_markdown, cells))} |"


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
    shown = [
        row for outcome in (Outcome.FAILED, Outcome.SUSPECT, Outcome.IMPROVED) for row in verdict.rows_with(outcome)
    ]
    overall = [row for row in verdict.rows if row.slice_name in {ALL_MOVING, FRAMES}]
    for row in [*shown, *(row for row in overall if row.outcome is Outcome.PASSED)]:
        table.add_row(*_cells(row))
    return table


def remark_lines(verdict: Verdict) -> list[tuple[str, str]]:
    """A line and its style for each check that did not pass, then for each reason not to judge."""
    notable = [check for check in verdict.checks if check.outcome is not Outcome.PASSED]
    lines = [(f"{check.outcome}: {check.message}", STYLES[check.outcome]) for check in notable]
    rows = verdict.rows_with(Outcome.NOT_JUDGED)
    for reason, count in sorted(Counter(row.reason for row in rows).items()):
        slices = dict.fromkeys(row.slice_name for row in rows if row.reason == reason)
        line = f"not judged: {count} metrics, {reason}: {', '.join(slices)}"
        lines.append((line, STYLES[Outcome.NOT_JUDGED]))
    return lines


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


SCHEMA_VERSION = 1


def to_json(verdict: Verdict) -> str:
    """All checks and all rows; NaN and infinity become null."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "passed": verdict.passed,
        "headline": verdict.headline,
        "dataset": verdict.dataset,
        "method": verdict.method,
        "tolerances": verdict.tolerances,
        "baseline": verdict.baseline_origin.model_dump(mode="json"),
        "run": verdict.run_origin.model_dump(mode="json"),
        "checks": [asdict(check) for check in verdict.checks],
        "rows": [_json_row(row) for row in verdict.rows],
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _json_row(row: Row) -> dict[str, object]:
    change = row.change
    return {
        "slice": row.slice_name,
        "metric": row.metric,
        "outcome": row.outcome.value,
        "reason": row.reason,
        "before": _number(change.before),
        "after": _number(change.after),
        "difference": _number(change.difference),
        "difference_ci95": None if change.ci95 is None else list(change.ci95),
        "p_value": change.p_value,
        "worsening": _number(row.worsening),
        "allowed": _number(row.allowed),
        "cases_before": change.cases_before,
        "cases_after": change.cases_after,
        "recordings": change.recordings,
        "worst_recording": row.worst_recording,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None

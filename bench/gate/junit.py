"""JUnit XML, which every CI server shows: one test case per check and per metric of each slice."""

from __future__ import annotations

import io
import re

from junitparser import Failure, JUnitXml, Skipped, TestCase, TestSuite

from bench.gate.verdict import Check, Outcome, Row, Verdict
from bench.gate.wording import row_text

# What XML 1.0 cannot hold, even escaped; file names and messages may.
_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def to_junit(verdict: Verdict) -> bytes:
    """JUnit XML, UTF-8: failed is a failure, not judged is skipped with the reason, the rest passes with its line."""
    suite = TestSuite(_clean(f"fisheye-bench gate {verdict.dataset} {verdict.method}"))
    for check in verdict.checks:
        suite.add_testcase(_check_case(check))
    for row in verdict.rows:
        suite.add_testcase(_row_case(row))
    document = JUnitXml()
    document.add_testsuite(suite)
    document.update_statistics()  # type: ignore[no-untyped-call]
    text = io.BytesIO()
    document.write(text)
    return text.getvalue()


def _check_case(check: Check) -> TestCase:
    return _case(check.name, "data", outcome=check.outcome, kind="data", message=check.message, skip_reason="")


def _row_case(row: Row) -> TestCase:
    return _case(
        row.metric,
        row.slice_name,
        outcome=row.outcome,
        kind="regression",
        message=row_text(row),
        skip_reason=row.reason,
    )


def _case(name: str, group: str, *, outcome: Outcome, kind: str, message: str, skip_reason: str) -> TestCase:
    case = TestCase(_clean(name), classname=_clean(f"gate.{group}"), time=0.0)
    if outcome is Outcome.FAILED:
        failure = Failure(_clean(message), kind)
        failure.text = _clean(message)
        case.result = [failure]
    elif outcome is Outcome.NOT_JUDGED:
        case.result = [Skipped(_clean(skip_reason), "not judged")]
    if outcome is not Outcome.FAILED:
        case.system_out = _clean(f"{outcome}: {message}")
    return case


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)

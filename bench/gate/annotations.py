"""GitHub's workflow commands: errors that show beside a pull request.

Source:
    GitHub documentation, "Workflow commands for GitHub Actions"; the escapes are those of `actions/toolkit`
    (`packages/core/src/command.ts`). A step shows at most ten annotations of a kind.
"""

from __future__ import annotations

from bench.gate.verdict import Outcome, Verdict
from bench.gate.wording import row_text
from bench.plain_text import plain

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

"""A verdict of the gate for people and CI servers: terminal, GitHub annotations and step summary, JUnit XML, JSON.

Source of the annotations:
    GitHub documentation, "Workflow commands for GitHub Actions"; the escapes are those of `actions/toolkit`
    (`packages/core/src/command.ts`). A step shows at most ten annotations of a kind.
"""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite
from junitparser.junitparser import FinalResult

from bench.atomic import write_output
from bench.errors import UsageError
from bench.gate.verdict import (
    Outcome,
    Row,
    Verdict,
    allowed_text,
    change_lines,
    change_text,
    check_lines,
    interval_text,
    is_overlapping,
    main_rows,
    not_judged_line,
    overall_rows,
    row_text,
    value_text,
    worst_line,
    worst_text,
)
from bench.plain_text import counted, plain
from bench.reporting import document
from bench.reporting.document import Block, Cell, Code, Group, Heading, Items, Paragraph, Style, Table

MOST = 10


def to_annotations(verdict: Verdict) -> list[str]:
    """Lines for the standard output: at most ten errors, and how many more.

    Why there is no verdict, or the check that failed and what probably follows from it; then one line for each slice
    with what failed in it, the slice of the worst metric first; then one for all breakdowns, which cut the same
    object-frames once more. The last line is no command, since an eleventh would not be shown.
    """
    failed = verdict.rows_with(Outcome.FAILED)
    told = [("gate: no verdict", verdict.why_none)] if verdict.why_none else []
    cause, *consequences = check_lines(verdict) or [""]
    told += [("gate: data", cause.removeprefix("failed: "))] if cause else []
    told += [("gate: data", "; ".join(consequences))] if consequences else []
    slices = _by_slice(row for row in failed if not is_overlapping(row))
    told += [(f"gate: {name}", _slice_text(rows)) for name, rows in slices.items()]
    if breakdowns := [row for row in failed if is_overlapping(row)]:
        slices_failed = counted(len({row.slice_name for row in breakdowns}), "slice")
        text = f"{counted(len(breakdowns), 'metric')} failed in {slices_failed}, the worst: {row_text(breakdowns[0])}"
        told.append(("gate: breakdowns", text))
    lines = [_error(title, message) for title, message in told[:MOST]]
    return [*lines, f"and {len(told) - MOST} more"] if len(told) > MOST else lines


def _by_slice(rows: Iterable[Row]) -> dict[str, list[Row]]:
    slices: dict[str, list[Row]] = {}
    for row in rows:
        slices.setdefault(row.slice_name, []).append(row)
    return slices


def _slice_text(rows: Sequence[Row]) -> str:
    """The worst metric of a slice in full, the others by their change."""
    worst, *others = rows
    text = row_text(worst)
    named = [f"{row.metric} {change_text(row.metric, row.difference)}" for row in others]
    return f"{text}; also failed: {', '.join(named)}" if named else text


def _error(title: str, message: str) -> str:
    return f"::error title={_escape_property(title)}::{_escape(message)}"


def _escape(text: str) -> str:
    return plain(text).replace("%", "%25")  # what is plain has no line ends, which would be escaped too


def _escape_property(text: str) -> str:
    return _escape(text).replace(":", "%3A").replace(",", "%2C")


# What XML 1.0 cannot hold, even escaped; file names and messages may.
_FORBIDDEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def to_junit(verdict: Verdict) -> bytes:
    """JUnit XML, UTF-8: a case for each check of the data and each slice, with the lines of its metrics.

    A slice fails with what failed in it and what changed since the baseline. All that is not judged is one skipped
    case. Where there is no verdict, that is an error, so that no reader takes it for a pass.
    """
    suite = TestSuite(_clean(f"fisheye-bench gate {verdict.run.title if verdict.run else ''}".rstrip()))
    cases = [_case("verdict", "data", Error(_clean(verdict.why_none), "no verdict"))] if verdict.why_none else []
    for check in verdict.checks:
        failed = _failure(check.message, check.message, "data") if check.outcome is Outcome.FAILED else None
        cases.append(_case(check.name, "data", failed, [f"{check.outcome}: {check.message}"]))
    judged = _by_slice(row for row in verdict.told_rows if row.outcome is not Outcome.NOT_JUDGED)
    for name, rows in judged.items():
        worse = [row for row in verdict.rows_with(Outcome.FAILED) if row in rows]  # the worst first
        cause = "\n".join([*map(row_text, worse), *change_lines(verdict)])
        failed = _failure(_slice_text(worse), cause, "regression") if worse else None
        cases.append(_case(name, "metrics", failed, [f"{row.outcome}: {row_text(row)}" for row in rows]))
    if skipped := not_judged_line(verdict):
        cases.append(_case("not judged", "metrics", Skipped(_clean(skipped), "not judged")))
    suite.add_testcases(cases)
    document = JUnitXml()
    document.add_testsuite(suite)
    document.update_statistics()  # type: ignore[no-untyped-call]
    text = io.BytesIO()
    document.write(text, pretty=True)
    return text.getvalue()


def _case(name: str, group: str, result: FinalResult | None, lines: Sequence[str] = ()) -> TestCase:
    """A case with its result, if it has one, and its lines."""
    case = TestCase(_clean(name), classname=f"gate.{group}", time=0.0)
    case.result = [] if result is None else [result]
    if lines:
        case.system_out = _clean("\n".join(lines))
    return case


def _failure(message: str, text: str, kind: str) -> Failure:
    failure = Failure(_clean(message), kind)
    failure.text = _clean(text)
    return failure


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)


MOST_ROWS = 1000  # of the summary, of which GitHub takes 1 MiB; names of slices are short
_MARKS = {
    Outcome.FAILED: "❌ failed",
    Outcome.SUSPECT: "⚠️ suspect",
    Outcome.IMPROVED: "✅ improved",
    Outcome.PASSED: "within tolerance",
}
CAPTION = (
    "Recs: recordings with cases of both. Percent and percentage points; components per image. Suspect: worse than "
    "tolerated, but it may be chance, or the metric decides nothing."
)
_HEADINGS = ("Outcome", "Slice", "Metric", "Recs", "Baseline", "Run", "Change", "95 %", "Tolerated")


def to_markdown(verdict: Verdict) -> str:
    """The verdict as Markdown, failures first."""
    return document.to_markdown(_summary(verdict))


def _summary(verdict: Verdict) -> Iterator[Block]:
    yield Heading(verdict.headline)
    yield Paragraph(verdict.subject)
    none = [f"❌ no verdict: {verdict.why_none}"] if verdict.why_none else []
    failed = [f"❌ {line}" for line in check_lines(verdict)]
    worst = [line for line in (worst_line(verdict),) if line]
    yield Items([*none, *failed, *change_lines(verdict), *worst])
    shown = [*overall_rows(verdict), *main_rows(verdict)]
    if shown:
        yield row_table(shown, with_notes=True, caption=CAPTION)
    if skipped := not_judged_line(verdict):
        yield Paragraph(skipped)
    if verdict.judged and not verdict.passed:
        folders = _as_typed(verdict.run_folder, "RUN"), _as_typed(verdict.baseline_folder, "BASELINE")
        update = ["gate", folders[0], "--baseline", folders[1], "--update"]
        yield Paragraph("If the change is wanted, make this run the baseline, and commit it:")
        yield Code(shlex.join(["fisheye-bench", *update]))
    others = [row for outcome in _MARKS for row in verdict.rows_with(outcome) if row not in shown]
    if others:
        title = f"{counted(len(others), 'other row')}, those of breakdowns among them"
        cut = len(others) - MOST_ROWS
        note = f"Left out: {counted(cut, 'more row')}, all are in the JSON and JUnit files." if cut > 0 else ""
        yield Group(look="folded", title=title, blocks=[row_table(others[:MOST_ROWS], with_notes=True, caption=note)])


def _as_typed(folder: Path, otherwise: str) -> str:
    """A folder for a command that people copy from a web page; a word where its name could be something else there."""
    return str(folder) if re.fullmatch(r"[\w./ -]+", str(folder)) else otherwise


def row_table(rows: Iterable[Row], *, with_notes: bool = False, caption: str = "") -> Table:
    """Rows of a verdict in their order.

    Args:
        rows: of the verdict.
        with_notes: marks, and a column that says where most was lost and why a row was not judged.
        caption: below the table.
    """
    lines = []
    for row in rows:
        metric = row.metric
        plain_word = "within" if row.outcome is Outcome.PASSED else row.outcome.value
        outcome = _MARKS.get(row.outcome, plain_word) if with_notes else plain_word
        values = (value_text(metric, value) for value in (row.before, row.after))
        style = STYLES[row.outcome]
        line = [Cell(outcome, style=style), row.slice_name, metric, row.recordings, *values]
        line += [Cell(change_text(metric, row.difference), style=style), interval_text(metric, row.ci95)]
        note = ["; ".join(part for part in (worst_text(row), row.reason) if part)] if with_notes else []
        lines.append([*line, allowed_text(metric, row.allowed), *note])
    return Table(columns=[*_HEADINGS, *(["Note"] if with_notes else [])], rows=lines, words=3, note=caption)


STYLES: dict[Outcome, Style] = {
    Outcome.FAILED: "bad",
    Outcome.SUSPECT: "warn",
    Outcome.IMPROVED: "good",
    Outcome.PASSED: "",
    Outcome.NOT_JUDGED: "dim",
}


def head_lines(verdict: Verdict) -> list[Paragraph]:
    """The subject, the checks that failed, and what changed."""
    failed = [Paragraph(line, "bad") for line in check_lines(verdict)]
    return [Paragraph(verdict.subject), *failed, *map(Paragraph, change_lines(verdict))]


SCHEMA_VERSION = 1


def to_json(verdict: Verdict) -> str:
    """All checks and all rows; NaN and infinity become null."""
    run = verdict.run
    content = {
        "schema_version": SCHEMA_VERSION,
        "passed": verdict.passed,
        "headline": verdict.headline,
        "no_verdict": verdict.why_none,
        "dataset": run.dataset.name if run else "",
        "method": run.method.name if run else "",
        "protocol": run.protocol.name if run else "",
        "tolerances": verdict.tolerances,
        "changes": [{"what": what, "text": text} for what, text in verdict.changes.items()],
        "baseline": verdict.baseline and verdict.baseline.code.model_dump(mode="json"),
        "run": run and run.code.model_dump(mode="json"),
        "checks": [asdict(check) for check in verdict.checks],
        "rows": [_json_row(row) for row in verdict.rows],
    }
    return document.to_json(content)


def _json_row(row: Row) -> dict[str, object]:
    own = asdict(row)
    return {"slice": own.pop("slice_name"), "difference_ci95": own.pop("ci95"), **own}


def write_verdict(verdict: Verdict, *, junit: str | Path | None = None, json: str | Path | None = None) -> None:
    """Write JUnit XML, JSON or both.

    Raises:
        OutputError: a file cannot be written.
    """
    if junit is not None:
        write_output(Path(junit), to_junit(verdict).decode())
    if json is not None:
        write_output(Path(json), to_json(verdict))


def append_summary(file: Path, verdict: Verdict) -> None:
    """Append to the summary of a step of GitHub; other commands of the step may have written to it before.

    Raises:
        UsageError: nothing can be appended to the file.
    """
    try:
        with file.open("a", encoding="utf-8") as summary:
            summary.write(to_markdown(verdict))
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(f"GITHUB_STEP_SUMMARY: expected a file to append to, got {str(file)!r}: {reason}") from error

"""A verdict of the gate for people and CI servers: terminal, GitHub annotations and step summary, JUnit XML, JSON.

Source of the annotations:
    GitHub documentation, "Workflow commands for GitHub Actions"; the escapes are those of `actions/toolkit`
    (`packages/core/src/command.ts`). A step shows at most ten annotations of a kind.
"""

from __future__ import annotations

import io
import math
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite
from junitparser.junitparser import FinalResult

from bench.atomic import write_output
from bench.errors import UsageError
from bench.evaluation.definitions import find_metric, headlines
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.gate.verdict import Outcome, Row, Verdict
from bench.plain_text import counted, plain
from bench.recordings.cards import shipped_folder
from bench.reporting import document
from bench.reporting.document import Block, Cell, Code, Group, Heading, Paragraph, Style, Table

WORSE = (Outcome.FAILED, Outcome.SUSPECT)  # than tolerated
NOTABLE = (*WORSE, Outcome.IMPROVED)

# Rows of the head, and the text of numbers, rows and checks.


def value_text(metric: str, value: float) -> str:
    """A value: "72.1 %", "3.2" for a mean that is no ratio, "n/a" for NaN."""
    return _text(metric, value, unit=" %") or "n/a"


def change_text(metric: str, difference: float) -> str:
    """A difference: "-3.2 pt" in percentage points, "+0.40" for a mean that is no ratio, "n/a" for NaN."""
    return _text(metric, difference, unit=" pt", sign="+") or "n/a"


def interval_text(metric: str, interval: tuple[float, float] | None) -> str:
    """The interval of a difference: "[-5.1, -1.2]"; "" where there is none."""
    return "" if interval is None else f"[{', '.join(_text(metric, end, sign='+') for end in interval)}]"


def _text(metric: str, value: float, *, unit: str = "", sign: str = "") -> str:
    if math.isnan(value):
        return ""
    return f"{100 * value:{sign}.1f}{unit}" if find_metric(metric).is_ratio else f"{value:{sign}.2f}"


def row_text(row: Row) -> str:
    """A row in one line: "tpr_all of overtaking: 98.6 % -> 79.2 %, -19.4 pt [-24.1, -13.3], tolerated 2.0 pt"."""
    metric = row.metric
    text = (
        f"{metric} of {row.slice_name}: {value_text(metric, row.before)} -> {value_text(metric, row.after)}, "
        f"{change_text(metric, row.difference)} {interval_text(metric, row.ci95)}"
    ).rstrip()
    if not math.isnan(row.allowed):
        text += f", tolerated {_text(metric, row.allowed, unit=' pt')}"
    return "; ".join(part for part in (text, worst_text(row), row.reason) if part)


def worst_text(row: Row) -> str:
    """Recording that most of a loss comes from: "most in drive-3"; "" for a row that is not worse than tolerated."""
    worse = row.outcome in WORSE and row.worst_recordings
    return f"most in {row.worst_recordings[0].recording}" if worse else ""


def overall_rows(verdict: Verdict) -> list[Row]:
    """The headline metrics over everything."""
    rows = {row.metric: row for row in verdict.rows if row.slice_name in {ALL_MOVING, FRAMES}}
    return [rows[metric.name] for metric in headlines() if metric.name in rows]


def fallen_line(verdict: Verdict) -> str:
    """The headlines over everything that are worse although the gate passed; "" where none is."""
    words, fallen = {Outcome.PASSED: "within tolerance", Outcome.SUSPECT: "suspect"}, []
    for row in overall_rows(verdict) if verdict.passed else ():
        was, now = (value_text(row.metric, value) for value in (row.before, row.after))
        if row.worsening > 0 and was != now:
            fallen.append(f"{find_metric(row.metric).label} {was} -> {now} ({words.get(row.outcome, row.outcome)})")
    return f"worse than the baseline: {'; '.join(fallen)}" if fallen else ""


def main_rows(verdict: Verdict) -> list[Row]:
    """Other rows over everything and by kind of motion that failed, are suspect or improved, worst first."""
    overall = overall_rows(verdict)
    rows = [row for outcome in NOTABLE for row in verdict.rows_with(outcome)]
    return [row for row in rows if row not in overall and not row.of_breakdown]


def folded_lines(verdict: Verdict) -> list[str]:
    """Lines of what the breakdowns say, and of how many metrics were not judged."""
    lines = []
    for outcome in NOTABLE:
        rows = [row for row in verdict.rows_with(outcome) if row.of_breakdown]
        if rows:
            kinds = Counter(row.slice_name.partition("=")[0] for row in rows)
            by_kind = ", ".join(f"{name} {count}" for name, count in kinds.items())
            first = f"; the worst: {row_text(rows[0])}" if outcome is Outcome.FAILED else ""
            lines.append(f"{outcome} in breakdowns: {len(rows)} ({by_kind}){first}")
    if skipped := not_judged_line(verdict):
        lines.append(skipped)
    return lines


def not_judged_line(verdict: Verdict) -> str:
    """Number of metrics that were not judged; "" where all were. The JSON has the reason for each."""
    count = len(verdict.rows_with(Outcome.NOT_JUDGED))
    why = "for too few cases or recordings, or by the tolerances"
    return f"not judged: {counted(count, 'metric')}, {why}" if count else ""


def check_lines(verdict: Verdict) -> list[str]:
    """The checks that failed, a line each: the cause, then what probably follows from it."""
    leads = ("failed", *("probably as a consequence" for _ in verdict.failed_checks))
    return [f"{lead}: {check.message}" for lead, check in zip(leads, verdict.failed_checks, strict=False)]


def change_lines(verdict: Verdict) -> list[str]:
    """ "changed: settings: flow = dis, was farneback" for everything that changed and that no failed check tells
    already, then what did not; none where the two were not compared."""
    if verdict.refusal:
        return []
    told = {check.name for check in verdict.failed_checks}
    suspect = [check for check in verdict.checks if check.outcome is Outcome.SUSPECT and check.name != "data"]
    return [
        *(f"changed: {what}: {text}" for what, text in verdict.changes.items() if what not in told),
        *(f"note: {check.message}" for check in suspect),
        f"as in the baseline: {', '.join(verdict.unchanged) or 'nothing'}",
    ]


def worst_row(verdict: Verdict) -> Row | None:
    """The row of the worst loss, an overall one before others; None without a loss."""
    overall, main = overall_rows(verdict), main_rows(verdict)
    worse = [row for row in verdict.rows if row.outcome in WORSE and row.worst_recordings]
    first = [(row not in overall, row not in main, row.outcome is not Outcome.FAILED, -row.severity) for row in worse]
    return worse[first.index(min(first))] if worse else None


def worst_line(verdict: Verdict) -> str:
    """Recordings that most of the worst loss comes from; "" without a loss."""
    if (worst := worst_row(verdict)) is None:
        return ""
    lost = (
        f"{own.recording} {value_text(worst.metric, own.before)} -> {value_text(worst.metric, own.after)}"
        for own in worst.worst_recordings
    )
    return f"most of {worst.metric} of {worst.slice_name} is lost in: {'; '.join(lost)}"


# GitHub's annotations.

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
    slices = _by_slice(row for row in failed if not row.of_breakdown)
    told += [(f"gate: {name}", _slice_text(rows)) for name, rows in slices.items()]
    if breakdowns := [row for row in failed if row.of_breakdown]:
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
    suites = JUnitXml()
    suites.add_testsuite(suite)
    suites.update_statistics()  # type: ignore[no-untyped-call]
    text = io.BytesIO()
    suites.write(text, pretty=True)
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
_LOOKS: dict[Outcome, tuple[str, Style]] = {  # mark and colour
    Outcome.FAILED: ("❌ ", "bad"),
    Outcome.SUSPECT: ("⚠️ ", "warn"),
    Outcome.IMPROVED: ("✅ ", "good"),
    Outcome.PASSED: ("", ""),
    Outcome.NOT_JUDGED: ("", "dim"),
}
CAPTION = (
    "Recs: recordings with cases of both. Percent and percentage points; components per image. Suspect: worse than "
    "tolerated, but it may be chance, or the metric decides nothing."
)
_HEADINGS = ("Outcome", "Slice", "Metric", "Recs", "Baseline", "Run", "Change", "95 %", "Tolerated")


def first_blocks(verdict: Verdict, *, with_notes: bool = False) -> Iterator[Block]:
    """The head of a verdict: failed checks of the data, changes, overall rows, the recordings with the largest loss.

    Args:
        verdict: of a run.
        with_notes: as of `row_table`.
    """
    if fallen := fallen_line(verdict):
        yield Paragraph(fallen)
    yield Paragraph(verdict.subject)
    yield from (Paragraph(line, "bad") for line in check_lines(verdict))
    yield from map(Paragraph, change_lines(verdict))
    if rows := overall_rows(verdict):
        yield row_table(rows, with_notes=with_notes)
    if worst := worst_line(verdict):
        yield Paragraph(worst)


def other_blocks(verdict: Verdict, *, with_notes: bool = False) -> Iterator[Block]:
    """Failed, suspect and improved rows by kind of motion, and a summary of the breakdowns.

    Args:
        verdict: of a run.
        with_notes: as of `row_table`.
    """
    if rows := main_rows(verdict):
        yield row_table(rows, with_notes=with_notes)
    if verdict.rows:
        yield Paragraph(CAPTION, "dim")
    yield from (Paragraph(line, "dim") for line in folded_lines(verdict))


def to_markdown(verdict: Verdict) -> str:
    """The verdict as Markdown, failures first, and how to accept them; all rows at the end, folded."""
    blocks: list[Block] = [Heading(verdict.headline)]
    blocks += [Paragraph(f"no verdict: {verdict.why_none}", "bad")] if verdict.why_none else []
    blocks += [*first_blocks(verdict, with_notes=True), *other_blocks(verdict, with_notes=True)]
    blocks += accept_blocks(verdict)
    shown = [*overall_rows(verdict), *main_rows(verdict)]
    others = [row for outcome in (*NOTABLE, Outcome.PASSED) for row in verdict.rows_with(outcome) if row not in shown]
    if others:
        cut = len(others) - MOST_ROWS
        note = f"Left out: {counted(cut, 'more row')}, all are in the JSON and JUnit files." if cut > 0 else ""
        table = row_table(others[:MOST_ROWS], with_notes=True, caption=note)
        title = f"{counted(len(others), 'other row')}, those of breakdowns among them"
        blocks.append(Group(look="folded", title=title, blocks=[table]))
    return document.to_markdown(blocks)


def accept_blocks(verdict: Verdict) -> list[Block]:
    """How to accept what failed, as a baseline of one's own where the shipped one judged."""
    if verdict.passed or verdict.stored or not verdict.judged:
        return []
    words = ["fisheye-bench", "gate", _as_typed(verdict.run_folder, "RUN")]
    if not verdict.baseline_folder.is_relative_to(shipped_folder("baselines")):
        words += ["--baseline", _as_typed(verdict.baseline_folder, "BASELINE")]
    accept = "If the change is wanted, make this run the baseline, and commit it:"
    return [Paragraph(accept), Code(shlex.join([*words, "--update"]))]


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
        mark, style = _LOOKS[row.outcome]
        outcome = "within" if row.outcome is Outcome.PASSED else row.outcome.value
        values = (value_text(metric, value) for value in (row.before, row.after))
        line = [
            Cell(f"{mark if with_notes else ''}{outcome}", style=style),
            row.slice_name,
            metric,
            row.recordings,
            *values,
        ]
        line += [Cell(change_text(metric, row.difference), style=style), interval_text(metric, row.ci95)]
        note = ["; ".join(part for part in (worst_text(row), row.reason) if part)] if with_notes else []
        lines.append([*line, _text(metric, row.allowed, unit=" pt"), *note])
    return Table(columns=[*_HEADINGS, *(["Note"] if with_notes else [])], rows=lines, words=3, note=caption)


SCHEMA_VERSION = 1


def to_json(verdict: Verdict) -> str:
    """All checks and all rows; NaN and infinity become null."""
    run, worst = verdict.run, worst_row(verdict)
    content = {
        "schema_version": SCHEMA_VERSION,
        "passed": verdict.passed,
        "headline": verdict.headline,
        "no_verdict": verdict.why_none,
        "dataset": run.dataset.name if run else "",
        "method": run.method.name if run else "",
        "protocol": run.protocol.name if run else "",
        "tolerances": verdict.tolerances,
        "worst_recording": "" if worst is None else worst.worst_recordings[0].recording,
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

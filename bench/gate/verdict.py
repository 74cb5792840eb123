"""The verdict of the gate, what of it is read first, and how its numbers and rows are written.

A verdict is read within a minute: what changed, the overall rows, where most was lost; the rest is folded. Breakdowns,
as "range_m=[0, 2)", cut the same object-frames once more, so that one fault fails many of their rows. They are judged
like all others, and named by their number and the worst of them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from bench.errors import BenchError
from bench.evaluation import PairedChange, find_metric, headlines
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.harness.manifest import Aspect, Difference, Manifest
from bench.plain_text import counted

NOTHING_JUDGED = (
    "nothing was judged; a verdict needs metrics that decide, with cases in enough recordings, in baseline and run"
)
OF_ITSELF = ("method", "settings", "protocol", "code", "data", "reference")  # what may change, in the order of telling
_TOLD_AS = {Aspect.METHOD_CODE: "code", Aspect.INPUT_ERRORS: "data"}


class Outcome(StrEnum):
    """Result of a metric of a slice, or of a check of the data.

    FAILED: worse than tolerated and beyond chance, of a metric that decides; or a check that fails.
    SUSPECT: worse than tolerated, but it may be chance, or the metric decides nothing; or a check that is reported.
    IMPROVED: better by more than the tolerance, and the interval excludes no change.
    PASSED: within tolerance.
    NOT_JUDGED: for a stated reason.
    """

    FAILED = "failed"
    SUSPECT = "suspect"
    IMPROVED = "improved"
    PASSED = "passed"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A check that baseline and run measured the same things.

    Attributes:
        name: of the check.
        outcome: FAILED, SUSPECT or PASSED.
        message: one line.
    """

    name: str
    outcome: Outcome
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingChange:
    """A metric of one slice in one recording.

    Attributes:
        recording: its name.
        before: in the baseline.
        after: in the run.
    """

    recording: str
    before: float
    after: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Row(PairedChange):
    """One metric of one slice: its change, as the comparison has it, and the verdict on that.

    Attributes:
        slice_name: as `name_slice` names it.
        metric: its name.
        outcome: of the metric.
        reason: one line; empty where the numbers say it all.
        p_holm: p-value of a loss against none, corrected for the number of metrics that decide; None for the others.
        worsening: how much worse, negative for better; NaN without a value.
        allowed: the largest worsening that is tolerated; NaN without a tolerance or a baseline.
        worst_recordings: those that contribute most to the worsening, the worst first; none where none got worse.
    """

    slice_name: str
    metric: str
    outcome: Outcome
    reason: str
    p_holm: float | None
    worsening: float
    allowed: float
    worst_recordings: tuple[RecordingChange, ...]

    @property
    def severity(self) -> float:
        """Worsening in units of what is tolerated."""
        if math.isnan(self.worsening) or math.isnan(self.allowed):
            return -math.inf
        return self.worsening / self.allowed if self.allowed > 0 else math.copysign(math.inf, self.worsening)


def changes(found: Iterable[Difference]) -> dict[str, str]:
    """New and former value of everything that changed, by aspect, in the order of `OF_ITSELF`."""
    texts: dict[str, list[str]] = {}
    for difference in found:
        texts.setdefault(_TOLD_AS.get(difference.aspect, str(difference.aspect)), []).append(difference.text)
    return {what: "; ".join(texts[what]) for what in OF_ITSELF if what in texts}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """All of it.

    Attributes:
        baseline: manifest of the baseline; None where the two were not compared.
        run: manifest of the run; None where it cannot be read.
        tolerances: name of the rules.
        changes: what is not as in the baseline beside the scores, one line each, by what it is.
        checks: that both measured the same things, in a fixed order.
        rows: those of `compare_sums`, in its order.
        refusal: why run and baseline were not compared; None where they were.
        baseline_folder: folder of the baseline.
        run_folder: folder of the run.
        stored: what the run can judge as the new baseline, in words; "" where it was not stored as one.
    """

    baseline: Manifest | None
    run: Manifest | None
    tolerances: str
    changes: Mapping[str, str] = field(default_factory=dict)
    checks: tuple[Check, ...] = ()
    rows: tuple[Row, ...] = ()
    refusal: BenchError | None = None
    baseline_folder: Path = Path()
    run_folder: Path = Path()
    stored: str = ""

    @property
    def passed(self) -> bool:
        """Something was judged, and nothing failed."""
        return self.judged and not self.failed_checks and not self.rows_with(Outcome.FAILED)

    @property
    def judged(self) -> bool:
        """A metric decides, or a check failed: where neither is so, nothing is known of the run."""
        return bool(self.failed_checks) or any(row.p_holm is not None for row in self.rows)

    @property
    def why_none(self) -> str:
        """Reason that there is no verdict; "" where there is one."""
        return "" if self.judged else str(self.refusal or NOTHING_JUDGED)

    @property
    def subject(self) -> str:
        """One line: what was judged, and by which rules."""
        return ", ".join([*([self.run.title] if self.run else []), f"tolerances {self.tolerances}"])

    @property
    def unchanged(self) -> tuple[str, ...]:
        """Aspects that are as in the baseline; settings of another method are no settings of this one."""
        changed = {*self.changes, *(["settings"] if "method" in self.changes else [])}
        return tuple(what for what in OF_ITSELF if what not in changed)

    @property
    def failed_checks(self) -> tuple[Check, ...]:
        """The checks that fail the gate."""
        return tuple(check for check in self.checks if check.outcome is Outcome.FAILED)

    @property
    def told_rows(self) -> tuple[Row, ...]:
        """The rows, but for a kind of motion that all objects have: they are those of all moving objects once more."""
        whole = {_numbers(row) for row in self.rows if row.slice_name == ALL_MOVING}
        return tuple(
            row
            for row in self.rows
            if row.slice_name == ALL_MOVING or is_overlapping(row) or _numbers(row) not in whole
        )

    def rows_with(self, outcome: Outcome) -> tuple[Row, ...]:
        """Those of `told_rows` of one outcome, the worst first."""
        return tuple(sorted((row for row in self.told_rows if row.outcome is outcome), key=_worst_first))

    @property
    def headline(self) -> str:
        """One line: passed or failed, and how many of each."""
        numbers = {outcome: len(self.rows_with(outcome)) for outcome in Outcome}
        words = {Outcome.PASSED: "within tolerance"}
        parts = [f"{count} {words.get(outcome, outcome.value)}" for outcome, count in numbers.items() if count]
        if self.failed_checks:
            parts.insert(0, f"{len(self.failed_checks)} of {len(self.checks)} checks of the data failed")
        result = "passed" if self.passed else "FAILED" if self.judged else "WITHOUT A VERDICT"
        return f"gate {result}: {', '.join(parts) or 'nothing to compare'}"


def _numbers(row: Row) -> tuple[str, Outcome, float, float, int, int]:
    """Values that two rows of the same object-frames share, with the outcome, which tolerances can make differ."""
    return row.metric, row.outcome, row.before, row.after, row.cases_before, row.cases_after


def _worst_first(row: Row) -> tuple[float, bool, str, str]:
    # With one camera the slice "camera=front" is all of it; the plain name comes first.
    return -row.severity, "=" in row.slice_name, row.slice_name, row.metric


def value_text(metric: str, value: float) -> str:
    """A value: "72.1 %", "3.2" for a mean that is no ratio, "n/a" for NaN."""
    return _text(metric, value, unit=" %") or "n/a"


def change_text(metric: str, difference: float) -> str:
    """A difference: "-3.2 pt" in percentage points, "+0.40" for a mean that is no ratio, "n/a" for NaN."""
    return _text(metric, difference, unit=" pt", sign="+") or "n/a"


def interval_text(metric: str, interval: tuple[float, float] | None) -> str:
    """The interval of a difference: "[-5.1, -1.2]"; "" where there is none."""
    return "" if interval is None else f"[{', '.join(_text(metric, end, sign='+') for end in interval)}]"


def allowed_text(metric: str, allowed: float) -> str:
    """Text of what is tolerated: "1.5 pt", "4.50", "" for NaN."""
    return _text(metric, allowed, unit=" pt")


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
        text += f", tolerated {allowed_text(metric, row.allowed)}"
    return "; ".join(part for part in (text, worst_text(row), row.reason) if part)


def worst_text(row: Row) -> str:
    """Recording that most of a loss comes from: "most in drive-3"; "" for a row that is not worse than tolerated."""
    worse = row.outcome in {Outcome.FAILED, Outcome.SUSPECT}
    return f"most in {row.worst_recordings[0].recording}" if worse and row.worst_recordings else ""


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
    overall = overall_rows(verdict)
    rows = [row for outcome in NOTABLE for row in verdict.rows_with(outcome)]
    return [row for row in rows if row not in overall and not is_overlapping(row)]


def folded_lines(verdict: Verdict) -> list[str]:
    """Lines of what the breakdowns say, and of how many metrics were not judged."""
    lines = []
    for outcome in NOTABLE:
        rows = [row for row in verdict.rows_with(outcome) if is_overlapping(row)]
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


def worst_line(verdict: Verdict) -> str:
    """Recordings that most of the worst loss comes from, of the overall rows before others; "" without a loss."""
    for rows in (overall_rows(verdict), main_rows(verdict), verdict.rows):
        for outcome in (Outcome.FAILED, Outcome.SUSPECT):
            worse = [row for row in rows if row.outcome is outcome and row.worst_recordings]
            if worse:
                worst = max(worse, key=lambda row: row.severity)
                parts = [
                    f"{own.recording} {value_text(worst.metric, own.before)} -> {value_text(worst.metric, own.after)}"
                    for own in worst.worst_recordings
                ]
                return f"most of {worst.metric} of {worst.slice_name} is lost in: {'; '.join(parts)}"
    return ""

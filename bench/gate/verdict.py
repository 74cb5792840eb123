"""The verdict of the gate. `bench.reporting.verdict` writes it for people and CI servers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from bench.errors import BenchError
from bench.evaluation.comparison import PairedChange
from bench.evaluation.sums import ALL_MOVING
from bench.harness.manifest import Aspect, Difference, Manifest

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
        allowed: the largest worsening that is tolerated; NaN without a tolerance.
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

    @property
    def of_breakdown(self) -> bool:
        """It is of a breakdown, as "range_m=[0, 2)", which cuts the object-frames of other rows once more."""
        return "=" in self.slice_name


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
            row for row in self.rows if row.slice_name == ALL_MOVING or row.of_breakdown or _numbers(row) not in whole
        )

    def rows_with(self, outcome: Outcome) -> tuple[Row, ...]:
        """Those of `told_rows` of one outcome, the worst first."""
        return tuple(sorted((row for row in self.told_rows if row.outcome is outcome), key=_worst_first))

    @property
    def headline(self) -> str:
        """One line: passed or failed, and how many of each; of breakdowns only what failed or was not judged."""
        always = (Outcome.FAILED, Outcome.NOT_JUDGED)
        counts = Counter(row.outcome for row in self.told_rows if row.outcome in always or not row.of_breakdown)
        words = {Outcome.PASSED: "within tolerance"}
        parts = [f"{counts[outcome]} {words.get(outcome, outcome.value)}" for outcome in Outcome if counts[outcome]]
        if self.failed_checks:
            parts.insert(0, f"{len(self.failed_checks)} of {len(self.checks)} checks of the data failed")
        result = "passed" if self.passed else "FAILED" if self.judged else "WITHOUT A VERDICT"
        return f"gate {result}: {', '.join(parts) or 'nothing to compare'}"


def _numbers(row: Row) -> tuple[str, Outcome, float, float, int, int]:
    """Values that two rows of the same object-frames share, with the outcome, which tolerances can make differ."""
    return row.metric, row.outcome, row.before, row.after, row.cases_before, row.cases_after


def _worst_first(row: Row) -> tuple[float, bool, str, str]:
    # With one camera the slice "camera=front" is all of it; the plain name comes first.
    return -row.severity, row.of_breakdown, row.slice_name, row.metric

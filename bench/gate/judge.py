"""From baseline, run and tolerances to the verdict: a pure function."""

from __future__ import annotations

import math

from bench.evaluation.intervals import FEWEST_RECORDINGS, MEAN_CHANGE, RATIO_CHANGE
from bench.evaluation.metric_sums import NOT_RATIOS
from bench.evaluation.score_sheet import MetricSums, PairedChange, paired_change
from bench.gate.baseline import ScoredRun
from bench.gate.checks import data_checks, refuse_another_kind
from bench.gate.tolerances import Tolerance, Tolerances
from bench.gate.verdict import Outcome, Row, Verdict

OVER_PIXELS = ("precision", "recall", "segmentation_iou")  # their cases are pixels, so their images are counted
ROUNDING = 1e-12  # a change by exactly what is tolerated is tolerated
NO_SUMS = MetricSums(numerators={}, denominators={})


def judge(baseline: ScoredRun, run: ScoredRun, *, tolerances: Tolerances) -> Verdict:
    """Judge a run.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        tolerances: the rules.

    Raises:
        UsageError: another data set, split or protocol.
    """
    refuse_another_kind(baseline, run)
    return Verdict(
        dataset=run.dataset,
        method=run.method.name,
        tolerances=f"{tolerances.name} version {tolerances.version}",
        baseline_origin=baseline.origin,
        run_origin=run.origin,
        checks=data_checks(baseline, run, tolerances=tolerances),
        rows=tuple(
            _judge_metric(baseline, run, slice_name, metric, tolerances)
            for slice_name, metrics in run.sheet.slices.items()
            for metric in metrics
        ),
    )


def _judge_metric(baseline: ScoredRun, run: ScoredRun, slice_name: str, metric: str, tolerances: Tolerances) -> Row:
    before = baseline.sheet.slices.get(slice_name, {}).get(metric, NO_SUMS)
    after = run.sheet.slices[slice_name][metric]
    change = paired_change(before, after, within=MEAN_CHANGE if metric in NOT_RATIOS else RATIO_CHANGE)
    tolerance = tolerances.tolerance(slice_name, metric)
    worsening = tolerance.worsening(change.difference) if tolerance else math.nan
    allowed = tolerance.allowed(change.before) if tolerance else math.nan

    reason = "no tolerance is stated"
    if tolerance:
        reason = _why_not_judged(baseline, run, slice_name, metric, tolerances, recordings=change.recordings)
    outcome = Outcome.NOT_JUDGED if reason or not tolerance else _outcome(change, tolerance, worsening, allowed)
    if outcome is Outcome.SUSPECT:
        reason = "worse than tolerated, but the interval includes no change"
    return Row(
        slice_name=slice_name,
        metric=metric,
        outcome=outcome,
        reason=reason,
        change=change,
        worsening=worsening,
        allowed=allowed,
        worst_recording=_worst_recording(before, after, tolerance) if tolerance else None,
    )


def _outcome(change: PairedChange, tolerance: Tolerance, worsening: float, allowed: float) -> Outcome:
    # No interval of six recordings or more: none of them changed.
    low, high = sorted(tolerance.worsening(end) for end in change.ci95 or (0.0, 0.0))
    if worsening > allowed + ROUNDING:
        return Outcome.FAILED if low > 0 else Outcome.SUSPECT
    return Outcome.IMPROVED if worsening < -allowed - ROUNDING and high < 0 else Outcome.PASSED


def _why_not_judged(
    baseline: ScoredRun, run: ScoredRun, slice_name: str, metric: str, tolerances: Tolerances, *, recordings: int
) -> str:
    """Why a metric cannot be judged; "" when it can."""
    tolerance = tolerances.tolerance(slice_name, metric)
    if tolerance is not None and not tolerance.judged:
        return "the tolerances say so"
    if metric not in baseline.sheet.slices.get(slice_name, {}):
        return "not in the baseline"
    cases = min(_cases(scored, slice_name, metric) for scored in (baseline, run))
    if cases < tolerances.min_cases:
        return f"{cases} {'case' if cases == 1 else 'cases'}, {tolerances.min_cases} are needed"
    needed = max(tolerances.min_recordings, FEWEST_RECORDINGS)
    if recordings < needed:
        unit = "recording" if recordings == 1 else "recordings"
        return f"cases of both in {recordings} {unit}, {needed} are needed"
    return ""


def _cases(scored: ScoredRun, slice_name: str, metric: str) -> int:
    if metric in OVER_PIXELS:
        return scored.sheet.counts.get(slice_name, {}).get("frames", 0)
    return scored.sheet.slices[slice_name][metric].cases


def _worst_recording(before: MetricSums, after: MetricSums, tolerance: Tolerance) -> str | None:
    """The recording whose own worsening weighs most."""
    weights: dict[str, float] = {}
    for name, cases in before.denominators.items():
        if name in after.denominators:
            difference = after.numerators[name] / after.denominators[name] - before.numerators[name] / cases
            weights[name] = tolerance.worsening(difference) * cases
    worst = max(sorted(weights), key=weights.__getitem__, default=None)
    return worst if worst is not None and weights[worst] > 0 else None

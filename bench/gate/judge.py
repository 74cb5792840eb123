"""From baseline, run and tolerances to the verdict: a pure function."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

from bench.errors import UsageError
from bench.evaluation import PairedChange, compare_sums, find_metric
from bench.evaluation.definitions import SEGMENTATION
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.sums import FRAMES, name_slice
from bench.gate.baseline import MetricSums, ScoredRun
from bench.gate.changes import LISTED, changes
from bench.gate.tolerances import Tolerance, Tolerances
from bench.gate.verdict import Check, Outcome, RecordingChange, Row, Verdict
from bench.harness.manifest import Aspect, differences

COVERAGE = "false_positive_coverage"  # over all scored images
NO_SUMS = MetricSums(numerators={}, denominators={})
NO_CHANGE = PairedChange(
    before=math.nan, after=math.nan, difference=math.nan, ci95=None, p_value=None, cases_before=0, cases_after=0,
    recordings=0,
)  # fmt: skip
UNITS = {"object_frames": "object-frames", "annotated": "annotated objects", "evaluated": "scored images"}


def other_kind(baseline: ScoredRun, run: ScoredRun) -> tuple[str, str] | None:
    """Why the two cannot be compared at all, and what to do instead; None where they can."""
    split = f"--split {baseline.split}" if baseline.split is not None else "no --split"
    protocol = baseline.protocol.name
    rules = f"--protocol {protocol}" if protocol != run.protocol.name else f"{protocol} as it was for the baseline"
    remedies = {
        Aspect.DATASET: f"name a baseline of {run.dataset!r} with --baseline",
        Aspect.SPLIT: f"score with {split}",
        Aspect.PROTOCOL: f"score with {rules}",
    }
    found = (one for one in differences(baseline.manifest, run.manifest) if not one.comparable)
    other = next(found, None)
    if other is None:
        return None
    return f"the baseline is of {other.aspect} {other.before}, the run of {other.after}", remedies[other.aspect]


def data_checks(baseline: ScoredRun, run: ScoredRun, *, tolerances: Tolerances) -> tuple[Check, ...]:
    """Check run against baseline, always the same checks, in the order of cause and effect."""
    changed_data = Outcome.FAILED if tolerances.changed_data == "fail" else Outcome.SUSPECT
    found = differences(baseline.manifest, run.manifest)

    def texts(*aspects: Aspect) -> list[str]:
        return [one.text for one in found if one.aspect in aspects]

    return (
        _check("failures", list(run.failures), "the run has {count} failures: {listed}"),
        _check(
            "data_fingerprint",
            texts(Aspect.DATA),
            "data changed: other images, sweeps, labels, calibration or ego-motion; {listed}",
            outcome=changed_data,
        ),
        _check(
            "reference_fingerprint",
            [f"{_other_reference(baseline, run)}; {text}" for text in texts(Aspect.REFERENCE)],
            "reference changed: {listed}",
        ),
        _check("counts", list(_count_differences(baseline, run)), "reference changed: {listed}"),
        _check("cases", list(_case_differences(baseline, run)), "metrics are over other cases: {listed}"),
        _check("metrics", list(_missing(baseline, run)), "in the baseline, but not in the run: {listed}"),
        _check(
            "method",
            texts(Aspect.METHOD, Aspect.SETTINGS, Aspect.METHOD_CODE),
            "method changed: {listed}",
            outcome=Outcome.SUSPECT,
        ),
    )


def _other_reference(baseline: ScoredRun, run: ScoredRun) -> str:
    """In what the reference is another one: the images that were scored, or what is on them."""
    were, now = (scored.sheet.slices.get(FRAMES, {}).get(COVERAGE, NO_SUMS) for scored in (baseline, run))
    names = sorted(were.denominators.keys() | now.denominators.keys())
    images = [(name, int(now.denominators.get(name, 0)), int(were.denominators.get(name, 0))) for name in names]
    differing = [found for found in images if found[1] != found[2]]
    if not differing:
        return "other objects, polygons or regions"
    name, is_now, was = differing[0]
    return (
        f"other images were scored, {now.cases} where the baseline has {were.cases}, and a gate compares equal ones; "
        f"they differ in {len(differing)} of {len(names)} recordings, the first {name!r} with {is_now} (was {was}), "
        "as for a method that needs a longer history"
    )


def _check(name: str, faults: Sequence[str], message: str, *, outcome: Outcome = Outcome.FAILED) -> Check:
    if not faults:
        return Check(name=name, outcome=Outcome.PASSED, message="as in the baseline")
    more = f"; and {len(faults) - LISTED} more" if len(faults) > LISTED else ""
    listed = "; ".join(faults[:LISTED]) + more
    return Check(name=name, outcome=outcome, message=message.format(count=len(faults), listed=listed))


def _count_differences(baseline: ScoredRun, run: ScoredRun) -> Iterator[str]:
    """For example "4 object-frames fewer in all_moving (12, were 16)"; the slices of everything first."""
    differences = [
        (UNITS.get(name, name.replace("_", " ")), slice_name, was, run.sheet.counts.get(slice_name, {}).get(name, 0))
        for slice_name, names in baseline.sheet.counts.items()
        for name, was in names.items()
    ]
    whole = {"all_moving": 0, "frames": 1}
    for unit, slice_name, was, now in sorted(differences, key=lambda found: whole.get(found[1], 2)):
        if now != was:
            yield _difference(unit, slice_name, was, now)


def _case_differences(baseline: ScoredRun, run: ScoredRun) -> Iterator[str]:
    for slice_name, metric, before in _metrics(baseline):
        after = run.sheet.slices.get(slice_name, {}).get(metric)
        if after is None or find_metric(metric).cases_by_method or after.denominators == before.denominators:
            continue
        if after.cases == before.cases:
            yield f"{metric} of {slice_name}: {before.cases} cases, spread otherwise over the recordings"
        else:
            yield f"{metric}: {_difference('cases', slice_name, before.cases, after.cases)}"


def _missing(baseline: ScoredRun, run: ScoredRun) -> Iterator[str]:
    for slice_name, metric, _ in _metrics(baseline):
        if metric not in run.sheet.slices.get(slice_name, {}):
            yield f"{metric} of {slice_name}"


def _metrics(scored: ScoredRun) -> Iterator[tuple[str, str, MetricSums]]:
    for slice_name, metrics in scored.sheet.slices.items():
        for metric, sums in metrics.items():
            yield slice_name, metric, sums


def _difference(unit: str, slice_name: str, was: int, now: int) -> str:
    return f"{abs(now - was)} {unit} {'fewer' if now < was else 'more'} in {slice_name} ({now}, were {was})"


OVER_PIXELS = frozenset(metric.name for metric in SEGMENTATION)  # their cases are pixels, so their images are counted
WORST = 3  # recordings that are named
ROUNDING = 1e-12  # a change by exactly what is tolerated is tolerated


def judge(baseline: ScoredRun, run: ScoredRun, *, tolerances: Tolerances) -> Verdict:
    """Judge a run.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        tolerances: the rules.

    Raises:
        UsageError: another data set, split or protocol.
    """
    if differing := other_kind(baseline, run):
        why, do = differing
        raise UsageError(f"{why}: they do not compare; {do}, or replace the baseline with --update")
    compared = compare_sums(baseline.sheet.table(), run.sheet.table()).reset_index().to_dict("records")
    found = {(name_slice(row["breakdown"], row["slice"]), row["metric"]): PairedChange.of(row) for row in compared}
    return Verdict(
        dataset=run.dataset,
        method=run.method.name,
        tolerances=f"{tolerances.name} version {tolerances.version}",
        baseline_origin=baseline.origin,
        run_origin=run.origin,
        protocol=run.protocol.name,
        changes=changes(baseline, run),
        checks=data_checks(baseline, run, tolerances=tolerances),
        rows=tuple(
            _judge_metric(baseline, run, name, metric, tolerances, found.get((name, metric), NO_CHANGE))
            for name, metrics in run.sheet.slices.items()
            for metric in metrics
        ),
    )


def judgeable(run: ScoredRun, *, tolerances: Tolerances) -> tuple[str, str]:
    """What a run can judge as a baseline: "67 of 238 metrics can be judged", and why it is none; "" where some are."""
    rows = judge(run, run, tolerances=tolerances).rows
    judged = sum(row.outcome is not Outcome.NOT_JUDGED for row in rows)
    counted = f"{judged} of {len(rows)} metrics can be judged"
    if judged:
        return counted, ""
    recordings = max((row.change.recordings for row in rows), default=0)
    needed = max(tolerances.min_recordings, FEWEST_RECORDINGS)
    if recordings < needed:
        return counted, f": {recordings} recordings, {needed} needed"
    reasons = Counter(row.reason for row in rows)
    return counted, f": {reasons.most_common(1)[0][0]}"


def refuse(run: ScoredRun | None, *, tolerances: Tolerances, reason: str) -> Verdict:
    """No verdict, for all that is told of one.

    Args:
        run: None where it cannot be read.
        tolerances: the rules.
        reason: one line.
    """
    return Verdict(
        dataset=run.dataset if run else "",
        method=run.method.name if run else "",
        tolerances=f"{tolerances.name} version {tolerances.version}",
        baseline_origin=None,
        run_origin=run.origin if run else None,
        protocol=run.protocol.name if run else "",
        changes=(),
        checks=(),
        rows=(),
        refusal=reason,
    )


def _judge_metric(
    baseline: ScoredRun, run: ScoredRun, slice_name: str, metric: str, tolerances: Tolerances, change: PairedChange
) -> Row:
    before = baseline.sheet.slices.get(slice_name, {}).get(metric, NO_SUMS)
    after = run.sheet.slices[slice_name][metric]
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
        worst_recordings=_worst_recordings(before, after, tolerance) if tolerance else (),
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


def _worst_recordings(before: MetricSums, after: MetricSums, tolerance: Tolerance) -> tuple[RecordingChange, ...]:
    """The recordings whose own worsening weighs most, the worst first."""
    weights: dict[str, float] = {}
    found: dict[str, RecordingChange] = {}
    for name, cases in sorted(before.denominators.items()):
        if name in after.denominators:
            was, now = before.numerators[name] / cases, after.numerators[name] / after.denominators[name]
            weights[name] = tolerance.worsening(now - was) * cases
            found[name] = RecordingChange(name=name, before=was, after=now)
    worst = sorted((name for name in found if weights[name] > 0), key=lambda name: -weights[name])
    return tuple(found[name] for name in worst[:WORST])

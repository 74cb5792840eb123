"""Verdict on a run by baseline and tolerances: a pure function, a layer on the comparison of their sums."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import pandas as pd

from bench.errors import UsageError
from bench.evaluation import Definition, PairedChange, find_metric, holm, paired_change
from bench.evaluation.comparison import SIDES, SIGNIFICANCE, SLICE, Key, Pairs, group_pairs, pair_sums
from bench.evaluation.definitions import IMAGE_FRAMES
from bench.evaluation.rows import EVALUATED
from bench.evaluation.sums import ALL_MOVING, FRAMES, TERMS, name_slice
from bench.gate.baseline import RunSums
from bench.gate.changes import LISTED, changes
from bench.gate.rendered import small_difference
from bench.gate.tolerances import Tolerance, Tolerances
from bench.gate.verdict import Check, Outcome, RecordingChange, Row, Verdict
from bench.harness.manifest import Aspect, Manifest, differences

COVERAGE = "false_positive_coverage"  # over all scored images
UNITS = (
    *("object-frames", "tracks", "annotated objects", "static", "ignored"),
    *("images", "scored images", "failed", "skipped"),
)
BEFORE, AFTER = "denominator_before", "denominator_after"


def incomparable_reason(baseline: Manifest, run: Manifest) -> tuple[str, str] | None:
    """Reason that the two cannot be compared at all, and what to do instead; None where they can."""
    split = f"--split {baseline.dataset.split}" if baseline.dataset.split is not None else "no --split"
    protocol = baseline.protocol.name
    rules = f"--protocol {protocol}" if protocol != run.protocol.name else f"{protocol} as it was for the baseline"
    remedies = {
        Aspect.DATASET: f"name a baseline of {run.dataset.name!r} with --baseline",
        Aspect.SPLIT: f"score with {split}",
        Aspect.PROTOCOL: f"score with {rules}",
    }
    found = (one for one in differences(baseline, run) if not one.comparable)
    other = next(found, None)
    if other is None:
        return None
    return f"the baseline is of {other.aspect} {other.before}, the run of {other.after}", remedies[other.aspect]


def data_checks(
    baseline: RunSums, run: RunSums, sums: pd.DataFrame, pairs: Pairs, *, tolerances: Tolerances
) -> tuple[Check, ...]:
    """Check run against baseline, the same checks in the order of cause and effect.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        sums: of both, as `pair_sums` gives them.
        pairs: the same by slice and metric.
        tolerances: the rules.

    Returns:
        Always the same checks, and one more where nobody reviewed the annotations.
    """
    changed_data = Outcome.FAILED if tolerances.changed_data == "fail" else Outcome.SUSPECT
    found = differences(baseline.manifest, run.manifest)

    def texts(*aspects: Aspect) -> list[str]:
        return [one.text for one in found if one.aspect in aspects]

    told, of_reference = [f"{_other_reference(pairs)}; {text}" for text in texts(Aspect.REFERENCE)], Outcome.FAILED
    rendered = told and texts(Aspect.DATA) and tolerances.changed_data == "report"
    if rendered and (small := small_difference(sums)):
        told, of_reference = [small], Outcome.SUSPECT
    data, reference = "data changed: other images, sweeps, labels, calibration or ego-motion", "reference changed"
    method = texts(Aspect.METHOD, Aspect.SETTINGS, Aspect.METHOD_CODE)
    return (
        _check("failures", run.failures, "the run has {count} failures: {listed}", Outcome.FAILED),
        _check("data_digest", texts(Aspect.DATA), f"{data}; {{listed}}", changed_data),
        _check("reference_digest", told, f"{reference}: {{listed}}", of_reference),
        _check("counts", [*_count_differences(sums)], f"{reference}: {{listed}}", of_reference),
        _check("cases", [*_case_differences(pairs)], "metrics are over other cases: {listed}", of_reference),
        _check("metrics", [*_missing(pairs)], "in the baseline, but not in the run: {listed}", of_reference),
        _check("method", method, "method changed: {listed}", Outcome.SUSPECT),
        *([Check(name="annotations", outcome=Outcome.SUSPECT, message=run.unreviewed)] if run.unreviewed else []),
    )


def _other_reference(pairs: Pairs) -> str:
    """In what the reference is another one: the images that were scored, or what is on them."""
    images = pairs.get((FRAMES, FRAMES, COVERAGE), pd.DataFrame(columns=["recording", BEFORE, AFTER]))
    differing = images[images[BEFORE] != images[AFTER]].sort_values("recording")
    if differing.empty:
        return "other objects, polygons or regions"
    first = differing.iloc[0]
    return (
        f"other images were scored, {images[AFTER].sum():.0f} where the baseline has {images[BEFORE].sum():.0f}, and a "
        f"gate compares equal ones; they differ in {len(differing)} of {len(images)} recordings, the first "
        f"{first['recording']!r} with {first[AFTER]:.0f} (was {first[BEFORE]:.0f}), as for a method that needs a "
        "longer history"
    )


def _check(name: str, faults: Sequence[str], message: str, outcome: Outcome) -> Check:
    if not faults:
        return Check(name=name, outcome=Outcome.PASSED, message="as in the baseline")
    more = f"; and {len(faults) - LISTED} more" if len(faults) > LISTED else ""
    listed = "; ".join(faults[:LISTED]) + more
    return Check(name=name, outcome=outcome, message=message.format(count=len(faults), listed=listed))


def _count_differences(sums: pd.DataFrame) -> Iterator[str]:
    """For example "4 object-frames fewer in all_moving (12, were 16)"; the slices of everything first."""
    before, after = (_counts(sums, side) for side in SIDES)
    whole = {ALL_MOVING: 0, FRAMES: 1}
    found = before.keys() | after.keys()
    for slice_name, unit in sorted(found, key=lambda key: (whole.get(key[0], 2), key[0], UNITS.index(key[1]))):
        was, now = before[slice_name, unit], after[slice_name, unit]
        if now != was:
            yield _difference(unit, slice_name, was, now)


def _counts(sums: pd.DataFrame, side: str) -> Counter[tuple[str, str]]:
    """Numbers by slice and unit that the reference alone decides: objects by slice and by status, images by status."""
    counts: Counter[tuple[str, str]] = Counter()
    columns = [*SLICE, *(f"{term}{side}" for term in TERMS)]
    for breakdown, name, metric, above, below in sums[columns].itertuples(index=False):
        called = name_slice(breakdown, name)
        if metric == "tracks":
            counts[called, "tracks"] += int(above)
            counts[called, "object-frames"] += int(below)
        elif (metric, breakdown) == ("annotated", "status"):
            counts[ALL_MOVING, "annotated objects"] += int(above)
            if name != EVALUATED:
                counts[ALL_MOVING, name] += int(above)
        elif (metric, breakdown) == ("images", "status"):
            counts[FRAMES, "images"] += int(above)
            counts[FRAMES, "scored images" if name == EVALUATED else name] += int(above)
    return counts


def _case_differences(pairs: Pairs) -> Iterator[str]:
    for (breakdown, name, metric), part in pairs.items():
        one_has_none = {*part["side"]} in ({"left_only"}, {"right_only"})
        if one_has_none or find_metric(metric).cases_by_method or (part[BEFORE] == part[AFTER]).all():
            continue
        called, was, now = name_slice(breakdown, name), int(part[BEFORE].sum()), int(part[AFTER].sum())
        if was == now:
            yield f"{metric} of {called}: {was} cases, spread otherwise over the recordings"
        else:
            yield f"{metric}: {_difference('cases', called, was, now)}"


def _missing(pairs: Pairs) -> Iterator[str]:
    for (breakdown, name, metric), part in pairs.items():
        if (part["side"] == "left_only").all():
            yield f"{metric} of {name_slice(breakdown, name)}"


def _difference(unit: str, slice_name: str, was: int, now: int) -> str:
    return f"{abs(now - was)} {unit} {'fewer' if now < was else 'more'} in {slice_name} ({now}, were {was})"


WORST = 3  # recordings that are named
ROUNDING = 1e-12  # a change by exactly what is tolerated is tolerated


def judge(baseline: RunSums, run: RunSums, *, tolerances: Tolerances) -> Verdict:
    """Judge a run.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        tolerances: the rules.

    Raises:
        UsageError: another data set, split or protocol.
    """
    if differing := incomparable_reason(baseline.manifest, run.manifest):
        why, hint = differing
        raise UsageError(f"{why}: they do not compare; {hint}, or replace the baseline with --update")
    sums = pair_sums(baseline.sums, run.sums)
    pairs = group_pairs(sums)
    return Verdict(
        baseline=baseline.manifest,
        run=run.manifest,
        tolerances=f"{tolerances.name} version {tolerances.version}",
        changes=changes(baseline.manifest, run.manifest),
        checks=data_checks(baseline, run, sums, pairs, tolerances=tolerances),
        rows=judge_rows(pairs, tolerances=tolerances),
    )


def judge_rows(pairs: Pairs, *, tolerances: Tolerances) -> tuple[Row, ...]:
    """Judge every metric of every slice; of those that decide, the chance that one is worse by chance alone counts."""
    rows = [_measure(key, pairs, tolerances) for key in pairs]
    by_chance = holm([row.p_holm for row in rows])
    return tuple(_judge_row(replace(row, p_holm=p), tolerances) for row, p in zip(rows, by_chance, strict=True))


def _measure(key: Key, pairs: Pairs, tolerances: Tolerances) -> Row:
    """Measure a row before it is judged: its `p_holm` is not yet corrected, its `reason` why it cannot be judged."""
    slice_name, metric, part = name_slice(*key[:2]), find_metric(key[2]), pairs[key]
    change, rule = paired_change(part, within=metric.change_bounds), tolerances.tolerance(slice_name, metric.name)
    reason = _why_not_judged(key, change, pairs, tolerances, rule)
    return Row(
        slice_name=slice_name,
        metric=metric.name,
        outcome=Outcome.NOT_JUDGED if reason else Outcome.PASSED,
        reason=reason,
        change=change,
        p_holm=_p_of_loss(key, change) if rule and rule.decides and not reason else None,
        worsening=-metric.improvement(change.difference),
        allowed=rule.allowed(change.before) if rule else math.nan,
        worst_recordings=_worst_recordings(part, metric),
    )


def _judge_row(row: Row, tolerances: Tolerances) -> Row:
    improvement = find_metric(row.metric).improvement
    low, high = sorted(-improvement(end) for end in row.change.ci95 or (0.0, 0.0))  # None: no recording changed
    if row.outcome is Outcome.NOT_JUDGED:
        return row
    if row.worsening > row.allowed + ROUNDING:
        reason = _why_suspect(low, row.p_holm)
        certain = not reason or (row.p_holm is not None and tolerances.suspect == "fail")
        return replace(row, outcome=Outcome.FAILED if certain else Outcome.SUSPECT, reason=reason)
    improved = row.worsening < -row.allowed - ROUNDING and high < 0
    return replace(row, outcome=Outcome.IMPROVED) if improved else row


def _p_of_loss(key: Key, change: PairedChange) -> float | None:
    """One-sided: of no loss against a loss, since no gain fails."""
    if change.p_value is None:
        return None
    return change.p_value / 2 if find_metric(key[2]).improvement(change.difference) < 0 else 1 - change.p_value / 2


def judgeable(run: RunSums, *, tolerances: Tolerances) -> tuple[str, str]:
    """Count what a run can judge as a baseline: "67 of 238 metrics can be judged", and why none; "" for some."""
    rows = judge(run, run, tolerances=tolerances).rows
    judged = sum(row.outcome is not Outcome.NOT_JUDGED for row in rows)
    counted = f"{judged} of {len(rows)} metrics can be judged"
    if judged:
        return counted, ""
    recordings = max((row.change.recordings for row in rows), default=0)
    if recordings < tolerances.min_recordings:
        return counted, f": {recordings} recordings, {tolerances.min_recordings} needed"
    reasons = Counter(row.reason for row in rows)
    return counted, f": {reasons.most_common(1)[0][0]}"


def refuse(run: Manifest | None, *, tolerances: Tolerances, reason: str) -> Verdict:
    """No verdict, for all that is told of one.

    Args:
        run: None where it cannot be read.
        tolerances: the rules.
        reason: one line.
    """
    rules = f"{tolerances.name} version {tolerances.version}"
    return Verdict(baseline=None, run=run, tolerances=rules, changes=(), checks=(), rows=(), refusal=reason)


def _why_suspect(low: float, p_holm: float | None) -> str:
    """Reason that a loss beyond what is tolerated may be chance, or decides nothing; "" where it is neither."""
    if low <= 0:
        return "worse than tolerated, but the interval includes no change"
    if p_holm is None:
        return "worse than tolerated, but this row decides nothing"
    return "" if p_holm <= SIGNIFICANCE else f"worse than tolerated, but one of several: p = {p_holm:.2f} after Holm"


def _why_not_judged(
    key: Key, change: PairedChange, pairs: Pairs, tolerances: Tolerances, rule: Tolerance | None
) -> str:
    """Reason that a metric cannot be judged; "" when it can."""
    breakdown, name, metric = key
    if rule is None:
        return "no tolerance is stated"
    if not change.cases_before and change.cases_after:
        return "not in the baseline"
    cases = min(change.cases_before, change.cases_after)
    if find_metric(metric).over == IMAGE_FRAMES:  # cases of some are pixels
        images = pairs.get((breakdown, name, COVERAGE), pairs[key])
        cases = int(min(images[BEFORE].sum(), images[AFTER].sum()))
    if cases < tolerances.min_cases:
        return f"{cases} {'case' if cases == 1 else 'cases'}, {tolerances.min_cases} are needed"
    if change.recordings < tolerances.min_recordings:
        unit = "recording" if change.recordings == 1 else "recordings"
        return f"cases of both in {change.recordings} {unit}, {tolerances.min_recordings} are needed"
    return ""


def _worst_recordings(pairs: pd.DataFrame, metric: Definition) -> tuple[RecordingChange, ...]:
    """The recordings whose own worsening weighs most, the worst first."""
    shared = pairs[(pairs[BEFORE] > 0) & (pairs[AFTER] > 0)]
    was, now = shared["numerator_before"] / shared[BEFORE], shared["numerator_after"] / shared[AFTER]
    weights = -(now - was).map(metric.improvement) * shared[BEFORE]
    ranked = shared.assign(was=was, now=now, weight=weights).sort_values(
        ["weight", "recording"], ascending=[False, True]
    )
    worst = ranked[ranked["weight"] > 0][["recording", "was", "now"]][:WORST]
    return tuple(RecordingChange(name=name, before=was, after=now) for name, was, now in worst.itertuples(index=False))

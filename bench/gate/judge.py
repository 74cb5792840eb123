"""Verdict on a run by baseline and tolerances: a pure function, a layer on the comparison of their sums."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import pandas as pd

from bench.errors import UsageError
from bench.evaluation import Definition, PairedChange, find_metric, holm, paired_change
from bench.evaluation.comparison import SIGNIFICANCE, SLICE, pair_sums
from bench.evaluation.definitions import SEGMENTATION
from bench.evaluation.rows import EVALUATED
from bench.evaluation.sums import ALL_MOVING, FRAMES, name_slice
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
Key = tuple[str, str, str]  # breakdown, slice, metric
Pairs = dict[Key, pd.DataFrame]  # the sums of baseline and run by recording


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


def data_checks(baseline: RunSums, run: RunSums, pairs: Pairs, *, tolerances: Tolerances) -> tuple[Check, ...]:
    """Check run against baseline, always the same checks, in the order of cause and effect."""
    changed_data = Outcome.FAILED if tolerances.changed_data == "fail" else Outcome.SUSPECT
    found = differences(baseline.manifest, run.manifest)

    def texts(*aspects: Aspect) -> list[str]:
        return [one.text for one in found if one.aspect in aspects]

    told, of_reference = [f"{_other_reference(pairs)}; {text}" for text in texts(Aspect.REFERENCE)], Outcome.FAILED
    rendered = told and texts(Aspect.DATA) and tolerances.changed_data == "report"
    if rendered and (small := small_difference(baseline.sums, run.sums)):
        told, of_reference = [small], Outcome.SUSPECT
    return (
        _check("failures", list(run.failures), "the run has {count} failures: {listed}"),
        _check(
            "data_digest",
            texts(Aspect.DATA),
            "data changed: other images, sweeps, labels, calibration or ego-motion; {listed}",
            outcome=changed_data,
        ),
        _check(
            "reference_digest",
            told,
            "reference changed: {listed}",
            outcome=of_reference,
        ),
        _check("counts", list(_count_differences(baseline, run)), "reference changed: {listed}", outcome=of_reference),
        _check(
            "cases",
            list(_case_differences(baseline, run, pairs)),
            "metrics are over other cases: {listed}",
            outcome=of_reference,
        ),
        _check(
            "metrics",
            list(_missing(baseline, run, pairs)),
            "in the baseline, but not in the run: {listed}",
            outcome=of_reference,
        ),
        _check(
            "method",
            texts(Aspect.METHOD, Aspect.SETTINGS, Aspect.METHOD_CODE),
            "method changed: {listed}",
            outcome=Outcome.SUSPECT,
        ),
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


def _check(name: str, faults: Sequence[str], message: str, *, outcome: Outcome = Outcome.FAILED) -> Check:
    if not faults:
        return Check(name=name, outcome=Outcome.PASSED, message="as in the baseline")
    more = f"; and {len(faults) - LISTED} more" if len(faults) > LISTED else ""
    listed = "; ".join(faults[:LISTED]) + more
    return Check(name=name, outcome=outcome, message=message.format(count=len(faults), listed=listed))


def _count_differences(baseline: RunSums, run: RunSums) -> Iterator[str]:
    """For example "4 object-frames fewer in all_moving (12, were 16)"; the slices of everything first."""
    before, after = _counts(baseline.sums), _counts(run.sums)
    whole = {ALL_MOVING: 0, FRAMES: 1}
    found = before.keys() | after.keys()
    for slice_name, unit in sorted(found, key=lambda key: (whole.get(key[0], 2), key[0], UNITS.index(key[1]))):
        was, now = (counts.get((slice_name, unit), 0) for counts in (before, after))
        if now != was:
            yield _difference(unit, slice_name, was, now)


def _counts(sums: pd.DataFrame) -> dict[tuple[str, str], int]:
    """Numbers by slice and unit that the reference alone decides: objects by slice and by status, images by status."""
    counts: Counter[tuple[str, str]] = Counter()
    for breakdown, name, metric, above, below in sums[[*SLICE, "numerator", "denominator"]].itertuples(index=False):
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
    return dict(counts)


def _case_differences(baseline: RunSums, run: RunSums, pairs: Pairs) -> Iterator[str]:
    shared = _keys(baseline) & _keys(run)
    for (breakdown, name, metric), part in pairs.items():
        if (breakdown, name, metric) not in shared or find_metric(metric).cases_by_method:
            continue
        if (part[BEFORE] == part[AFTER]).all():
            continue
        called, was, now = name_slice(breakdown, name), int(part[BEFORE].sum()), int(part[AFTER].sum())
        if was == now:
            yield f"{metric} of {called}: {was} cases, spread otherwise over the recordings"
        else:
            yield f"{metric}: {_difference('cases', called, was, now)}"


def _missing(baseline: RunSums, run: RunSums, pairs: Pairs) -> Iterator[str]:
    gone = _keys(baseline) - _keys(run)
    return (
        f"{metric} of {name_slice(breakdown, name)}"
        for breakdown, name, metric in pairs
        if (breakdown, name, metric) in gone
    )


def _keys(scored: RunSums) -> set[Key]:
    keys: Any = scored.sums[SLICE].itertuples(index=False, name=None)
    return set(keys)


def _difference(unit: str, slice_name: str, was: int, now: int) -> str:
    return f"{abs(now - was)} {unit} {'fewer' if now < was else 'more'} in {slice_name} ({now}, were {was})"


OVER_PIXELS = frozenset(metric.name for metric in SEGMENTATION)  # their cases are pixels, so their images are counted
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
    paired = pair_sums(baseline.sums, run.sums)
    groups: Iterable[tuple[Any, pd.DataFrame]] = paired.groupby(SLICE, sort=False)
    pairs: Pairs = {key: part for key, part in groups}  # noqa: C416 (`dict` would ask pandas for its keys)
    return Verdict(
        baseline=baseline.manifest,
        run=run.manifest,
        tolerances=f"{tolerances.name} version {tolerances.version}",
        changes=changes(baseline.manifest, run.manifest),
        checks=data_checks(baseline, run, pairs, tolerances=tolerances),
        rows=judge_rows(pairs, tolerances=tolerances),
    )


def judge_rows(pairs: Pairs, *, tolerances: Tolerances) -> tuple[Row, ...]:
    """Judge every metric of every slice; of those that decide, the chance that one is worse by chance alone counts."""
    changed = {key: paired_change(part, within=find_metric(key[2]).change_bounds) for key, part in pairs.items()}
    rules = {key: tolerances.tolerance(name_slice(*key[:2]), key[2]) for key in pairs}
    reasons = {key: _why_not_judged(key, change, pairs, tolerances, rules[key]) for key, change in changed.items()}
    deciding = [key for key, rule in rules.items() if rule and rule.decides and not reasons[key]]
    by_chance = dict(zip(deciding, holm([_p_of_loss(key, changed[key]) for key in deciding]), strict=True))
    return tuple(
        _judge_metric(key, change, rules[key], reasons[key], by_chance.get(key), pairs[key], tolerances)
        for key, change in changed.items()
    )


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


def _judge_metric(
    key: Key,
    change: PairedChange,
    rule: Tolerance | None,
    why_not_judged: str,
    p_holm: float | None,
    pairs: pd.DataFrame,
    tolerances: Tolerances,
) -> Row:
    metric = find_metric(key[2])
    worsening = -metric.improvement(change.difference)
    allowed = rule.allowed(change.before) if rule else math.nan
    low, high = sorted(-metric.improvement(end) for end in change.ci95 or (0.0, 0.0))  # None: no recording changed
    outcome, reason = Outcome.PASSED, why_not_judged
    if why_not_judged:
        outcome = Outcome.NOT_JUDGED
    elif worsening > allowed + ROUNDING:
        reason = _why_suspect(low, p_holm)
        certain = not reason or (p_holm is not None and tolerances.suspect == "fail")
        outcome = Outcome.FAILED if certain else Outcome.SUSPECT
    elif worsening < -allowed - ROUNDING and high < 0:
        outcome = Outcome.IMPROVED
    return Row(
        slice_name=name_slice(*key[:2]),
        metric=metric.name,
        outcome=outcome,
        reason=reason,
        change=change,
        p_holm=p_holm,
        worsening=worsening,
        allowed=allowed,
        worst_recordings=_worst_recordings(pairs, metric),
    )


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
    if metric in OVER_PIXELS:
        images = pairs.get((breakdown, name, COVERAGE))
        cases = 0 if images is None else int(min(images[BEFORE].sum(), images[AFTER].sum()))
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

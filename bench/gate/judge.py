"""Verdict on a run by baseline and tolerances: a pure function, a layer on the comparison of their sums.

Two tables: the sums of both runs side by side (`pair_sums`), a row for each slice, recording and metric, and their
comparison (`compare_pairs`), a row for each slice and metric, to which the tolerances are joined.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import pandas as pd

from bench.errors import UsageError
from bench.evaluation import find_metric, holm
from bench.evaluation.comparison import (
    CASES,
    SIDES,
    SIGNIFICANCE,
    SLICE,
    compare_pairs,
    excludes_no_change,
    improvements_by_recording,
    pair_sums,
)
from bench.evaluation.definitions import EVERY_ROW, IMAGE_FRAMES
from bench.evaluation.rows import EVALUATED
from bench.evaluation.sums import ALL_MOVING, FRAMES, TERMS, name_slice
from bench.gate.baseline import RunSums
from bench.gate.changes import LISTED, changes
from bench.gate.rendered import small_difference
from bench.gate.tolerances import Tolerances, void_rules
from bench.gate.verdict import Check, Outcome, RecordingChange, Row, Verdict
from bench.harness.manifest import Aspect, Manifest, differences
from bench.plain_text import listed

UNITS = (
    *("object-frames", "tracks", "annotated objects", "static", "ignored"),
    *("images", "scored images", "failed", "skipped"),
)


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
    baseline: RunSums, run: RunSums, pairs: pd.DataFrame, changes: pd.DataFrame, *, tolerances: Tolerances
) -> tuple[Check, ...]:
    """Check run against baseline, the same checks in the order of cause and effect.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        pairs: sums of both, as `pair_sums` gives them.
        changes: of the metrics, as `compare_pairs` gives them.
        tolerances: the rules.

    Returns:
        Always the same checks, one more where nobody reviewed the annotations, and one where rules apply to nothing.
    """
    void = void_rules(tolerances, ((row["slice_name"], row["metric"]) for row in _records(changes)))
    changed_data = Outcome.FAILED if tolerances.changed_data == "fail" else Outcome.SUSPECT
    found = differences(baseline.manifest, run.manifest)

    def texts(*aspects: Aspect) -> list[str]:
        return [one.text for one in found if one.aspect in aspects]

    told, of_reference = [f"{_other_reference(pairs)}; {text}" for text in texts(Aspect.REFERENCE)], Outcome.FAILED
    rendered = told and texts(Aspect.DATA) and tolerances.changed_data == "report"
    if rendered and (small := small_difference(pairs)):
        told, of_reference = [small], Outcome.SUSPECT
    data, reference = "data changed: other images, sweeps, labels, calibration or ego-motion", "reference changed"
    method = texts(Aspect.METHOD, Aspect.SETTINGS, Aspect.METHOD_CODE)
    return (
        _check("failures", run.failures, "the run has {count} failures: {listed}", Outcome.FAILED),
        _check("data_digest", texts(Aspect.DATA), f"{data}; {{listed}}", changed_data),
        _check("reference_digest", told, f"{reference}: {{listed}}", of_reference),
        _check("counts", [*_count_differences(pairs)], f"{reference}: {{listed}}", of_reference),
        _check("cases", [*_case_differences(changes)], "metrics are over other cases: {listed}", of_reference),
        _check("metrics", [*_missing(changes)], "in the baseline, but not in the run: {listed}", of_reference),
        _check("method", method, "method changed: {listed}", Outcome.SUSPECT),
        *([Check(name="annotations", outcome=Outcome.SUSPECT, message=run.unreviewed)] if run.unreviewed else []),
        *(
            [Check(name="tolerances", outcome=Outcome.SUSPECT, message=f"rules of no row: {listed(void)}")]
            if void
            else []
        ),
    )


def _other_reference(pairs: pd.DataFrame) -> str:
    """In what the reference is another one: the images that were scored, or what is on them."""
    scored = (pairs[SLICE] == [FRAMES, FRAMES, EVERY_ROW[IMAGE_FRAMES]]).all(axis=1)
    images = pairs[scored].set_index("recording")[CASES].set_axis(["before", "after"], axis=1).sort_index()
    differing = images[images["before"] != images["after"]]
    if differing.empty:
        return "other objects, polygons or regions"
    first = differing.iloc[0]
    return (
        f"other images were scored, {images['after'].sum():.0f} where the baseline has {images['before'].sum():.0f}, "
        f"and a gate compares equal ones; they differ in {len(differing)} of {len(images)} recordings, the first "
        f"{differing.index[0]!r} with {first['after']:.0f} (was {first['before']:.0f}), as for a method that needs a "
        "longer history"
    )


def _check(name: str, faults: Sequence[str], message: str, outcome: Outcome) -> Check:
    if not faults:
        return Check(name=name, outcome=Outcome.PASSED, message="as in the baseline")
    more = f"; and {len(faults) - LISTED} more" if len(faults) > LISTED else ""
    first = "; ".join(faults[:LISTED]) + more
    return Check(name=name, outcome=outcome, message=message.format(count=len(faults), listed=first))


def _count_differences(pairs: pd.DataFrame) -> Iterator[str]:
    """For example "4 object-frames fewer in all_moving (12, were 16)"; the slices of everything first."""
    before, after = (_counts(pairs, side) for side in SIDES)
    whole = {ALL_MOVING: 0, FRAMES: 1}
    found = before.keys() | after.keys()
    for slice_name, unit in sorted(found, key=lambda key: (whole.get(key[0], 2), key[0], UNITS.index(key[1]))):
        was, now = before[slice_name, unit], after[slice_name, unit]
        if now != was:
            yield _difference(unit, slice_name, was, now)


def _counts(pairs: pd.DataFrame, side: str) -> Counter[tuple[str, str]]:
    """Numbers by slice and unit that the reference alone decides: objects by slice and by status, images by status."""
    counts: Counter[tuple[str, str]] = Counter()
    columns = [*SLICE, *(f"{term}{side}" for term in TERMS)]
    for breakdown, name, metric, above, below in pairs[columns].itertuples(index=False):
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


def _case_differences(changes: pd.DataFrame) -> Iterator[str]:
    for row in _records(changes[(changes["side"] == "both") & ~changes["same_cases"]]):
        metric, called, was, now = row["metric"], row["slice_name"], row["cases_before"], row["cases_after"]
        if find_metric(metric).cases_by_method:
            continue
        if was == now:
            yield f"{metric} of {called}: {was} cases, spread otherwise over the recordings"
        else:
            yield f"{metric}: {_difference('cases', called, was, now)}"


def _missing(changes: pd.DataFrame) -> Iterator[str]:
    for row in _records(changes[changes["side"] == "left_only"]):
        yield f"{row['metric']} of {row['slice_name']}"


def _records(changes: pd.DataFrame) -> list[dict[Any, Any]]:
    return changes.reset_index().to_dict("records")


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
    pairs = pair_sums(baseline.sums, run.sums)
    compared = compare_pairs(pairs)
    return Verdict(
        baseline=baseline.manifest,
        run=run.manifest,
        tolerances=f"{tolerances.name} version {tolerances.version}",
        changes=changes(baseline.manifest, run.manifest),
        checks=data_checks(baseline, run, pairs, compared, tolerances=tolerances),
        rows=judge_changes(compared, tolerances=tolerances, worst=worst_recordings(pairs)),
    )


def worst_recordings(pairs: pd.DataFrame) -> dict[Any, tuple[RecordingChange, ...]]:
    """The recordings whose own worsening weighs most, the worst first, by breakdown, slice and metric.

    Args:
        pairs: sums of both runs, as `pair_sums` gives them.
    """
    found = improvements_by_recording(pairs)
    worst: dict[Any, tuple[RecordingChange, ...]] = {}
    for row in found[found["improvement"] < 0].groupby(SLICE).head(WORST).to_dict("records"):
        change = RecordingChange(name=row["recording"], before=row["before"], after=row["after"])
        worst[_key(row)] = (*worst.get(_key(row), ()), change)
    return worst


def judge_changes(
    changes: pd.DataFrame, *, tolerances: Tolerances, worst: Mapping[Any, tuple[RecordingChange, ...]]
) -> tuple[Row, ...]:
    """Judge every row of a comparison; of those that decide, the chance that one is worse by chance alone counts.

    Args:
        changes: as `compare_pairs` gives them.
        tolerances: the rules.
        worst: as `worst_recordings` gives them; a row that is not there got worse in none.
    """
    rows = [_with_rule(row, tolerances) for row in _records(changes)]
    for row, p_holm in zip(rows, holm([row["p_of_loss"] for row in rows]), strict=True):
        row["p_holm"], row["worst_recordings"] = p_holm, worst.get(_key(row), ())
        row["outcome"], row["reason"] = _judge_row(row, tolerances)
    return tuple(Row(**{field.name: row[field.name] for field in fields(Row)}) for row in rows)


def _key(row: Mapping[Any, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in SLICE)


def _with_rule(row: dict[Any, Any], tolerances: Tolerances) -> dict[Any, Any]:
    """A row of a comparison with what is tolerated, why it is not judged, and, if it decides, its p-value of a loss."""
    rule = tolerances.tolerance(row["slice_name"], row["metric"])
    reason = _why_not_judged(row, tolerances) if rule else "no tolerance is stated"
    return row | {
        "worsening": -row["improvement"],
        "allowed": rule.allowed(row["before"]) if rule else math.nan,
        "reason": reason,
        "p_of_loss": _p_of_loss(row) if rule and rule.decides and not reason else None,
    }


def _p_of_loss(row: Mapping[Any, Any]) -> float | None:
    """One-sided: of no loss against a loss, since no gain fails."""
    p_value: float | None = row["p_value"]
    if p_value is None:
        return None
    return p_value / 2 if row["improvement"] < 0 else 1 - p_value / 2


def _judge_row(row: Mapping[Any, Any], tolerances: Tolerances) -> tuple[Outcome, str]:
    """The outcome of a row that has a rule, and its reason where there is one."""
    if row["reason"]:
        return Outcome.NOT_JUDGED, row["reason"]
    if row["worsening"] > row["allowed"] + ROUNDING:
        reason = _why_suspect(row)
        certain = not reason or (row["p_holm"] is not None and tolerances.suspect == "fail")
        return (Outcome.FAILED if certain else Outcome.SUSPECT), reason
    improved = row["worsening"] < -row["allowed"] - ROUNDING and excludes_no_change(row["ci95"])
    return (Outcome.IMPROVED if improved else Outcome.PASSED), ""


def judgeable(run: RunSums, *, tolerances: Tolerances) -> tuple[str, str]:
    """Count what a run can judge as a baseline: "67 of 238 metrics can be judged", and why none; "" for some."""
    rows = judge(run, run, tolerances=tolerances).rows
    judged = sum(row.outcome is not Outcome.NOT_JUDGED for row in rows)
    counted = f"{judged} of {len(rows)} metrics can be judged"
    if judged:
        return counted, ""
    recordings = max((row.recordings for row in rows), default=0)
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


def _why_suspect(row: Mapping[Any, Any]) -> str:
    """Reason that a loss beyond what is tolerated may be chance, or decides nothing; "" where it is neither."""
    p_holm = row["p_holm"]
    if not excludes_no_change(row["ci95"]):
        return "worse than tolerated, but the interval includes no change"
    if p_holm is None:
        return "worse than tolerated, but this row decides nothing"
    chance = f"worse than tolerated, but among so many metrics it may be chance: p = {p_holm:.2f}, corrected after Holm"
    return "" if p_holm <= SIGNIFICANCE else chance


def _why_not_judged(row: Mapping[Any, Any], tolerances: Tolerances) -> str:
    """Reason that a metric with a rule cannot be judged; "" when it can."""
    if not row["cases_before"] and row["cases_after"]:
        return "not in the baseline"
    unit = "frames" if find_metric(row["metric"]).over == IMAGE_FRAMES else "cases"  # cases of some are pixels
    cases, recordings = min(row[f"{unit}{side}"] for side in SIDES), row["recordings"]
    if cases < tolerances.min_cases:
        return f"{cases} {'case' if cases == 1 else 'cases'}, {tolerances.min_cases} are needed"
    if recordings < tolerances.min_recordings:
        unit = "recording" if recordings == 1 else "recordings"
        return f"cases of both in {recordings} {unit}, {tolerances.min_recordings} are needed"
    return ""

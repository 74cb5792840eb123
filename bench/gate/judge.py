"""Verdict on a run by baseline and tolerances: a pure function, a layer on the comparison of their sums.

Two tables: the sums of both runs side by side (`pair_sums`), a row for each slice, recording and metric, and their
comparison (`compare_pairs`), a row for each slice and metric, to which the tolerances are joined.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import pandas as pd

from bench.errors import UsageError
from bench.evaluation.comparison import (
    SIDES,
    SIGNIFICANCE,
    SLICE,
    compare_pairs,
    excludes_no_change,
    holm,
    improvements_by_recording,
    pair_sums,
)
from bench.evaluation.definitions import COUNTS, IMAGE_FRAMES, find_metric
from bench.evaluation.intervals import ROUNDING
from bench.evaluation.sums import ALL_MOVING, FRAMES, TERMS, name_slice
from bench.gate.baseline import RunSums
from bench.gate.tolerances import Tolerances, void_rules
from bench.gate.verdict import Check, Outcome, RecordingChange, Row, Verdict, changes
from bench.harness.manifest import Aspect, Difference, differences
from bench.plain_text import counted, listed

LISTED = 5  # differences that a message lists, of a reference its digest and four numbers
WORST = 3  # recordings that are named

# References of data that each machine renders anew: another processor may tip the last bit of a few points or pixels.
PIXELS = 0.001  # share of a recording's reference pixels that may differ
REBINNED = 0.01  # share of all object-frames that may lie in another bin
BINNED = ("points", "range_m", "speed_mps", "class_and_speed", "ego_speed_mps")  # breakdowns by what is measured

STATUS = "status"  # the breakdown of all annotated objects and all images
_UNITS = {  # of counts, and the term that holds each
    "tracks": (("object-frames", TERMS[1]), ("tracks", TERMS[0])),
    "annotated": (("annotated objects", TERMS[0]),),
    "images": (("images", TERMS[0]),),
}


def judge(baseline: RunSums, run: RunSums, *, tolerances: Tolerances) -> Verdict:
    """Judge a run.

    Args:
        baseline: what it is judged by.
        run: the newer one.
        tolerances: the rules.

    Raises:
        UsageError: another data set, split or protocol.
    """
    found = differences(baseline.manifest, run.manifest)
    for difference in found:
        if not difference.comparable:
            raise UsageError(
                f"the baseline is of {difference.aspect} {difference.before}, the run of {difference.after}: they do "
                "not compare; score as the baseline was, name another with --baseline, or replace it with --update"
            )
    pairs = pair_sums(baseline.sums, run.sums)
    rows = judge_changes(compare_pairs(pairs), tolerances=tolerances, worst=worst_recordings(pairs))
    void = void_rules(tolerances, ((row.slice_name, row.metric) for row in rows))
    notes = {"annotations": run.unreviewed, "tolerances": f"rules of no row: {listed(void)}" if void else ""}
    noted = [Check(name=name, outcome=Outcome.SUSPECT, message=text) for name, text in notes.items() if text]
    return Verdict(
        baseline=baseline.manifest,
        run=run.manifest,
        tolerances=tolerances.title,
        changes=changes(found),
        checks=(*data_checks(run, found, pairs, rendered=tolerances.changed_data == "report"), *noted),
        rows=rows,
    )


def data_checks(
    run: RunSums, found: Sequence[Difference], pairs: pd.DataFrame, *, rendered: bool
) -> tuple[Check, Check, Check]:
    """Check that run and baseline measured the same things: failures, data and reference, as cause and effect.

    Args:
        run: the newer one.
        found: in what its manifest differs from that of the baseline.
        pairs: sums of both, as `pair_sums` gives them.
        rendered: other data are only reported, and a reference that differs as little as between two processors.
    """
    data, digests = (
        [difference.text for difference in found if difference.aspect is aspect]
        for aspect in (Aspect.DATA, Aspect.REFERENCE)
    )
    small = small_difference(pairs) if rendered and data and digests else ""
    reference = [small] if small else [*digests, *reference_differences(pairs)]
    other_data = "data changed: other images, sweeps, labels, calibration or ego-motion; "
    return (
        _check("failures", run.failures, f"the run has {counted(len(run.failures), 'failure')}: "),
        _check("data", data, other_data, Outcome.SUSPECT if rendered else Outcome.FAILED),
        _check("reference", reference, "reference changed: ", Outcome.SUSPECT if small else Outcome.FAILED),
    )


def _check(name: str, faults: Sequence[str], lead: str, outcome: Outcome = Outcome.FAILED) -> Check:
    if not faults:
        return Check(name=name, outcome=Outcome.PASSED, message="as in the baseline")
    more = [f"and {len(faults) - LISTED} more"] if len(faults) > LISTED else []
    return Check(name=name, outcome=outcome, message=f"{lead}{'; '.join([*faults[:LISTED], *more])}")


def reference_differences(pairs: pd.DataFrame) -> list[str]:
    """For example "4 object-frames fewer in all_moving (12, were 16)"; the slices of everything first.

    Of the numbers that the reference alone decides: objects by slice and by status, images by status; where these are
    the same, cases of the metrics.

    Args:
        pairs: sums of both runs, as `pair_sums` gives them.
    """
    totals = pairs.groupby(SLICE)[[f"{term}{side}" for term in TERMS for side in SIDES]].sum().astype(int).reset_index()
    metric, of_status = totals["metric"], totals["breakdown"] == STATUS
    counted = (metric == "tracks") | (metric.isin(COUNTS) & of_status)
    of_all = of_status | (totals["breakdown"] == ALL_MOVING)
    metrics = map(find_metric, {*metric} - {*COUNTS})
    fixed = [m.name for m in metrics if m.higher_is_better is not None and not m.cases_by_method]
    counts = [*_differing(totals[counted & of_all]), *_differing(totals[counted & ~of_all])]
    return counts or [*_differing(totals[metric.isin(fixed)])]


def _differing(totals: pd.DataFrame) -> Iterator[str]:
    for row in totals.to_dict("records"):
        for unit, term in _UNITS.get(row["metric"], ((f"cases of {row['metric']}", TERMS[1]),)):
            was, now = (row[f"{term}{side}"] for side in SIDES)
            if was != now:
                more, where = "fewer" if now < was else "more", name_slice(row["breakdown"], row["slice"])
                yield f"{abs(now - was)} {unit} {more} in {where} ({now}, were {was})"


def small_difference(pairs: pd.DataFrame) -> str:
    """Tell in what two references differ; "" where it is more than another processor accounts for.

    They are the same but for that where they have the same objects and images of the same status, and differ in few
    pixels of each recording and in the bins of few object-frames. Then the metrics decide, not the digest.

    Args:
        pairs: sums of the baseline and of the run, as `pair_sums` gives them.
    """
    breakdown, metric = pairs["breakdown"], pairs["metric"]
    above, below = (abs(pairs[f"{term}_after"] - pairs[f"{term}_before"]) for term in TERMS)
    if (above + below)[metric.isin(COUNTS) & ~breakdown.isin(BINNED)].any():
        return ""
    pixels = (metric == "recall") & (breakdown == FRAMES)  # its cases are the pixels of the reference
    share = (below / pairs["denominator_before"])[pixels & (below > 0)].max()
    object_frames = pairs["denominator_before"][(metric == "tracks") & (breakdown == ALL_MOVING)].sum()
    rebinned = max(below[(metric == "tracks") & (breakdown == name)].sum() / 2 for name in BINNED)
    if share > PIXELS or rebinned > REBINNED * object_frames:
        return ""
    differing = f"{(below[pixels] > 0).sum()} of {pixels.sum()} recordings"
    return (
        f"as of data rendered on another processor: reference pixels differ in {differing}, by at most "
        f"{0 if pd.isna(share) else 100 * share:.2g} %, and {rebinned:.0f} of {object_frames:.0f} object-frames lie in "
        "another bin; the metrics decide"
    )


def worst_recordings(pairs: pd.DataFrame) -> dict[Any, tuple[RecordingChange, ...]]:
    """The recordings whose own worsening weighs most, the worst first, by breakdown, slice and metric.

    Args:
        pairs: sums of both runs, as `pair_sums` gives them.
    """
    found = improvements_by_recording(pairs)
    groups: Iterable[tuple[Any, pd.DataFrame]] = found[found["improvement"] < 0].groupby(SLICE)
    return {
        key: tuple(
            RecordingChange(recording=row["recording"], before=row["before"], after=row["after"])
            for row in part.head(WORST).to_dict("records")
        )
        for key, part in groups
    }


def judge_changes(
    changes: pd.DataFrame, *, tolerances: Tolerances, worst: Mapping[Any, tuple[RecordingChange, ...]]
) -> tuple[Row, ...]:
    """Judge every row of a comparison; of those that decide, the chance that one is worse by chance alone counts.

    Args:
        changes: as `compare_pairs` gives them.
        tolerances: the rules.
        worst: as `worst_recordings` gives them; a row that is not there got worse in none.
    """
    rows = [_with_rule(row, tolerances) for row in changes.reset_index().to_dict("records")]
    for row, p_holm in zip(rows, holm([row["p_of_loss"] for row in rows]), strict=True):
        row["p_holm"], row["worst_recordings"] = p_holm, worst.get(tuple(row[name] for name in SLICE), ())
        row["outcome"], row["reason"] = _judge_row(row, tolerances)
    return tuple(Row(**{field.name: row[field.name] for field in fields(Row)}) for row in rows)


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
    half = None if row["p_value"] is None else row["p_value"] / 2
    return half if half is None or row["improvement"] < 0 else 1 - half


def _judge_row(row: Mapping[Any, Any], tolerances: Tolerances) -> tuple[Outcome, str]:
    """The outcome of a row that has a rule, and its reason where there is one."""
    if row["reason"]:
        return Outcome.NOT_JUDGED, row["reason"]
    p_holm, beyond_chance = row["p_holm"], excludes_no_change(row["ci95"])
    worse = row["worsening"] > row["allowed"] + ROUNDING  # by exactly what is tolerated is tolerated
    if not worse:
        improved = row["worsening"] < -row["allowed"] - ROUNDING and beyond_chance
        return (Outcome.IMPROVED if improved else Outcome.PASSED), ""
    if not beyond_chance:
        reason = "worse than tolerated, but the interval includes no change"
    elif p_holm is None:
        reason = "worse than tolerated, but this row decides nothing"
    elif p_holm > SIGNIFICANCE:
        so_many = "worse than tolerated, but among so many metrics it may be chance"
        reason = f"{so_many}: p = {p_holm:.2f}, corrected for testing many metrics (Holm)"
    else:
        return Outcome.FAILED, ""
    strict = p_holm is not None and tolerances.suspect == "fail"
    return (Outcome.FAILED if strict else Outcome.SUSPECT), reason


def judgeable(run: RunSums, *, tolerances: Tolerances) -> str:
    """How much a run can judge as a baseline: "67 of 238 metrics can be judged", and why none of them."""
    rows = judge(run, run, tolerances=tolerances).rows
    judged = sum(row.outcome is not Outcome.NOT_JUDGED for row in rows)
    told = f"{judged} of {len(rows)} metrics can be judged"
    if judged or not rows:
        return told
    return f"{told}: {max(rows, key=lambda row: (row.allowed >= 0, row.cases_before)).reason}"


def _why_not_judged(row: Mapping[Any, Any], tolerances: Tolerances) -> str:
    """Reason that a metric with a rule cannot be judged; "" when it can."""
    if not row["cases_before"] and row["cases_after"]:
        return "not in the baseline"
    unit = "frames" if find_metric(row["metric"]).over == IMAGE_FRAMES else "cases"  # cases of some are pixels
    cases, recordings = min(row[f"{unit}{side}"] for side in SIDES), row["recordings"]
    if cases < tolerances.min_cases:
        return f"{counted(cases, 'case')}, {tolerances.min_cases} are needed"
    if recordings < tolerances.min_recordings:
        return f"cases of both in {counted(recordings, 'recording')}, {tolerances.min_recordings} are needed"
    return ""

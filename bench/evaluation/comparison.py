"""Changes between two runs over the same data: metrics from two tables of sums, and object-frames from their rows.

Whole recordings are left out, the same before and after, so that what makes a recording hard cancels out. The command
`compare` shows the table of `compare_sums`, and the gate joins its tolerances to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from bench.evaluation.definitions import COUNTS, EVERY_ROW, coverage, detected, find_metric, intersection_over_union
from bench.evaluation.intervals import (
    CONFIDENCE,
    FEWEST_RECORDINGS,
    RATIO_CHANGE,
    ROUNDING,
    Jackknife,
    ValueBounds,
    jackknife,
    ratio_without_each,
)
from bench.evaluation.rows import OBJECT, merge_rows, sort_rows
from bench.evaluation.sums import KEY, TERMS, name_slice

SIGNIFICANCE = 0.05  # of p-values corrected after Holm
SLICE = ["breakdown", "slice", "metric"]
SIDES = ("_before", "_after")
CASES = [f"denominator{side}" for side in SIDES]


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedChange:
    """Change of a metric from one run to another over the same recordings.

    Attributes:
        before: value, NaN without cases.
        after: value, NaN without cases.
        difference: after minus before.
        ci95: 95 % interval of the difference by recording; None where fewer than six of them hold cases in both runs,
            and where none of them differs.
        p_value: two-sided, of no change; None where fewer than six recordings hold cases in both runs.
        cases_before: of `before`.
        cases_after: of `after`.
        recordings: with cases in both runs.
    """

    before: float
    after: float
    difference: float
    ci95: tuple[float, float] | None
    p_value: float | None
    cases_before: int
    cases_after: int
    recordings: int


def compare_sums(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Compare every metric that has a direction, in every slice that either run has.

    Args:
        before: table of sums of the one run.
        after: table of sums of the other.

    Returns:
        One row for each breakdown, slice and metric, which are its index, as `compare_pairs` gives them.
    """
    return compare_pairs(pair_sums(before, after))


def pair_sums(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Set the sums of two runs side by side.

    Returns:
        Columns `KEY`, and `TERMS` with the suffixes "_before" and "_after", 0 where a run has no such row.
    """
    sides = [side[[*KEY, *TERMS]].astype(dict.fromkeys(KEY, object)) for side in (before, after)]
    pairs = sides[0].merge(sides[1], on=KEY, how="outer", suffixes=SIDES)
    return pairs.fillna(dict.fromkeys([f"{term}{side}" for term in TERMS for side in SIDES], 0.0))


def compare_pairs(pairs: pd.DataFrame) -> pd.DataFrame:
    """Compare every metric that has a direction, from the sums of two runs side by side.

    Args:
        pairs: as `pair_sums` gives them.

    Returns:
        One row for each breakdown, slice and metric, which are its index: the fields of `PairedChange`, `ci95` and
        `p_value` None where there is none, and
        `slice_name`: of the slice among all, as `name_slice` gives it;
        `improvement`: the difference in the metric's direction, negative for worse;
        `frames_before`, `frames_after`: object-frames of the slice, image-frames for a metric of these.
    """
    groups: Iterable[tuple[Any, pd.DataFrame]] = _with_direction(pairs).groupby(SLICE, sort=False)
    rows = []
    for key, part in groups:
        metric = find_metric(key[2])
        change = paired_change(part, within=metric.change_bounds)
        rows.append(
            dict(zip(SLICE, key, strict=True))
            | asdict(change)
            | {"slice_name": name_slice(*key[:2]), "improvement": metric.improvement(change.difference)}
        )
    fields = [*SLICE, *PairedChange.__slots__, "slice_name", "improvement"]
    kinds: dict[str, Any] = dict.fromkeys(("before", "after", "difference", "improvement"), np.float64)
    kinds |= dict.fromkeys(("cases_before", "cases_after", "recordings"), np.int64)
    table = pd.DataFrame(rows, columns=fields, dtype=object).set_index(SLICE).astype(kinds)
    every_row = [(*of, EVERY_ROW[find_metric(metric).over]) for *of, metric in table.index]
    for side in SIDES:
        frames = table[f"cases{side}"].reindex(pd.MultiIndex.from_tuples(every_row, names=SLICE)).to_numpy()
        table[f"frames{side}"] = np.where(np.isnan(frames), table[f"cases{side}"], frames).astype(np.int64)
    return table


def _with_direction(pairs: pd.DataFrame) -> pd.DataFrame:
    names = {*pairs["metric"]} - {*COUNTS}
    return pairs[pairs["metric"].isin([name for name in names if find_metric(name).higher_is_better is not None])]


def excludes_no_change(ci95: tuple[float, float] | None) -> bool:
    """Tell whether the interval of a change excludes that there is none; False without an interval."""
    return ci95 is not None and not ci95[0] <= 0 <= ci95[1]


def improvements_by_recording(pairs: pd.DataFrame) -> pd.DataFrame:
    """Give what each recording with cases in both runs adds to a change.

    Args:
        pairs: as `pair_sums` gives them.

    Returns:
        Columns `SLICE`, `recording`, `before` and `after`, the metric in that recording, and `improvement`, times the
        cases that it had before; the worst first, of metrics that have a direction.
    """
    directed = _with_direction(pairs)
    shared = directed[(directed[CASES] > 0).all(axis=1)]
    before, after = (shared[f"numerator{side}"] / shared[f"denominator{side}"] for side in SIDES)
    gains = shared["metric"].map({name: find_metric(name).improvement(1.0) for name in shared["metric"].unique()})
    gained = shared.assign(before=before, after=after, improvement=gains * (after - before) * shared[CASES[0]])
    found = gained[[*SLICE, "recording", "before", "after", "improvement"]]
    return found.sort_values(["improvement", "recording"], ignore_index=True)


def paired_change(pairs: pd.DataFrame, *, within: ValueBounds = RATIO_CHANGE) -> PairedChange:
    """Compare a metric of one slice of two runs over the same data.

    The difference is taken again without each recording with cases in either run, so that what makes a recording hard
    for both cancels out; interval and p-value follow as `bench.evaluation.intervals` says. Between runs that differ by
    chance alone, p fell below 0.05 in 1.5 % of simulated pairs over 6 recordings of unequal size, 1.8 % over 10, 2.6 %
    over 20 and 4.3 % over 100. Where three recordings in ten improve and the others stay, the interval held the true
    change in 92, 89, 90 and 94 % of the pairs: what few recordings show, few may have missed.

    Where all n recordings change by the same, there is no spread to go by. Then the interval is that of n + 1
    recordings of which one does not change, and the p-value that of the sign test, 2 / 2^n.

    Args:
        pairs: a row for each recording, as `pair_sums` gives them; those without cases in either run are left out.
        within: possible differences.
    """
    old, new = ([pairs[f"{term}{side}"].to_numpy(np.float64) for term in TERMS] for side in SIDES)
    held, shared = (old[1] > 0) | (new[1] > 0), int(np.count_nonzero((old[1] > 0) & (new[1] > 0)))
    old, new = ([term[held] for term in side] for side in (old, new))
    (before, old_without), (after, new_without) = (ratio_without_each(*side) for side in (old, new))
    difference = after - before
    if abs(difference) <= ROUNDING:  # of sums in which the same terms stand in another order
        difference = 0.0
    ci95, p_value = None, None
    if shared >= FEWEST_RECORDINGS:
        shares = (old[1] / old[1].sum() + new[1] / new[1].sum()) / 2
        found = jackknife(difference, new_without - old_without, shares=shares)
        ci95 = found.interval(within) if found.standard_error else _interval_of_equal_changes(found, within)
        p_value = found.p_value(within)
    return PairedChange(
        before=before,
        after=after,
        difference=difference,
        ci95=ci95,
        p_value=p_value,
        cases_before=int(old[1].sum()),
        cases_after=int(new[1].sum()),
        recordings=shared,
    )


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Correct p-values for being several; None, which is no test, stays None and is not counted.

    Source:
        Holm 1979, A simple sequentially rejective multiple test procedure.
    """
    tests = sorted((p, index) for index, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    largest = 0.0
    for rank, (p, index) in enumerate(tests):
        largest = max(largest, min(1.0, (len(tests) - rank) * p))
        corrected[index] = largest
    return corrected


def _interval_of_equal_changes(change: Jackknife, within: ValueBounds) -> tuple[float, float] | None:
    """The interval of a change that is the same in all recordings, as if one more had none; None for no change."""
    if change.value == 0:
        return None
    limit = float(stdtrit(change.recordings, (1 + CONFIDENCE) / 2))
    ends = (change.value * (change.recordings + side * limit) / (change.recordings + 1) for side in (-1, 1))
    low, high = sorted(ends)
    return max(low, within.least), min(high, within.most)


_OF_OBJECT = ["object_class", "category", "range_m", "region_px"]
_MEASURED: dict[str, Callable[[pd.DataFrame], Any]] = {
    "detected": detected,
    "coverage": coverage,
    "iou": intersection_over_union,
}
CHANGES = [*OBJECT, *_OF_OBJECT, "change", *(f"{name}{side}" for name in _MEASURED for side in SIDES)]
COMPARED = [*OBJECT, *_OF_OBJECT, "tp", "fn", "fp"]


def object_changes(before: pd.DataFrame, after: pd.DataFrame, *, level: float = 0.0) -> pd.DataFrame:
    """Set the object-frames that both of two runs evaluated side by side.

    Args:
        before: evaluated rows of `OBJECTS_SCHEMA`, at least the columns `COMPARED`.
        after: the same of the other run.
        level: coverage from which on an object counts as detected; 0 for any pixel.

    Returns:
        Columns `CHANGES`, a row for each object-frame, by recording, camera, time and track. `change` is "gained" or
        "lost" (the detection), "both" or "neither".
    """
    rows = merge_rows(*(_measured(side, level) for side in (before, after)), on=OBJECT)
    was, is_now = rows["detected_before"], rows["detected_after"]
    change = np.select([~was & is_now, was & ~is_now, was & is_now], ["gained", "lost", "both"], "neither")
    same = {name: rows[f"{name}_before"] for name in _OF_OBJECT}
    return sort_rows(rows.assign(change=change, **same)[CHANGES], OBJECT)


def _measured(objects: pd.DataFrame, level: float) -> pd.DataFrame:
    rows = objects.assign(**_MEASURED)[[*OBJECT, *_OF_OBJECT, *_MEASURED]]
    return rows.assign(detected=rows["detected"] & (rows["coverage"] >= level))

"""The figures of one row of the paper's table, over evaluated object-frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.ratios import Cases, Rows
from bench.evaluation.summary import Figure, ObjectFigures

Column = NDArray[np.float64]


def object_figures(cases: Cases, *, levels: tuple[float, ...], where: Rows) -> ObjectFigures:
    """Take the figures of a slice.

    Args:
        cases: the evaluated object-frames.
        levels: detection levels of the protocol.
        where: (N,) bool, the slice.

    Source:
        Mariotti and Eising 2020, section IV: detection rate, and TPR over the detected object-frames.
    """
    tp, fp, fn, chance_tp = (cases.column(name) for name in ("tp", "fp", "fn", "chance_tp"))
    seen, chance_seen = detected(tp), detected(chance_tp)
    with_chance = ~np.isnan(chance_tp)
    reached = _at_levels(coverage(tp, fn), levels)
    chance_reached = _at_levels(chance_tp / (tp + fn), levels)
    return ObjectFigures(
        object_frames=int(np.count_nonzero(where)),
        tracks=len(cases.rows.loc[where, ["recording", "track_id"]].drop_duplicates()),
        recordings=cases.rows.loc[where, "recording"].nunique(),
        detection_rate=cases.ratio(seen, where=where),
        chance=cases.ratio(chance_seen, over=with_chance, where=where),
        tpr=cases.ratio(coverage(tp, fn), over=seen, where=where),
        tpr_all=cases.ratio(coverage(tp, fn), where=where),
        iou=cases.ratio(intersection_over_union(tp, fp, fn), where=where),
        iou_detected=cases.ratio(intersection_over_union(tp, fp, fn), over=seen, where=where),
        **_by_level("detection_rate", {percent: cases.ratio(hit, where=where) for percent, hit in reached.items()}),
        **_by_level(
            "chance",
            {percent: cases.ratio(hit, over=with_chance, where=where) for percent, hit in chance_reached.items()},
        ),
    )


def detected(tp: Column) -> Rows:
    """Any pixel of the object; False where `tp` is NaN."""
    return tp > 0


def coverage(tp: Column, fn: Column) -> Column:
    """Share of the object that is detected: TP / (TP + FN)."""
    return tp / (tp + fn)


def intersection_over_union(tp: Column, fp: Column, fn: Column) -> Column:
    """TP / (TP + FP + FN)."""
    return tp / (tp + fp + fn)


def _at_levels(covered: Column, levels: tuple[float, ...]) -> dict[str, Rows]:
    return {f"{100 * level:g}": covered >= level for level in levels}


def _by_level(name: str, figures: dict[str, Figure]) -> dict[str, Figure]:
    return {f"{name}_{percent}": figure for percent, figure in figures.items()}

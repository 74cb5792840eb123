"""From the tables of an audit to its metrics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pyarrow as pa

from bench.audit.causes import FalseCause, MissCause
from bench.audit.polygons import FIT, Compensation
from bench.audit.results import (
    ALL,
    Aim,
    FalseAlarmFigures,
    MissFigures,
    PolygonFigures,
    Quartiles,
    Scores,
)
from bench.evaluation import Protocol, summarise
from bench.evaluation.sums import bin_names, name_bins
from bench.reference import REGION_KINDS

PAPER_RANGE_M = 8.0
# Least median IoU of a polygon that is meant to follow the outline; the paper's convex hull is not.
AIMS = {"vehicle": 0.90, "pedestrian": 0.85, "cyclist": 0.85}


def polygon_figures(polygons: pa.Table, *, protocol: Protocol, kinds: tuple[str, ...]) -> tuple[PolygonFigures, ...]:
    """Quartiles of every kind and compensation, by class and range and by class and the object's own speed.

    Slices without object-frames are left out.
    """
    rows, bins = polygons.to_pandas(), protocol.bins
    edges = {"range_m": bins.range_m, "speed_mps": bins.speed_mps}
    binned = rows.assign(**{name: name_bins(rows[name], own) for name, own in edges.items()})
    slices = [
        {"object_class": of_class} | dict.fromkeys(edges, ALL) | cut
        for of_class in (ALL, *protocol.reference.classes)
        for cut in ({}, *({name: one} for name, own in edges.items() for one in bin_names(own)))
    ]
    wanted = [
        {"kind": kind, "compensation": way.value} | cut for kind in kinds for way in Compensation for cut in slices
    ]
    parts = [(cut, _chosen(binned, cut)) for cut in wanted]
    return tuple(
        PolygonFigures(**cut, object_frames=len(part), **{name: quartiles(part[name]) for name in FIT})
        for cut, part in parts
        if len(part)
    )


def aims(polygons: pa.Table, *, kinds: tuple[str, ...]) -> tuple[Aim, ...]:
    """The aim of every class, for every kind that follows the outline."""
    rows = polygons.to_pandas()
    rows = rows[(rows["compensation"] == Compensation.FULL.value) & (rows["range_m"] <= PAPER_RANGE_M)]
    return tuple(
        _aim(rows[(rows["kind"] == kind) & (rows["object_class"] == name)], kind, name, expected)
        for kind in kinds
        if REGION_KINDS[kind].follows_outline
        for name, expected in AIMS.items()
    )


def scores(objects: pa.Table, frames: pa.Table, *, protocol: Protocol) -> Scores:
    """The evaluation's own metrics of one scoring."""
    found = summarise(objects, frames, protocol=protocol)
    return Scores(
        categories=found.categories,
        speeds=found.breakdowns["speed_mps"],
        all_moving=found.all_moving,
        false_positives=found.false_positives,
    )


def miss_figures(misses: pa.Table, *, protocol: Protocol) -> tuple[MissFigures, ...]:
    """Cells by cause, of every kind of motion and of all."""
    rows = misses.to_pandas()
    names = [category.value for category in protocol.reference.categories]
    parts = {name: rows[rows["category"] == name] for name in names} | {ALL: rows}
    return tuple(
        MissFigures(
            category=name,
            object_frames=len(part),
            cells=int(part["cells"].sum()),
            hit=int(part["hit"].sum()),
            hit_by_error=int(part["hit_by_error"].sum()),
            causes={cause.value: int(part[cause.value].sum()) for cause in MissCause},
            flow_error_px=quartiles(part["flow_error_px"]),
        )
        for name, part in parts.items()
    )


def false_alarm_figures(false_alarms: pa.Table) -> FalseAlarmFigures:
    """Cells of the static world by cause."""
    rows = false_alarms.to_pandas()
    return FalseAlarmFigures(
        images=len(rows),
        cells=int(rows["cells"].sum()),
        flagged=int(rows["flagged"].sum()),
        causes={cause.value: int(rows[cause.value].sum()) for cause in FalseCause},
        flow_error_px=quartiles(rows["flow_error_px"]),
    )


def quartiles(values: pd.Series[float]) -> Quartiles:
    """Quartiles of the values that are not NaN."""
    known = values.dropna().to_numpy(dtype=np.float64)
    low, median, high = np.quantile(known, [0.25, 0.5, 0.75]).tolist() if len(known) else (np.nan,) * 3
    return Quartiles(low=low, median=median, high=high)


def _chosen(rows: pd.DataFrame, wanted: Mapping[str, str]) -> pd.DataFrame:
    """Rows of a slice: every column as it says, unless that is `ALL`."""
    chosen = pd.Series(True, rows.index)
    for column, name in wanted.items():
        if name != ALL:
            chosen &= rows[column] == name
    return rows[chosen]


def _aim(rows: pd.DataFrame, kind: str, object_class: str, expected: float) -> Aim:
    median = quartiles(rows["iou"]).median
    return Aim(
        kind=kind,
        object_class=object_class,
        within_m=PAPER_RANGE_M,
        object_frames=len(rows),
        median_iou=median,
        median_filled_iou=quartiles(rows["filled_iou"]).median,
        expected=expected,
        met=median >= expected if len(rows) else None,
    )

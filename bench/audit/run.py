"""A whole audit: data set, method and protocol in, tables and metrics out.

```
<audit>/audit.json                 the metrics
<audit>/polygons.parquet           one row per object-frame, kind of polygon and compensation
<audit>/objects.parquet            one row per object-frame and scoring, integer counts
<audit>/frames.parquet             one row per image and scoring, integer counts
<audit>/misses.parquet             one row per object-frame: cells of its exact mask by cause
<audit>/false_alarms.parquet       one row per image: static cells by cause
```
"""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from bench.atomic import write_text
from bench.audit.causes import EXPLAINED, FalseCause, MissCause
from bench.audit.polygons import FIT, Compensation
from bench.audit.recording import RecordingAudit, audit_recording
from bench.audit.sources import AuditModel, StoredAudit, audit_each
from bench.evaluation import Protocol, Summary, summarise
from bench.evaluation.summary import ProtocolOfRun, Ratio
from bench.evaluation.sums import bin_names, name_bins
from bench.execution import SerialExecutor, TaskExecutor
from bench.harness.answers import write_table
from bench.harness.manifest import MethodOfRun
from bench.harness.stages import Progress
from bench.methods import FlowMethod, Method
from bench.recordings import DatasetCard
from bench.reference import REGION_KINDS

AUDIT = "audit.json"
ALL = "all"
STATIC = "static"


class Quartiles(AuditModel):
    """The quarter, half and three quarters of the values lie below; NaN, null in JSON, without values."""

    low: Ratio
    median: Ratio
    high: Ratio

    @classmethod
    def of(cls, values: pd.Series[float]) -> Quartiles:
        """Quartiles of the values that are not NaN."""
        known = values.dropna().to_numpy(dtype=np.float64)
        low, median, high = np.quantile(known, [0.25, 0.5, 0.75]).tolist() if len(known) else (np.nan,) * 3
        return cls(low=low, median=median, high=high)


class PolygonFigures(AuditModel):
    """Fit of the polygons of one slice.

    Attributes:
        kind: of polygon.
        compensation: of the motion between lidar and camera.
        object_class: or "all".
        range_m: bin, or "all".
        object_frames: how many.
        fit: the measures of `RegionFit`.
    """

    kind: str
    compensation: str
    object_class: str
    range_m: str
    object_frames: int
    fit: dict[str, Quartiles]


class CauseFigures(AuditModel):
    """Cells that show one kind of motion, on the exact masks, or the static world.

    Attributes:
        category: kind of motion, "all" of them, or "static".
        frames: evaluated object-frames that fill a cell; images of the static world.
        cells: of them, in V.
        causes: cells that are missed, by `MissCause`; of the static world those that are flagged, by `FalseCause`.
        hit_by_error: cells that are found where the exact flow fires nothing, through an error of flow or ego-motion;
            0 of the static world.
        flow_error_px: median flow error on the visible cells of each of the frames, px.
    """

    category: str
    frames: int
    cells: int
    causes: dict[str, int]
    hit_by_error: int
    flow_error_px: Quartiles

    @property
    def wrong(self) -> int:
        """Cells that are missed; of the static world, that are flagged."""
        return sum(self.causes.values())


class AuditSummary(StoredAudit):
    """`audit.json`.

    Attributes:
        method: whose detections are scored.
        protocol: that says which object-frames count.
        polygon_kinds: the protocol's own first.
        polygons: by kind, compensation, class and range.
        not_seen: evaluated object-frames of which the camera sees no pixel; they are in none of the metrics.
        scores: the evaluation's metrics by `Scoring`.
        misses: by kind of motion, then "all"; empty without exact flow.
        false_alarms: None without exact flow.
        left_out: why there is no exact flow; empty where there is.
    """

    method: MethodOfRun
    protocol: ProtocolOfRun
    polygon_kinds: tuple[str, ...]
    polygons: tuple[PolygonFigures, ...]
    not_seen: int
    scores: dict[str, Summary]
    misses: tuple[CauseFigures, ...]
    false_alarms: CauseFigures | None
    left_out: str


def polygon_figures(rows: pd.DataFrame, *, protocol: Protocol, kinds: tuple[str, ...]) -> tuple[PolygonFigures, ...]:
    """Quartiles of every kind and compensation, by class and range; slices without object-frames are left out."""
    edges = protocol.bins.range_m
    binned = rows.assign(range_m=name_bins(rows["range_m"], edges))
    classes, ranges = (ALL, *protocol.reference.classes), (ALL, *bin_names(edges))
    figures = []
    for kind, way, object_class, range_m in product(kinds, Compensation, classes, ranges):
        wanted = {"kind": kind, "compensation": way.value, "object_class": object_class, "range_m": range_m}
        part = binned[np.all([binned[column] == name for column, name in wanted.items() if name != ALL], axis=0)]
        if len(part):
            fit = {name: Quartiles.of(part[name]) for name in FIT}
            figures.append(PolygonFigures(**wanted, object_frames=len(part), fit=fit))
    return tuple(figures)


def scores(audit: RecordingAudit, *, protocol: Protocol) -> dict[str, Summary]:
    """The evaluation's own metrics, by `Scoring`."""

    def scored(table: str, name: str) -> pa.Table:
        return audit.tables[table].filter(pc.field("scoring") == name).drop_columns("scoring")

    names = audit.tables["frames"]["scoring"].unique().to_pylist()
    return {name: summarise(scored("objects", name), scored("frames", name), protocol=protocol) for name in names}


def cause_figures(category: str, rows: pd.DataFrame, causes: type[StrEnum]) -> CauseFigures:
    """Cells by cause, of rows of `MISSES_SCHEMA` or `FALSE_ALARMS_SCHEMA`."""
    return CauseFigures(
        category=category,
        frames=len(rows),
        cells=int(rows["cells"].sum()),
        causes={cause.value: int(rows[cause.value].sum()) for cause in causes},
        hit_by_error=int(rows["hit_by_error"].sum()) if "hit_by_error" in rows else 0,
        flow_error_px=Quartiles.of(rows["flow_error_px"]),
    )


def run_audit(
    card: DatasetCard,
    *,
    method: Method,
    protocol: Protocol,
    out: Path,
    split: str | None = None,
    recordings: int | None = None,
    executor: TaskExecutor = SerialExecutor(),  # noqa: B008 - it holds nothing
    progress: Progress | None = None,
) -> tuple[AuditSummary, RecordingAudit]:
    """Audit a rendered data set and store what comes out; nothing is stored before the last recording is done.

    Args:
        card: the data set.
        method: whose detections are scored and explained.
        protocol: the rules.
        out: folder of the audit.
        split: of the data set; None for all of it.
        recordings: how many of them; None for all.
        executor: audits the recordings; the result does not depend on it.
        progress: called with the recordings done and their number.

    Returns:
        The metrics, and the tables behind them; both are stored, too.

    Raises:
        DataError: nothing of the data set could be audited, above all where it has no rendered masks.
    """
    audits, stored = audit_each(
        partial(audit_recording, method=method, protocol=protocol),
        card=card,
        split=split,
        recordings=recordings,
        executor=executor,
        progress=progress,
    )
    audit = RecordingAudit.joined(audits)
    polygons, misses, static = (audit.tables[name].to_pandas() for name in ("polygons", "misses", "false_alarms"))
    own = protocol.reference_settings().polygon_kind
    kinds = (own, *(kind for kind in REGION_KINDS if kind != own))
    categories = [category.value for category in protocol.reference.categories]
    by_category = {name: misses[misses["category"] == name] for name in categories} | {ALL: misses}
    explained = len(static) > 0
    summary = AuditSummary(
        **dict(stored),
        method=MethodOfRun.of(method),
        protocol=ProtocolOfRun(name=protocol.name, version=protocol.version, digest=protocol.digest),
        polygon_kinds=kinds,
        polygons=polygon_figures(polygons, protocol=protocol, kinds=kinds),
        not_seen=audit.not_seen,
        scores=scores(audit, protocol=protocol),
        misses=tuple(cause_figures(*part, MissCause) for part in by_category.items()) if explained else (),
        false_alarms=cause_figures(STATIC, static, FalseCause) if explained else None,
        left_out="" if explained else _left_out(card, method),
    )
    for name, table in audit.tables.items():
        write_table(out / f"{name}.parquet", table)
    write_text(out / AUDIT, summary.model_dump_json(indent=1) + "\n")
    return summary, audit


def _left_out(card: DatasetCard, method: Method) -> str:
    """Reason that nothing is explained by exact flow."""
    if not isinstance(method, FlowMethod):
        return f"the method {method.name!r} does not take flow from outside, {EXPLAINED}"
    if card.scenario is None:
        return "the data set's card names no scenario, so there is no exact flow"
    return "the scene of no recording could be simulated again; see the failures"

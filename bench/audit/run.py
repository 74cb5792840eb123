"""A whole audit: data set, method and protocol in, each recording by itself, tables and metrics out.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from bench.atomic import write_text
from bench.audit.causes import (
    FALSE_ALARMS_SCHEMA,
    MISSES_SCHEMA,
    ExactRunner,
    FalseCause,
    MissCause,
    false_row,
    miss_rows,
)
from bench.audit.polygons import FIT, POLYGONS_SCHEMA, Compensation, PolygonAuditor
from bench.audit.sources import AuditModel, OpenedSource, StoredAudit, audit_each, same_objects
from bench.errors import BenchError
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import Row, to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.evaluation.summary import ProtocolOfRun, Ratio, Summary, summary_of
from bench.evaluation.sums import add_sums, bin_names, name_bins, sum_frames, sum_objects
from bench.execution import Progress, SerialExecutor, TaskExecutor
from bench.harness.answers import write_table
from bench.harness.exact import exact_mask, moving_instances
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.harness.manifest import MethodOfRun
from bench.methods import FlowMethod, Method, MethodInput, Segmentation, ask_method
from bench.recordings import DatasetCard, ImageRef, Recording, read_truth
from bench.records.reference import ReferenceFrame, Status
from bench.reference.regions import REGION_KINDS

AUDIT = "audit.json"
ALL = "all"
STATIC = "static"


class Scoring(StrEnum):
    """Detections and reference that are scored; the same image- and object-frames in all of them."""

    LIDAR = "lidar"  # the method as it is, against the protocol's lidar polygons: the benchmark
    MASKS = "masks"  # the same detections, against the exact masks
    EXACT_MOTION = "exact_motion"  # with exact ego-motion and calibration, against the exact masks
    EXACT_FLOW = "exact_flow"  # with exact flow as well: the method's own limit
    CELLS = "cells"  # every cell whose centre shows a moving object, and no other: the limit of the method's grid


SCHEMAS = {"polygons": POLYGONS_SCHEMA, "misses": MISSES_SCHEMA, "false_alarms": FALSE_ALARMS_SCHEMA}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingAudit:
    """Findings of the audit of a recording, or of several.

    Attributes:
        tables: "polygons", "misses" and "false_alarms" of `SCHEMAS`; "objects" and "frames" are those of the evaluation
            behind a column `scoring`.
        not_seen: evaluated object-frames of which the camera sees no pixel.
    """

    tables: dict[str, pa.Table]
    not_seen: int

    @classmethod
    def joined(cls, parts: Sequence[RecordingAudit]) -> RecordingAudit:
        """Several audits, at least one, as one."""
        return cls(
            tables={name: pa.concat_tables(part.tables[name] for part in parts) for name in parts[0].tables},
            not_seen=sum(part.not_seen for part in parts),
        )


def audit_recording(opened: OpenedSource, *, method: Method, protocol: Protocol) -> RecordingAudit:
    """Audit every camera of a recording.

    Args:
        opened: the recording; without its scene, where its data set has one, that is a problem.
        method: to be scored and explained.
        protocol: the rules.
    """
    source, exact = opened.source, None
    if source.exact is not None and isinstance(method, FlowMethod):
        if source.scene is not None:
            exact = source.exact.open()
        else:
            opened.problems.append(f"recording {source.recorded.name!r}: not in the scenario, so without exact flow")
    cameras = []
    for name in sorted(opened.recording.cameras):
        camera = _CameraAudit(opened, name, exact=exact, method=method, protocol=protocol)
        for index in range(method.history, len(opened.recording.images[name])):
            camera.score(index)
        cameras.append(camera.finish())
    return RecordingAudit.joined(cameras)


class _CameraAudit:
    """The images of one camera, in time order; holds rows, never images."""

    def __init__(
        self, opened: OpenedSource, camera: str, *, exact: Recording | None, method: Method, protocol: Protocol
    ) -> None:
        self._opened, self._camera = opened, camera
        self._method = method
        self._pipeline = FramePipeline(opened.recording, camera, method=method, protocol=protocol)
        self._polygons = PolygonAuditor(opened.recording, camera, protocol.reference)
        self._runner: ExactRunner | None = None
        if exact is not None and isinstance(method, FlowMethod):
            valid, true_camera = self._pipeline.references.valid, exact.cameras[camera]
            self._runner = ExactRunner(opened.source, true_camera, valid=valid, method=method)
        scorings = (Scoring.LIDAR, Scoring.MASKS) if self._runner is None else tuple(Scoring)
        self._scorers = {scoring: SequenceScorer(protocol) for scoring in scorings}
        self._rows: dict[str, list[Row]] = {name: [] for name in SCHEMAS}
        self._not_seen = 0

    def score(self, index: int) -> None:
        """Audit an image; one that cannot be used is reported, and the others are audited."""
        image, instance_of = self._pipeline.images[index], self._opened.instance_of
        self._opened.images += 1
        try:
            given = self._pipeline.method_input(index)
            ids = read_truth(image, self._pipeline.camera)
            reference = self._pipeline.reference(index)
            rows = self._polygons.rows(image, reference, ids, instance_of)
        except UnscorableFrame as reason:
            self._leave_out(image, "skipped", str(reason))
        except BenchError as error:
            self._opened.problems.append(str(error))
            self._leave_out(image, "failed", str(error))
        else:
            self._rows["polygons"] += rows
            self._score(given, ids, reference)

    def finish(self) -> RecordingAudit:
        """The tables."""
        tables = {name: pa.Table.from_pylist(rows, schema=SCHEMAS[name]) for name, rows in self._rows.items()}
        scored = [[_named(scoring, table) for table in scorer.finish()] for scoring, scorer in self._scorers.items()]
        tables["objects"], tables["frames"] = map(pa.concat_tables, zip(*scored, strict=True))
        return RecordingAudit(tables=tables, not_seen=self._not_seen)

    def _score(self, given: MethodInput, ids: NDArray[np.uint16], reference: ReferenceFrame) -> None:
        by_lidar, by_masks = same_objects([reference], ids, self._opened.instance_of)
        self._not_seen += _evaluated(reference) - _evaluated(by_masks)
        if self._runner is None:
            answer = ask_method(self._method, given)
            detected = {Scoring.LIDAR: answer, Scoring.MASKS: answer}
        else:
            moving = moving_instances(self._opened.recording, by_masks)
            runs = self._runner.run(given, moving=moving)
            self._rows["misses"] += miss_rows(runs, by_masks, self._opened.instance_of)
            self._rows["false_alarms"].append(false_row(runs, by_masks))
            detected = {
                Scoring.LIDAR: runs.recorded,
                Scoring.MASKS: runs.recorded,
                Scoring.EXACT_MOTION: runs.exact_motion,
                Scoring.EXACT_FLOW: runs.exact_flow,
                Scoring.CELLS: Segmentation(cell_size_px=runs.cell_size_px, mask=runs.evidence.moving),
            }
        for scoring, segmentation in detected.items():
            # Without the likelihood, whose histograms nothing here reads and which are most of a row.
            answer = replace(segmentation, likelihood=None)
            if scoring is Scoring.LIDAR:
                exact = exact_mask(ids, self._opened.recording, reference)
                self._scorers[scoring].add(by_lidar, answer, exact=exact)
            else:
                self._scorers[scoring].add(by_masks, answer)  # whose ceiling is 1

    def _leave_out(self, image: ImageRef, status: Literal["failed", "skipped"], problem: str) -> None:
        name, time_ns = self._opened.recording.name, image.timestamp_ns
        for scorer in self._scorers.values():
            scorer.leave_out(recording=name, camera=self._camera, timestamp_ns=time_ns, status=status, problem=problem)


def _named(scoring: Scoring, table: pa.Table) -> pa.Table:
    return table.add_column(0, "scoring", pa.array([scoring.value] * len(table), pa.string()))


def _evaluated(reference: ReferenceFrame) -> int:
    return sum(item.status is Status.EVALUATED for item in reference.objects)


class Quartiles(AuditModel):
    """The quarter, half and three quarters of the values lie below; NaN, null in JSON, without values."""

    low: Ratio
    median: Ratio
    high: Ratio

    @classmethod
    def of(cls, values: pd.Series[float]) -> Quartiles:
        """Quartiles of the values that are not NaN."""
        low, median, high = values.quantile([0.25, 0.5, 0.75])
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

    def summary(scoring: str) -> Summary:
        objects, frames = (
            to_frame(audit.tables[name].filter(pc.field("scoring") == scoring)) for name in ("objects", "frames")
        )
        sums = add_sums([sum_objects(objects, protocol=protocol), sum_frames(frames, protocol=protocol)])
        return summary_of(sums, protocol=protocol)

    return {name: summary(name) for name in audit.tables["frames"]["scoring"].unique().to_pylist()}


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
    own = protocol.reference.polygon_kind
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
        return f"the method {method.name!r} does not take flow from outside, as 'spherical' and 'rigid-scene' do"
    if card.scenario is None:
        return "the data set's card names no scenario, so there is no exact flow"
    return "the scene of no recording could be simulated again; see the failures"

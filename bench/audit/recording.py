"""The audit of one recording: images in, tables out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.audit.causes import (
    FALSE_ALARMS_SCHEMA,
    MISSES_SCHEMA,
    Row,
    ThreeRuns,
    false_row,
    miss_rows,
    run_three_times,
)
from bench.audit.polygons import POLYGONS_SCHEMA, PolygonAuditor
from bench.audit.sources import OpenedSource, SimulatedTruth, same_objects
from bench.errors import BenchError, DataError
from bench.evaluation import Protocol, SequenceScorer
from bench.harness.exact import exact_mask, moving_instances
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.methods import FlowMethod, Method, MethodInput, Segmentation, ask_method
from bench.recordings import Recording, read_truth
from bench.reference import ReferenceFrame, Status


class Scoring(StrEnum):
    """Detections and reference that are scored; the same image- and object-frames in all of them."""

    LIDAR = "lidar"  # the method as it is, against the protocol's lidar polygons: the benchmark
    MASKS = "masks"  # the same detections, against the exact masks
    EXACT_MOTION = "exact_motion"  # with exact ego-motion and calibration, against the exact masks
    EXACT_FLOW = "exact_flow"  # with exact flow as well: the method's own limit
    CELLS = "cells"  # every cell whose centre shows a moving object, and no other: the limit of the method's grid


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordingAudit:
    """Findings of the audit of a recording, or of several.

    Attributes:
        polygons: of `POLYGONS_SCHEMA`.
        scores: objects and frames tables of the evaluation, by scoring.
        misses: of `MISSES_SCHEMA`.
        false_alarms: of `FALSE_ALARMS_SCHEMA`.
        not_seen: evaluated object-frames of which the camera sees no pixel.
    """

    polygons: pa.Table
    scores: dict[str, tuple[pa.Table, pa.Table]]
    misses: pa.Table
    false_alarms: pa.Table
    not_seen: int


def audit_recording(opened: OpenedSource, *, method: Method, protocol: Protocol) -> RecordingAudit:
    """Audit every camera of a recording.

    Args:
        opened: the recording.
        method: to be scored and explained.
        protocol: the rules.
    """
    with opened.clock.stage("open"):
        exact = _exact_recording(opened, method)
    found = [_NOTHING]
    for name in sorted(opened.recording.cameras):
        camera = _CameraAudit(opened, name, exact=exact, method=method, protocol=protocol)
        for index in range(method.history, len(opened.recording.images[name])):
            camera.score(index)
        found.append(camera.finish())
    return joined(found)


def joined(parts: Sequence[RecordingAudit]) -> RecordingAudit:
    """Several audits as one."""
    names = [scoring.value for scoring in Scoring if any(scoring.value in part.scores for part in parts)]
    scored = {name: [part.scores[name] for part in parts if name in part.scores] for name in names}
    return RecordingAudit(
        polygons=pa.concat_tables(part.polygons for part in parts),
        scores={name: tuple(map(pa.concat_tables, zip(*tables, strict=True))) for name, tables in scored.items()},
        misses=pa.concat_tables(part.misses for part in parts),
        false_alarms=pa.concat_tables(part.false_alarms for part in parts),
        not_seen=sum(part.not_seen for part in parts),
    )


_NOTHING = RecordingAudit(
    polygons=POLYGONS_SCHEMA.empty_table(),
    scores={},
    misses=MISSES_SCHEMA.empty_table(),
    false_alarms=FALSE_ALARMS_SCHEMA.empty_table(),
    not_seen=0,
)


def _exact_recording(opened: OpenedSource, method: Method) -> Recording | None:
    """The recording with its true calibration; None without, which is a problem where there could be one."""
    source = opened.source
    if source.exact is None or not isinstance(method, FlowMethod):
        return None
    if source.spec is None:
        opened.problems.append(f"recording {source.recorded.name!r}: not in the scenario, so without exact flow")
        return None
    try:
        return source.exact.open()
    except DataError as error:
        opened.problems.append(f"recording {source.recorded.name!r}, without exact flow: {error}")
        return None


class _CameraAudit:
    """The images of one camera, in time order; holds rows, never images."""

    def __init__(
        self, opened: OpenedSource, camera: str, *, exact: Recording | None, method: Method, protocol: Protocol
    ) -> None:
        recording, source = opened.recording, opened.source
        self._opened, self._name, self._camera, self._method = opened, recording.name, camera, method
        self._clock, self._instance_of = opened.clock, opened.instance_of
        self._pipeline = FramePipeline(recording, camera, method=method, protocol=protocol, clock=opened.clock)
        self._polygons = PolygonAuditor(recording, camera, protocol.reference_settings())
        self._simulated: SimulatedTruth | None = None
        if exact is not None and isinstance(method, FlowMethod):
            self._simulated = SimulatedTruth(
                source, exact.cameras[camera], valid=self._pipeline.references.valid, method=method
            )
        self._scorers = {scoring: SequenceScorer(protocol) for scoring in self._scorings()}
        self._polygon_rows: list[Row] = []
        self._miss_rows: list[Row] = []
        self._false_rows: list[Row] = []
        self._not_seen = 0

    def score(self, index: int) -> None:
        """Audit an image; one that cannot be used is reported, and the others are audited."""
        image = self._pipeline.images[index]
        self._opened.images += 1
        try:
            given = self._pipeline.method_input(index)
            with self._clock.stage("decode"):
                ids = read_truth(image, self._pipeline.camera)
            with self._clock.stage("reference"):
                reference = self._pipeline.references.build(image)
            with self._clock.stage("polygons"):
                rows = self._polygons.rows(image, reference, ids, self._instance_of)
        except UnscorableFrame as reason:
            self._leave_out(image.timestamp_ns, "skipped", str(reason))
        except BenchError as error:
            self._opened.problems.append(str(error))
            self._leave_out(image.timestamp_ns, "failed", str(error))
        else:
            self._polygon_rows += rows
            self._score(given, ids, reference)

    def finish(self) -> RecordingAudit:
        """The tables; without exact flow where the scene turns out to be another one."""
        misses, false_rows, scorings = self._miss_rows, self._false_rows, self._scorings()
        try:
            if self._simulated is not None:
                self._simulated.check()
        except DataError as error:
            self._opened.problems.append(
                f"recording {self._name!r}, camera {self._camera!r}, without exact flow: {error}"
            )
            misses, false_rows, scorings = [], [], (Scoring.LIDAR, Scoring.MASKS)
        return RecordingAudit(
            polygons=pa.Table.from_pylist(self._polygon_rows, schema=POLYGONS_SCHEMA),
            scores={scoring.value: self._scorers[scoring].finish() for scoring in scorings},
            misses=pa.Table.from_pylist(misses, schema=MISSES_SCHEMA),
            false_alarms=pa.Table.from_pylist(false_rows, schema=FALSE_ALARMS_SCHEMA),
            not_seen=self._not_seen,
        )

    def _scorings(self) -> tuple[Scoring, ...]:
        return tuple(Scoring) if self._simulated is not None else (Scoring.LIDAR, Scoring.MASKS)

    def _score(self, given: MethodInput, ids: NDArray[np.uint16], reference: ReferenceFrame) -> None:
        by_lidar, by_masks = same_objects([reference], ids, self._instance_of)
        self._not_seen += _evaluated(reference) - _evaluated(by_masks)
        if self._simulated is None:
            with self._clock.stage("method"):
                found = ask_method(self._method, given)
            detected = {Scoring.LIDAR: found, Scoring.MASKS: found}
        else:
            runs = self._explain(self._simulated, given, ids, by_masks)
            detected = {
                Scoring.LIDAR: runs.recorded,
                Scoring.MASKS: runs.recorded,
                Scoring.EXACT_MOTION: runs.exact_motion,
                Scoring.EXACT_FLOW: runs.exact_flow,
                Scoring.CELLS: Segmentation(cell_size_px=self._simulated.cells.cell_size_px, mask=runs.evidence.moving),
            }
        with self._clock.stage("counts"):
            for scoring, segmentation in detected.items():
                # Without the likelihood, whose histograms nothing here reads and which are most of a row.
                against = by_lidar if scoring is Scoring.LIDAR else by_masks
                exact = None  # of the masks themselves, whose ceiling is 1
                if scoring is Scoring.LIDAR:
                    exact = exact_mask(ids, self._pipeline.recording, reference)
                self._scorers[scoring].add(against, replace(segmentation, likelihood=None), exact=exact)

    def _explain(
        self, simulated: SimulatedTruth, given: MethodInput, ids: NDArray[np.uint16], reference: ReferenceFrame
    ) -> ThreeRuns:
        assert isinstance(self._method, FlowMethod), "no other can be asked with exact flow"
        with self._clock.stage("exact flow"):
            exact = simulated.look(given, ids)
        moving = moving_instances(self._pipeline.recording, reference)
        with self._clock.stage("method"):
            runs = run_three_times(self._method, given, exact, moving_ids=np.array(moving, dtype=np.int64))
        with self._clock.stage("causes"):
            self._miss_rows += miss_rows(runs, exact, reference, self._instance_of)
            self._false_rows.append(false_row(runs, exact, reference))
        return runs

    def _leave_out(self, timestamp_ns: int, status: Literal["failed", "skipped"], problem: str) -> None:
        for scorer in self._scorers.values():
            scorer.leave_out(
                recording=self._name, camera=self._camera, timestamp_ns=timestamp_ns, status=status, problem=problem
            )


def _evaluated(reference: ReferenceFrame) -> int:
    return sum(item.status is Status.EVALUATED for item in reference.objects)

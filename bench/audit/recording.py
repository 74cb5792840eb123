"""The audit of one recording: images in, tables out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.audit.causes import FALSE_ALARMS_SCHEMA, MISSES_SCHEMA, ExactRunner, false_row, miss_rows
from bench.audit.polygons import POLYGONS_SCHEMA, PolygonAuditor
from bench.audit.sources import OpenedSource, same_objects
from bench.errors import BenchError, DataError
from bench.evaluation import Protocol, SequenceScorer
from bench.evaluation.rows import Row
from bench.harness.exact import exact_mask, moving_instances
from bench.harness.frames import FramePipeline, UnscorableFrame
from bench.methods import FlowMethod, Method, MethodInput, Segmentation, ask_method
from bench.recordings import ImageRef, Recording, read_truth
from bench.reference import ReferenceFrame, Status


class Scoring(StrEnum):
    """Detections and reference that are scored; the same image- and object-frames in all of them."""

    LIDAR = "lidar"  # the method as it is, against the protocol's lidar polygons: the benchmark
    MASKS = "masks"  # the same detections, against the exact masks
    EXACT_MOTION = "exact_motion"  # with exact ego-motion and calibration, against the exact masks
    EXACT_FLOW = "exact_flow"  # with exact flow as well: the method's own limit
    CELLS = "cells"  # every cell whose centre shows a moving object, and no other: the limit of the method's grid


WITHOUT_EXACT_FLOW = (Scoring.LIDAR, Scoring.MASKS)
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
        opened: the recording.
        method: to be scored and explained.
        protocol: the rules.
    """
    exact = _exact_recording(opened, method)
    cameras = []
    for name in sorted(opened.recording.cameras):
        camera = _CameraAudit(opened, name, exact=exact, method=method, protocol=protocol)
        for index in range(method.history, len(opened.recording.images[name])):
            camera.score(index)
        cameras.append(camera.finish())
    return RecordingAudit.joined(cameras)


def _exact_recording(opened: OpenedSource, method: Method) -> Recording | None:
    """The recording with its true calibration; None without, which is a problem where there could be one."""
    source = opened.source
    if source.exact is None or not isinstance(method, FlowMethod):
        return None
    if source.scene is None:
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
        self._opened, self._camera = opened, camera
        self._method = method
        self._pipeline = FramePipeline(opened.recording, camera, method=method, protocol=protocol)
        self._polygons = PolygonAuditor(opened.recording, camera, protocol.reference_settings())
        self._runner: ExactRunner | None = None
        if exact is not None and isinstance(method, FlowMethod):
            valid, true_camera = self._pipeline.references.valid, exact.cameras[camera]
            self._runner = ExactRunner(opened.source, true_camera, valid=valid, method=method)
        scorings = WITHOUT_EXACT_FLOW if self._runner is None else tuple(Scoring)
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

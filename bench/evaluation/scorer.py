"""The recipe: reference and segmentation of each image in, the two tables of the sequence out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.counts import (
    ChanceScorer,
    ObjectCounts,
    count_by_cell,
    count_frame,
    count_likelihood,
    find_regions,
    sum_by_kind,
)
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import (
    EVALUATED,
    FRAME_COUNTS,
    FRAMES_SCHEMA,
    IMAGE,
    NOT_ANNOTATED,
    OBJECTS_SCHEMA,
    Row,
)
from bench.records.reference import ReferenceFrame, Status
from bench.records.segmentation import Segmentation
from bench.times import SECOND_NS


class SequenceScorer:
    """Scores the frames of one camera in one recording, in time order.

    Args:
        protocol: the rules.
    """

    def __init__(self, protocol: Protocol) -> None:
        self._large_px = protocol.scoring.false_positive_component_px
        self._chance = ChanceScorer(lag_ns=round(protocol.scoring.chance_lag_s * SECOND_NS))
        self._objects: list[Row] = []
        self._frames: list[Row] = []

    def add(
        self, reference: ReferenceFrame, segmentation: Segmentation, *, exact: NDArray[np.bool_] | None = None
    ) -> None:
        """Score a frame; of one that is not annotated, only the pixels of its mask are counted.

        Args:
            reference: of the image.
            segmentation: the method's answer.
            exact: (H, W) bool, the exact masks of all that moves, which are scored beside it; None where unknown.

        Raises:
            ShapeError: the mask is not of the image's size.
        """
        height, width = reference.valid.shape
        detected = segmentation.mask_at(width, height)
        regions = find_regions(reference, detected)
        frame, objects = count_frame(reference, detected, component_size_px=self._large_px, regions=regions)
        self._chance.add(reference, detected)
        row = _image_columns(reference) | asdict(frame) | {"fp_by_cause": [], "undefined_px": 0}
        row["status"] = EVALUATED if reference.annotated else NOT_ANNOTATED
        cell_size_px, causes = segmentation.cell_size_px, segmentation.causes
        if segmentation.cause is not None:
            px = sum_by_kind(regions.false, segmentation.cause, cell_size_px=cell_size_px, bins=len(causes))
            row["fp_by_cause"] = sorted(dict(zip(causes, px.tolist(), strict=True)).items())
        if segmentation.undefined is not None:
            row["undefined_px"] = int(count_by_cell(reference.valid, cell_size_px)[segmentation.undefined].sum())
        self._frames.append(row)
        if not reference.annotated:
            return
        if segmentation.likelihood is not None:
            is_score = segmentation.likelihood_is_score
            row |= count_likelihood(segmentation.likelihood, regions, cell_size_px=cell_size_px, is_score=is_score)
        ceiling = None if exact is None else count_frame(reference, exact, component_size_px=self._large_px)[1]
        self._objects.extend(_object_rows(reference, objects, ceiling))

    def leave_out(
        self, *, recording: str, camera: str, timestamp_ns: int, status: Literal["failed", "skipped"], problem: str
    ) -> None:
        """Record that a frame could not be scored, and why."""
        image = {"recording": recording, "camera": camera, "timestamp_ns": timestamp_ns, "ego_speed_mps": math.nan}
        outcome = {"status": status, "problem": problem, "undefined_px": 0, "fp_by_cause": []}
        self._frames.append(image | outcome | dict.fromkeys(FRAME_COUNTS, 0))

    def finish(self) -> tuple[pa.Table, pa.Table]:
        """End the sequence: `OBJECTS_SCHEMA` and `FRAMES_SCHEMA`; what a row does not have is null."""
        chance_tp = self._chance.finish()
        for row in self._objects:
            row["chance_tp"] = chance_tp.get(row["timestamp_ns"], {}).get(row["track_id"])
        objects = pa.Table.from_pylist(self._objects, schema=OBJECTS_SCHEMA)
        return objects, pa.Table.from_pylist(self._frames, schema=FRAMES_SCHEMA)


_OF_OBJECT = (
    "track_id", "object_class", "status", "reason", "category", "direction", "range_m", "speed_mps", "points",
    "polygon_px", "unknown_px",
)  # fmt: skip


def _object_rows(
    reference: ReferenceFrame, counts: Sequence[ObjectCounts], ceiling: Sequence[ObjectCounts] | None
) -> Iterator[Row]:
    """Rows of `OBJECTS_SCHEMA`, in the order of `reference.objects`; `chance_tp` is still missing."""
    image = _image_columns(reference)
    for number, (item, own) in enumerate(zip(reference.objects, counts, strict=True)):
        row = image | {name: getattr(item, name) for name in _OF_OBJECT} | asdict(own)
        row |= {"x_m": item.centroid_m[0], "y_m": item.centroid_m[1], "region_px": own.tp + own.fn}
        if ceiling is not None and item.status is Status.EVALUATED:
            row |= {"ceiling_tp": ceiling[number].tp, "ceiling_fp": ceiling[number].fp}
        yield row


def _image_columns(reference: ReferenceFrame) -> Row:
    return {name: getattr(reference, name) for name in (*IMAGE, "ego_speed_mps")}

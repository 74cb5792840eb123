"""The recipe: reference and segmentation of each image in, the two tables of the sequence out."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.counts import ChanceScorer, count_frame, find_regions, sum_by_kind
from bench.evaluation.likelihood import count_likelihood
from bench.evaluation.maps import ImageMap
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import Row, frame_row, frames_table, object_rows, objects_table, unscored_frame_row
from bench.records.reference import ReferenceFrame
from bench.records.segmentation import Segmentation


class SequenceScorer:
    """Scores the frames of one camera in one recording, in time order.

    Args:
        protocol: the rules.
    """

    def __init__(self, protocol: Protocol) -> None:
        self._component_size_px = protocol.scoring.false_positive_component_px
        self._chance = ChanceScorer(lag_ns=protocol.chance_lag_ns)
        self._objects: list[Row] = []
        self._frames: list[Row] = []
        self._map: ImageMap | None = None

    def add(
        self,
        reference: ReferenceFrame,
        segmentation: Segmentation,
        *,
        exact: NDArray[np.bool_] | None = None,
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
        frame, objects = count_frame(
            reference,
            detected,
            cause=segmentation.cause,
            causes=segmentation.causes,
            cell_size_px=segmentation.cell_size_px,
            component_size_px=self._component_size_px,
            regions=regions,
        )
        self._chance.add(reference, detected)
        histograms: dict[str, NDArray[np.int64]] = {}
        if segmentation.likelihood is not None and reference.annotated:
            histograms = count_likelihood(
                segmentation.likelihood,
                regions,
                cell_size_px=segmentation.cell_size_px,
                is_score=segmentation.likelihood_is_score,
            )
        undefined_px = _undefined_px(reference.valid, segmentation)
        self._frames.append(frame_row(reference, frame, undefined_px=undefined_px, histograms=histograms))
        if not reference.annotated:
            return
        own = ImageMap.of(regions, camera=reference.camera)
        self._map = own if self._map is None else self._map + own
        ceiling = None
        if exact is not None:
            ceiling = count_frame(reference, exact, component_size_px=self._component_size_px)[1]
        self._objects.extend(object_rows(reference, objects, ceiling=ceiling))

    def leave_out(
        self,
        *,
        recording: str,
        camera: str,
        timestamp_ns: int,
        status: Literal["failed", "skipped"],
        problem: str,
    ) -> None:
        """Record that a frame could not be scored, and why."""
        self._frames.append(
            unscored_frame_row(
                recording=recording, camera=camera, timestamp_ns=timestamp_ns, status=status, problem=problem
            )
        )

    def finish(self) -> tuple[pa.Table, pa.Table]:
        """End the sequence: the objects table and the frames table."""
        chance_tp = self._chance.finish()
        for row in self._objects:
            row["chance_tp"] = chance_tp.get(row["timestamp_ns"], {}).get(row["track_id"])
        return objects_table(self._objects), frames_table(self._frames)

    def image_map(self) -> ImageMap | None:
        """Return the map of where the frames so far were right and wrong in the image; None without a scored frame."""
        return self._map


def _undefined_px(valid: NDArray[np.bool_], segmentation: Segmentation) -> int:
    """Pixels of V where the method could not say."""
    if segmentation.undefined is None:
        return 0
    kinds, name = segmentation.undefined.view(np.uint8), "grid of undefined cells"
    return int(sum_by_kind(valid, kinds, cell_size_px=segmentation.cell_size_px, bins=2, name=name)[1])

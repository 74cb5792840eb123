"""Score a mask against a reference, both arrays: no recording, no lidar, no files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.errors import ShapeError, UsageError
from bench.evaluation.definitions import (
    HALF,
    OBJECT_FRAMES,
    coverage,
    image_metrics,
    intersection_over_union,
    object_metrics,
)
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import EVALUATED, to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.records.reference import ReferenceFrame, pixels_object
from bench.records.segmentation import Segmentation

Mask = NDArray[np.bool_]
# All but the chance levels, which need a mask of another time.
METRICS = [m for m in (*object_metrics((0.1, HALF)), *image_metrics()) if not m.name.startswith("chance")]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Score:
    """Score of masks against references: counts first, ratios last, as docs/metrics.md defines them.

    Ratios are shares in [0, 1], NaN without cases.
    """

    _objects: pa.Table
    _frames: pa.Table

    @classmethod
    def of(cls, scores: Iterable[Score]) -> Score:
        """The score of all images of several scores, at least one."""
        tables = [pa.concat_tables(parts) for parts in zip(*((s._objects, s._frames) for s in scores), strict=True)]
        if not tables:
            raise UsageError("expected at least one score, got none")
        return cls(_objects=tables[0], _frames=tables[1])

    @property
    def objects(self) -> pd.DataFrame:
        """One row per evaluated object and image: its counts tp, fn, fp in pixels, coverage and IoU."""
        rows = self._evaluated
        table = rows[["recording", "camera", "timestamp_ns", "track_id", "tp", "fn", "fp"]].reset_index(drop=True)
        return table.assign(coverage=coverage, iou=intersection_over_union)

    @property
    def images(self) -> pd.DataFrame:
        """One row per image: pixels of image, V, reference, I and D, and those that are true and false."""
        images: pd.DataFrame = self._frames.to_pandas()
        return images.dropna(axis="columns", how="all")

    @property
    def metrics(self) -> dict[str, float]:
        """The metrics of docs/metrics.md by name, but for chance levels."""
        objects, images = self._evaluated, to_frame(self._frames)
        return {m.name: m.value(objects if m.over == OBJECT_FRAMES else images) for m in METRICS}

    @property
    def tpr(self) -> float:
        """Mean coverage of the detected objects, the paper's wording."""
        return self.metrics["tpr"]

    @property
    def iou(self) -> float:
        """Mean IoU of all objects, an undetected one having 0."""
        return self.metrics["iou"]

    @property
    def false_positives(self) -> float:
        """False-positive coverage: what is marked outside of every object and of I, as a share of the image."""
        return self.metrics["false_positive_coverage"]

    @property
    def _evaluated(self) -> pd.DataFrame:
        rows = to_frame(self._objects)
        return rows[rows["status"] == EVALUATED]

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={getattr(self, name):.3f}" for name in ("iou", "tpr", "false_positives"))
        return f"Score({shown}; {len(self._evaluated)} objects in {len(self._frames)} images)"


def score(
    reference: NDArray[np.generic] | ReferenceFrame,
    mask: NDArray[np.generic],
    *,
    ignored: Mask | None = None,
    valid: Mask | None = None,
) -> Score:
    """Score the mask of one image.

    Args:
        reference: what moves, as one of

            - a label image, (H, W) integers: 0 for the background, any other number for one object, also where it is
              in several pieces: a mask of 0 and 255 is one object, pass `mask > 0` for its components;
            - a mask, (H, W) bool: each connected component (8 neighbours) of its valid pixels is an object, as in the
              protocol masks-v1, but of any size;
            - the reference of a `Frame`.
        mask: (H, W) bool, or integers that are not 0 where something moves.
        ignored: (H, W) bool, where a detection is neither right nor wrong.
        valid: (H, W) bool, pixels that count; None for all.

    Raises:
        ShapeError: arrays of another size or type than these, or masked ones.
        UsageError: `ignored` or `valid` beside a `Frame`'s reference, which holds its own, or one of an image that is
            not annotated.

    Example:
        An object of 4 x 4 pixels, of which the mask finds the upper half, and 2 pixels beside it:

        >>> labels = np.zeros((10, 10), dtype=int)
        >>> labels[2:6, 2:6] = 1
        >>> mask = np.zeros((10, 10), dtype=bool)
        >>> mask[2:4, 2:7] = True
        >>> round(score(labels, mask).iou, 3)  # 8 / (16 + 2)
        0.444
    """
    moving = _pixels(mask, "mask", None, "bool or integers; for scores, pass scores > 0.5")
    moving = np.ascontiguousarray(moving != 0)
    if not isinstance(reference, ReferenceFrame):
        frame = _reference_frame(reference, moving.shape, ignored=ignored, valid=valid)
    elif not reference.annotated:
        where = f"{reference.recording}, {reference.camera}, {reference.timestamp_ns}"
        raise UsageError(f"reference: expected one of an annotated image, got {where}, which is not annotated")
    elif ignored is None and valid is None:
        frame = reference
    else:
        raise UsageError("ignored, valid: expected none beside the reference of a frame, which holds its own")
    scorer = SequenceScorer(_protocol())
    scorer.add(frame, Segmentation(cell_size_px=1, mask=moving))
    objects, frames = scorer.finish()
    return Score(_objects=objects, _frames=frames)


@cache
def _protocol() -> Protocol:
    """Of which only the size of a large false positive matters here."""
    return load_protocol("paper-v1")


def _reference_frame(
    reference: NDArray[np.generic], shape: tuple[int, ...], *, ignored: Mask | None, valid: Mask | None
) -> ReferenceFrame:
    nowhere = np.zeros(shape, dtype=bool)
    counted = ~nowhere if valid is None else _pixels(valid, "valid", shape, "bool")
    left_out = nowhere if ignored is None else _pixels(ignored, "ignored", shape, "bool")
    pixels = _pixels(reference, "reference", shape, "bool or integers, a mask or a label image")
    if pixels.dtype == bool:
        pixels = cv2.connectedComponents((pixels & counted).astype(np.uint8), connectivity=8)[1]
    marked = (pixels != 0) & counted
    numbers, order, region_px = np.unique(pixels[marked], return_inverse=True, return_counts=True)
    labels = np.zeros(shape, dtype=np.int32)
    labels[marked] = order + 1
    return ReferenceFrame(
        recording="",
        camera="",
        timestamp_ns=0,
        ego_speed_mps=float("nan"),
        objects=tuple(
            pixels_object(str(name), px, reason=None)
            for name, px in zip(numbers.tolist(), region_px.tolist(), strict=True)
        ),
        labels=labels,
        ignored=left_out & (labels == 0),
        unknown=nowhere,
        left_out=nowhere,
        valid=counted,
    )


def _pixels(values: object, name: str, shape: tuple[int, ...] | None, kinds: str) -> NDArray[Any]:
    """An image of flags, or of numbers where the kinds name them; none that hides values, since they would count."""
    pixels = np.asarray(values)
    known = (np.bool_, np.integer) if "integers" in kinds else (np.bool_,)
    fits = pixels.ndim == 2 and pixels.size and (shape is None or pixels.shape == shape)
    if isinstance(values, np.ma.MaskedArray) or not fits or not issubclass(pixels.dtype.type, known):
        size = "(height, width)" if shape is None else f"the mask's size {shape}"
        got = f"a masked {pixels.shape}" if isinstance(values, np.ma.MaskedArray) else str(pixels.shape)
        raise ShapeError(f"{name}: expected an array of {size} of {kinds}, got {got} of {pixels.dtype}")
    return pixels

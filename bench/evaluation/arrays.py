"""Score a mask against a reference, both arrays: no recording, no lidar, no files; intervals of own breakdowns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pyarrow as pa
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon

from bench.errors import ShapeError, UsageError
from bench.evaluation.definitions import (
    FALSE_POSITIVES,
    SEGMENTATION,
    Definition,
    coverage,
    intersection_over_union,
    object_metrics,
)
from bench.evaluation.intervals import ratio_interval
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.geometry.raster import rasterise
from bench.records.reference import IgnoreReason, ReferenceFrame, Status, pixels_object
from bench.records.segmentation import Segmentation

Mask = NDArray[np.bool_]
Polygons = Sequence[ArrayLike | Polygon | MultiPolygon]
LEVELS = (0.1, 0.5)  # of coverage, at which an object counts as detected as well
CHANCE = "chance"  # needs a mask of another time


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Score:
    """Score of masks against references: counts first, ratios last, as docs/metrics.md defines them.

    Ratios are shares in [0, 1], NaN without cases.
    """

    _objects: pa.Table
    _frames: pa.Table

    @classmethod
    def of(cls, scores: Iterable[Score]) -> Score:
        """The score of all images of several scores.

        Raises:
            UsageError: no score.
        """
        held = list(scores)
        if not held:
            raise UsageError("expected at least one score, got none")
        tables = [pa.concat_tables(parts) for parts in zip(*((s._objects, s._frames) for s in held), strict=True)]
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
        """All ratios by name: those of objects, of false positives (`fp_...`), of all pixels (`pixel_...`)."""
        objects, frames = self._evaluated, to_frame(self._frames)
        of_objects = [metric for metric in object_metrics(LEVELS) if not metric.name.startswith(CHANCE)]
        return {
            **{metric.name: _ratio(objects, metric) for metric in of_objects},
            **{f"fp_{metric.field}": _ratio(frames, metric) for metric in FALSE_POSITIVES},
            **{f"pixel_{metric.field}": _ratio(frames, metric) for metric in SEGMENTATION},
        }

    @property
    def detection_rate(self) -> float:
        """Share of the objects of which any pixel is detected."""
        return self.metrics["detection_rate"]

    @property
    def tpr(self) -> float:
        """Mean coverage of the detected objects, the paper's wording."""
        return self.metrics["tpr"]

    @property
    def iou(self) -> float:
        """Mean IoU of all objects, an undetected one having 0."""
        return self.metrics["iou"]

    @property
    def iou_detected(self) -> float:
        """Mean IoU of the detected objects, which compares with the paper."""
        return self.metrics["iou_detected"]

    @property
    def false_positives(self) -> float:
        """False-positive coverage: what is marked outside of every object and of I, as a share of the image."""
        return self.metrics["fp_coverage"]

    @property
    def _evaluated(self) -> pd.DataFrame:
        rows = to_frame(self._objects)
        return rows[rows["status"] == Status.EVALUATED.value]

    def __repr__(self) -> str:
        told = {name: getattr(self, name) for name in ("iou", "tpr", "detection_rate", "false_positives")}
        shown = ", ".join(f"{name}={value:.3f}" for name, value in told.items())
        return f"Score({shown}; {len(self._evaluated)} objects in {len(self._frames)} images)"


def score(
    reference: NDArray[np.generic] | Polygons | ReferenceFrame,
    mask: NDArray[np.generic],
    *,
    ignored: NDArray[np.bool_] | Polygons | None = None,
    valid: NDArray[np.bool_] | None = None,
) -> Score:
    """Score the mask of one image.

    Args:
        reference: what moves, as one of

            - a label image, (H, W) integers: 0 for the background, any other number for one object, also where it is
              in several pieces: a mask of 0 and 255 is one object, pass `mask > 0` for its components;
            - a mask, (H, W) bool: each connected component (8 neighbours) is an object, as in the protocol masks-v1;
            - polygons, each (K, 2) numbers (u, v) in pixels, or of shapely, also of several parts, the nearest first,
              as it hides the others;
            - the reference of a `Frame`.
        mask: (H, W) bool, or integers that are not 0 where something moves.
        ignored: (H, W) bool or polygons, where a detection is neither right nor wrong.
        valid: (H, W) bool, pixels that count; None for all.

    Raises:
        ShapeError: arrays of another size or type than these, masked ones, or polygons that are empty or infinite.
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
    moving = _mask(mask)
    if isinstance(reference, ReferenceFrame):
        if ignored is not None or valid is not None:
            raise UsageError("ignored, valid: expected none beside the reference of a frame, which holds its own")
        frame = reference
        if not frame.annotated:
            where = f"{frame.recording}, {frame.camera}, {frame.timestamp_ns}"
            raise UsageError(f"reference: expected one of an annotated image, got {where}, which is not annotated")
    else:
        frame = _reference_frame(reference, moving.shape, ignored=ignored, valid=valid)
    scorer = SequenceScorer(_protocol())
    scorer.add(frame, Segmentation(cell_size_px=1, mask=moving))
    objects, frames = scorer.finish()
    return Score(_objects=objects, _frames=frames)


def interval(values: ArrayLike, recordings: Sequence[str] | pd.Series) -> tuple[float, float] | None:
    """95 % interval of the mean of values, by recording as in docs/metrics.md: for a breakdown of one's own.

    Args:
        values: (N,) shares in [0, 1], such as the coverage or IoU of object-frames; NaN is left out.
        recordings: N names of the recordings that they are of.

    Returns:
        Lower and upper end; None where fewer than six recordings have values.

    Raises:
        ShapeError: not one name for each value, or masked arrays.
        UsageError: values outside of [0, 1].
    """
    shares, names = _numbers(values, "values"), _array(recordings, "recordings")
    if shares.ndim != 1 or names.shape != shares.shape:
        raise ShapeError(f"interval: expected a recording for each value, got {shares.shape} and {names.shape}")
    held = ~np.isnan(shares)
    if not ((shares[held] >= 0) & (shares[held] <= 1)).all():
        raise UsageError("interval: expected values in [0, 1], got others; divide counts by what they are of")
    number, _ = pd.factorize(names[held])  # names of any type, which need no order
    if (number < 0).any():
        raise UsageError("interval: expected the name of a recording for each value, got None or NaN")
    sums = (np.bincount(number, weights=of_each).astype(np.float64) for of_each in (shares[held], np.ones(len(number))))
    return ratio_interval(*sums)


@cache
def _protocol() -> Protocol:
    """Of which only the size of a large false positive matters here."""
    return load_protocol("paper-v1")


def _reference_frame(
    reference: NDArray[np.generic] | Polygons,
    shape: tuple[int, ...],
    *,
    ignored: NDArray[np.bool_] | Polygons | None,
    valid: NDArray[np.bool_] | None,
) -> ReferenceFrame:
    counted = np.ones(shape, dtype=bool) if valid is None else _flags(valid, shape, "valid")
    labels, names = _labels(reference, shape)
    labels = np.where(counted, labels, np.int32(0))
    left_out = np.zeros(shape, dtype=bool)
    if ignored is not None:
        whole = isinstance(ignored, np.ndarray)
        left_out = _flags(ignored, shape, "ignored") if whole else _drawn(ignored, shape, "ignored")[0] > 0
    region_px = np.bincount(labels.ravel(), minlength=len(names) + 1)[1:].tolist()
    return ReferenceFrame(
        recording="",
        camera="",
        timestamp_ns=0,
        ego_speed_mps=float("nan"),
        objects=tuple(
            pixels_object(name, px, reason=None if px else IgnoreReason.OCCLUDED)
            for name, px in zip(names, region_px, strict=True)
        ),
        labels=labels,
        ignored=left_out & (labels == 0),
        unknown=np.zeros(shape, dtype=bool),
        left_out=np.zeros(shape, dtype=bool),
        valid=counted,
    )


def _labels(
    reference: NDArray[np.generic] | Polygons, shape: tuple[int, ...]
) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """(H, W), k + 1 where the k-th object is seen, and the objects' names."""
    if not (isinstance(reference, np.ndarray) and reference.ndim == 2):
        return _drawn(reference, shape, "reference")
    reference = _array(reference, "reference")
    if reference.dtype == bool:
        flags = _flags(reference, shape, "reference")
        count, components = cv2.connectedComponents(flags.view(np.uint8), connectivity=8)
        return components.astype(np.int32), tuple(f"component-{number}" for number in range(1, count))
    if not np.issubdtype(reference.dtype, np.integer) or reference.shape != shape:
        raise _unfit("reference", "label image of integers", shape, reference)
    marked = reference != 0
    numbers, order = np.unique(reference[marked], return_inverse=True)
    labels = np.zeros(shape, dtype=np.int32)
    labels[marked] = order + 1
    return labels, tuple(str(number) for number in numbers.tolist())


def _drawn(polygons: object, shape: tuple[int, ...], name: str) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    """Polygons, the first in front."""
    if not isinstance(polygons, Sequence | np.ndarray):
        raise UsageError(f"{name}: expected an array or a list of polygons, got {type(polygons).__name__}")
    labels = np.zeros(shape, dtype=np.int32)
    for number, outline in enumerate(polygons, start=1):
        window, covered = rasterise(_polygon(outline, f"{name}[{number - 1}]"), width=shape[1], height=shape[0])
        free = labels[window] == 0
        labels[window][covered & free] = number
    return labels, tuple(f"polygon-{number}" for number in range(1, len(polygons) + 1))


def _polygon(outline: object, name: str) -> Polygon | MultiPolygon:
    if not isinstance(outline, Polygon | MultiPolygon):
        corners = _numbers(outline, name)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
            near = "; an image is passed as an array: numpy.asarray(image)" if corners.ndim == 1 else ""
            raise ShapeError(
                f"{name}: expected a polygon of at least three corners (u, v), got shape {corners.shape}{near}"
            )
        outline = shapely.Polygon(corners)
    if outline.is_empty or not np.isfinite(shapely.get_coordinates(outline)).all():
        got = "an empty one" if outline.is_empty else "NaN or infinity"
        raise ShapeError(f"{name}: expected a polygon of finite corners (u, v), got {got}")
    return outline


def _mask(mask: NDArray[np.generic]) -> Mask:
    """A mask as flags; a likelihood is refused, since nobody said from which value on something moves."""
    values = _array(mask, "mask")
    if values.ndim != 2 or not (values.dtype == bool or np.issubdtype(values.dtype, np.integer)):
        got = f"{values.shape} of {values.dtype}"
        raise ShapeError(
            f"mask: expected (height, width) of bool or integers, got {got}; for scores, pass scores > 0.5"
        )
    if not values.size:
        raise ShapeError(f"mask: expected (height, width) of at least one pixel, got {values.shape}")
    return np.ascontiguousarray(values != 0)


def _flags(values: object, shape: tuple[int, ...], name: str) -> Mask:
    flags = _array(values, name)
    if flags.shape != shape or flags.dtype != bool:
        raise _unfit(name, "mask of bool", shape, flags)
    return np.ascontiguousarray(flags)


def _numbers(values: object, name: str) -> NDArray[np.float64]:
    try:
        return np.asarray(_array(values, name), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name}: expected numbers, got {' '.join(str(error).split())}") from error


def _array(values: object, name: str) -> NDArray[Any]:
    """An array of NumPy's own class; one that hides values is refused, since they would count."""
    if isinstance(values, np.ma.MaskedArray):
        hint = "pass values.filled(...), and what does not count as `ignored` or `valid`, or leave it out"
        raise ShapeError(f"{name}: expected an array that hides nothing, got a masked one; {hint}")
    return np.asarray(values)


def _unfit(name: str, kind: str, shape: tuple[int, ...], got: NDArray[np.generic]) -> ShapeError:
    return ShapeError(f"{name}: expected a {kind} of the mask's size {shape}, got {got.shape} of {got.dtype}")


def _ratio(rows: pd.DataFrame, metric: Definition) -> float:
    above, below = float(metric.numerator(rows).sum()), float(metric.denominator(rows).sum())
    return above / below if below else float("nan")

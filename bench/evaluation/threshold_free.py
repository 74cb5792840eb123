"""Figures that need no threshold: area under precision over recall, and false-positive rate at 95 % recall.

Both are taken over pixels of all images: positives are those of G, negatives those of V outside all G and I. They come
from histograms over the likelihood, so the order of pixels within a bin is unknown. The figures are those of masks at
the edges of the bins, which exist; beside them stand the least and the most that any order within the bins could give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import digamma

from bench.evaluation.columns import Columns
from bench.evaluation.intervals import FEWEST_RECORDINGS, RATIO, jackknife
from bench.evaluation.likelihood import OUTSIDE_COLUMN, REFERENCE_COLUMN, histogram_rows
from bench.evaluation.summary import Figure, Ratio

RECALL = 19, 20  # 95 % in whole numbers, so that no rounding decides
COLUMNS = ("recording", REFERENCE_COLUMN, OUTSIDE_COLUMN)
Histograms = NDArray[np.float64]


class ThresholdFreeFigures(BaseModel):
    """What a likelihood is worth at all thresholds together.

    Attributes:
        auprc: area under precision over recall, as the sum of precision x gain in recall (average precision).
        auprc_bounds: least and most that it can be without bins.
        fpr95: share of the negative pixels above the highest edge that leaves at least 95 % of the positive ones above.
        fpr95_bounds: least and most that it can be without bins; `fpr95` is the most.
        images: with a likelihood.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    auprc: Figure
    auprc_bounds: tuple[Ratio, Ratio]
    fpr95: Figure
    fpr95_bounds: tuple[Ratio, Ratio]
    images: int


def threshold_free_figures(batches: Iterable[pa.RecordBatch]) -> ThresholdFreeFigures | None:
    """Take the figures, one batch of images in memory at a time.

    Args:
        batches: of the columns `COLUMNS` of the frames table; the histograms null where there is none.

    Returns:
        None for a method without a likelihood.

    Source:
        Davis and Goadrich 2006 (no linear interpolation between points of the curve); Hendrycks and Gimpel 2017 and
        Chan et al. 2021 (false-positive rate at 95 % recall).
    """
    sums, images = _sums_by_recording(batches)
    if not images:
        return None
    of_recording = np.array([sums[name] for name in sorted(sums)], dtype=np.float64)  # (S, 2, BINS)
    positive, negative = of_recording.sum(axis=0)
    fpr95 = _figure(_rate_at_recall, of_recording, cases=int(negative.sum()))
    return ThresholdFreeFigures(
        auprc=_figure(_average_precision, of_recording, cases=int(positive.sum())),
        auprc_bounds=_precision_bounds(positive, negative),
        fpr95=fpr95,
        fpr95_bounds=(float(_rate_at_recall(positive, negative, least=True)), fpr95.value),
        images=images,
    )


def _sums_by_recording(batches: Iterable[pa.RecordBatch]) -> tuple[dict[str, Histograms], int]:
    """(2, BINS) int64 of each recording, positives and negatives, and the number of images."""
    sums: dict[str, Histograms] = {}
    images = 0
    for batch in batches:
        held = pa.table(batch).filter(pc.is_valid(batch[REFERENCE_COLUMN]))
        codes, names = Columns(held).words("recording")
        counts = [histogram_rows(held[name]) for name in (REFERENCE_COLUMN, OUTSIDE_COLUMN)]
        for number, name in enumerate(names):
            sums[name] = sums.get(name, 0) + np.array([of[codes == number].sum(axis=0) for of in counts])
        images += len(held)
    return sums, images


def _figure(taken: Callable[[Histograms, Histograms], Histograms], of_recording: Histograms, *, cases: int) -> Figure:
    """A figure with its interval, from (S, 2, BINS); the recordings that count are those that hold positives."""
    whole, recordings = of_recording.sum(axis=0), int(np.count_nonzero(of_recording[:, 0].any(axis=1)))
    value, interval = float(taken(*whole)), None
    if recordings >= FEWEST_RECORDINGS:
        without = np.array([taken(*(whole - own)) for own in of_recording])
        pixels = of_recording.sum(axis=(1, 2))
        if np.isfinite(without).all():
            interval = jackknife(value, without, shares=pixels / pixels.sum()).interval(RATIO)
    return Figure(value=value, ci95=interval, cases=cases, recordings=recordings)


def _average_precision(positive: Histograms, negative: Histograms) -> Histograms:
    """(...) from (..., BINS): precision at each edge times the gain in recall of its bin; NaN without positives."""
    tp, fp = _from_above(positive), _from_above(negative)
    return _share((positive * _share(tp, tp + fp, empty=0.0)).sum(axis=-1), positive.sum(axis=-1))


def _rate_at_recall(positive: Histograms, negative: Histograms, *, least: bool = False) -> Histograms:
    """(...) from (..., BINS): false-positive rate at 95 % recall; `least` as if the bin's positives came first."""
    tp, fp, total = _from_above(positive), _from_above(negative), positive.sum(axis=-1)
    enough = RECALL[1] * tp >= RECALL[0] * total[..., None]
    edge = np.count_nonzero(enough, axis=-1) - 1  # recall falls with the edge
    above = np.concatenate([fp, np.zeros_like(fp[..., :1])], axis=-1)
    found = np.take_along_axis(above, (edge + least)[..., None], axis=-1)[..., 0]
    return np.where(total > 0, _share(found, negative.sum(axis=-1)), np.nan)


def _precision_bounds(positive: Histograms, negative: Histograms) -> tuple[float, float]:
    """Least: the bin's negatives first, its positives one by one after them. Most: its positives first, as one."""
    tp, fp = _from_above(positive), _from_above(negative)
    before_tp, before_fp = tp - positive, fp - negative
    # The sum of a / (a + fp) over a = before_tp + 1 ... tp.
    one_by_one = positive - fp * (digamma(tp + fp + 1) - digamma(before_tp + fp + 1))
    at_once = positive * _share(tp, tp + before_fp, empty=0.0)
    total = positive.sum()
    return float(_share(one_by_one.sum(), total)), float(_share(at_once.sum(), total))


def _from_above(histogram: Histograms) -> Histograms:
    """(..., BINS) pixels above the lower edge of each bin."""
    return np.cumsum(histogram[..., ::-1], axis=-1)[..., ::-1]


def _share(part: Histograms, whole: Histograms, *, empty: float = np.nan) -> Histograms:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), empty)

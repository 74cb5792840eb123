"""Scores at every threshold, from histograms that were counted once, and the metrics that need no threshold.

Masks at any edge of the histograms' bins, and so the whole curve, follow without another look at an image. The area
under it and the false-positive rate at 95 % recall are those of masks at these edges, which exist; the order of pixels
within a bin is unknown, so beside them stand the least and the most that any order could give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import digamma

from bench.evaluation.intervals import FEWEST_RECORDINGS, RATIO, jackknife
from bench.evaluation.likelihood import BINS, EDGES, OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.evaluation.rows import Rows, read_parts
from bench.evaluation.summary import Metric, Ratio

IMAGES_AT_ONCE = 4096  # 10 MB of histograms


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThresholdSweep:
    """The metrics of masks "likelihood above the threshold", over all images with a likelihood.

    Attributes:
        thresholds: (K,) float64, increasing; the first, 0, stands for a mask of everything. For scores, `SCORE_EDGES`
            stand instead of these.
        tpr: (K,) float64, share of the pixels of all G; the same as `recall`.
        false_positive_coverage: (K,) float64, mean over images of FP / (width x height).
        precision: (K,) float64, TP / (TP + FP); NaN where nothing is above the threshold.
        recall: (K,) float64, TP / (TP + FN); NaN without any G.
        auprc: area under precision over recall, as the sum of precision x gain in recall; NaN without any G.
        frames: images with a likelihood.
    """

    thresholds: NDArray[np.float64]
    tpr: NDArray[np.float64]
    false_positive_coverage: NDArray[np.float64]
    precision: NDArray[np.float64]
    recall: NDArray[np.float64]
    auprc: float
    frames: int


def threshold_sweep(frames: Rows) -> ThresholdSweep | None:
    """Take the metrics at every edge, a few recordings in memory at a time.

    Args:
        frames: of `FRAMES_SCHEMA`, rows in any order, in memory or stored.

    Returns:
        None for a method without a likelihood.
    """
    reference, outside = np.zeros((2, BINS), dtype=np.int64)
    covered, images = np.zeros(BINS), 0
    for rows, positive, negative in read_histograms(frames):
        reference, outside = reference + positive.sum(axis=0), outside + negative.sum(axis=0)
        area_px = (rows["width"] * rows["height"]).to_numpy()
        for area in np.unique(area_px):
            covered += _above(negative[area_px == area].sum(axis=0)) / area
        images += len(rows)
    if not images:
        return None
    tp, fp, total = _above(reference), _above(outside), int(reference.sum())
    precision = _ratio(tp, tp + fp)
    recall = _ratio(tp, np.full(BINS, total))
    gained = reference / total if total else np.full(BINS, np.nan)
    return ThresholdSweep(
        thresholds=EDGES[:-1].copy(),
        tpr=recall,
        false_positive_coverage=covered / images,
        precision=precision,
        recall=recall,
        # A bin without G gains nothing, whatever its precision, which may be 0/0.
        auprc=float(np.sum(np.where(gained == 0, 0.0, precision * gained))),
        frames=images,
    )


def read_histograms(frames: Rows) -> Iterator[tuple[pd.DataFrame, NDArray[np.int64], NDArray[np.int64]]]:
    """The images with a likelihood, some recordings at a time, and both histograms of each, (N, BINS)."""
    columns = ["recording", "width", "height", REFERENCE_COLUMN, OUTSIDE_COLUMN]
    for rows in read_parts(frames, columns, rows_at_once=IMAGES_AT_ONCE):
        held = rows[rows[REFERENCE_COLUMN].notna()]
        positive, negative = (np.array(held[name].tolist(), dtype=np.int64).reshape(-1, BINS) for name in columns[3:])
        yield held, positive, negative


def _above(histogram: NDArray[np.int64]) -> NDArray[np.int64]:
    """(BINS,) pixels above each lower edge."""
    return np.cumsum(histogram[::-1])[::-1]


def _ratio(numerator: NDArray[np.int64], denominator: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.where(denominator > 0, numerator / np.where(denominator > 0, denominator, 1), np.nan)


RECALL = 19, 20  # 95 % in whole numbers, so that no rounding decides
Histograms = NDArray[np.float64]


class ThresholdFreeMetrics(BaseModel):
    """Metrics of a likelihood over all thresholds together.

    Attributes:
        auprc: area under precision over recall, as the sum of precision x gain in recall (average precision).
        auprc_bounds: least and most that it can be without bins.
        fpr95: share of the negative pixels above the highest edge that leaves at least 95 % of the positive ones above.
        fpr95_bounds: least and most that it can be without bins; `fpr95` is the most.
        images: with a likelihood.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    auprc: Metric
    auprc_bounds: tuple[Ratio, Ratio]
    fpr95: Metric
    fpr95_bounds: tuple[Ratio, Ratio]
    images: int


def threshold_free_metrics(frames: Rows) -> ThresholdFreeMetrics | None:
    """Take the metrics, a few recordings in memory at a time.

    Args:
        frames: of `FRAMES_SCHEMA`, rows in any order, in memory or stored; the histograms null where there is none.

    Returns:
        None for a method without a likelihood.

    Source:
        Davis and Goadrich 2006 (no linear interpolation between points of the curve); Hendrycks and Gimpel 2017 and
        Chan et al. 2021 (false-positive rate at 95 % recall).
    """
    sums, images = _sums_by_recording(frames)
    if not images:
        return None
    of_recording = np.array([sums[name] for name in sorted(sums)], dtype=np.float64)  # (S, 2, BINS)
    positive, negative = of_recording.sum(axis=0)
    fpr95 = _metric(_rate_at_recall, of_recording, cases=int(negative.sum()))
    return ThresholdFreeMetrics(
        auprc=_metric(_average_precision, of_recording, cases=int(positive.sum())),
        auprc_bounds=_precision_bounds(positive, negative),
        fpr95=fpr95,
        fpr95_bounds=(float(_rate_at_recall(positive, negative, least=True)), fpr95.value),
        images=images,
    )


def _sums_by_recording(frames: Rows) -> tuple[dict[str, Histograms], int]:
    """(2, BINS) of each recording, positives and negatives, and the number of images."""
    sums: dict[str, Histograms] = {}
    images = 0
    for rows, positive, negative in read_histograms(frames):
        for name, own in rows.groupby("recording").indices.items():
            sums[str(name)] = np.array([positive[own].sum(axis=0), negative[own].sum(axis=0)], dtype=np.float64)
        images += len(rows)
    return sums, images


def _metric(taken: Callable[[Histograms, Histograms], Histograms], of_recording: Histograms, *, cases: int) -> Metric:
    """A metric with its interval, from (S, 2, BINS); the recordings that count are those that hold positives."""
    whole, recordings = of_recording.sum(axis=0), int(np.count_nonzero(of_recording[:, 0].any(axis=1)))
    value, interval = float(taken(*whole)), None
    if recordings >= FEWEST_RECORDINGS:
        without = np.array([taken(*(whole - own)) for own in of_recording])
        pixels = of_recording.sum(axis=(1, 2))
        if np.isfinite(without).all():
            interval = jackknife(value, without, shares=pixels / pixels.sum()).interval(RATIO)
    return Metric(value=value, ci95=interval, cases=cases, recordings=recordings)


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

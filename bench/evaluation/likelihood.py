"""Scores at every threshold, from histograms that were counted once, and the metrics that need no threshold.

Each image is counted into two histograms over the motion likelihood: pixels of G and pixels of V outside all G and I.
Masks at any edge of the bins, and so the whole curve, follow without another look at an image. The area under it
and false-positive rate at 95 % recall are those of masks at these edges, which exist; the order of pixels within
a bin is unknown, so beside them stand the least and the most that any order could give.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.special import digamma

from bench.evaluation.counts import Regions, sum_over_cells
from bench.evaluation.intervals import FEWEST_RECORDINGS, RATIO, jackknife
from bench.evaluation.row_source import Columns, Rows, RowSource, as_source
from bench.evaluation.summary import Metric, Ratio
from bench.records.segmentation import PAPER_THRESHOLD

# The paper's threshold is an edge, so that its operating point lies on the curve. 20 bins a decade, from a thousandth
# of it to beyond pi, which no weighted mean of angles exceeds.
PER_DECADE = 20
_LOWEST, _HIGHEST = -3 * PER_DECADE, 4 * PER_DECADE
EDGES: NDArray[np.float64] = np.concatenate(
    [[0.0], PAPER_THRESHOLD * 10 ** (np.arange(_LOWEST, _HIGHEST + 1) / PER_DECADE), [np.inf]]
)
EDGES.setflags(write=False)
BINS = len(EDGES) - 1

# A score in [0, 1] is binned by its odds s / (1 - s), since networks crowd at both ends: 20 bins a decade, evenly to
# both sides of 0.5, which is an edge. They reach from odds of 1 : 3162 to 3162 : 1; scores beyond share the end bins.
_MIDDLE = (len(EDGES) - 1) // 2
_ODDS = 10.0 ** ((np.arange(1, BINS) - _MIDDLE) / PER_DECADE)
SCORE_EDGES: NDArray[np.float64] = np.concatenate([[0.0], _ODDS / (1.0 + _ODDS), [np.inf]])
SCORE_EDGES.setflags(write=False)

REFERENCE_COLUMN, OUTSIDE_COLUMN = "likelihood_reference_px", "likelihood_outside_px"
BATCH_IMAGES = 4096  # 10 MB of histograms


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LikelihoodCounts:
    """Pixels of one image by likelihood; bin k is the interval (EDGES[k], EDGES[k + 1]], and bin 0 holds 0 too.

    For a likelihood that is a score, the edges are `SCORE_EDGES`.

    Attributes:
        reference_px: (BINS,) int64, pixels of all G.
        outside_px: (BINS,) int64, pixels of V outside all G and I.
    """

    reference_px: NDArray[np.int64]
    outside_px: NDArray[np.int64]


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


def count_likelihood(
    likelihood: NDArray[np.float32], regions: Regions, *, cell_size_px: int, is_score: bool = False
) -> LikelihoodCounts:
    """Count an image into both histograms.

    Args:
        likelihood: (rows, columns), of each cell; NaN counts as 0, as it is above no threshold.
        regions: of the image.
        cell_size_px: side of a cell, px.
        is_score: whether the likelihood is a score in [0, 1], whose bins have the edges `SCORE_EDGES`.

    Raises:
        ShapeError: the cells do not tile the image.
    """
    bins = find_bins(likelihood, SCORE_EDGES if is_score else EDGES)

    reference_px, outside_px = (
        sum_over_cells(region, bins, cell_size_px=cell_size_px, bins=BINS, name="likelihood", window=window)
        for region, window in ((regions.moving, regions.window), (regions.outside, None))
    )
    return LikelihoodCounts(reference_px=reference_px, outside_px=outside_px)


def find_bins(likelihood: NDArray[np.float32], edges: NDArray[np.float64] = EDGES) -> NDArray[np.int64]:
    """The bin of each likelihood or score, in its shape; k where edges[k] < value <= edges[k + 1], 0 for NaN."""
    return np.searchsorted(edges[1:-1], np.nan_to_num(likelihood, nan=0.0).astype(np.float64), side="left")


def threshold_sweep(frames: Rows) -> ThresholdSweep | None:
    """Take the metrics at every edge, a batch of images in memory at a time.

    Args:
        frames: of `FRAMES_SCHEMA`, rows in any order, in memory or stored.

    Returns:
        None for a method without a likelihood.
    """
    by_area = _sums_by_area(as_source(frames))
    images = sum(count for _, _, count in by_area.values())
    if not images:
        return None
    reference = sum((of_area[0] for of_area in by_area.values()), np.zeros(BINS, dtype=np.int64))
    outside = sum((of_area[1] for of_area in by_area.values()), np.zeros(BINS, dtype=np.int64))
    covered = sum((_above(by_area[area][1]) / area for area in sorted(by_area)), np.zeros(BINS))
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


def histogram_rows(lists: pa.ChunkedArray) -> NDArray[np.int64]:
    """(N, BINS) int64 from a column of histograms without nulls."""
    counts: NDArray[np.int64] = pc.list_flatten(lists).to_numpy().reshape(len(lists), BINS)
    return counts


def _sums_by_area(frames: RowSource) -> dict[int, tuple[NDArray[np.int64], NDArray[np.int64], int]]:
    """Both histograms and the number of images, by width x height."""
    sums: defaultdict[int, tuple[NDArray[np.int64], NDArray[np.int64], int]] = defaultdict(
        lambda: (np.zeros(BINS, dtype=np.int64), np.zeros(BINS, dtype=np.int64), 0)
    )
    for batch in frames.batches(["width", "height", REFERENCE_COLUMN, OUTSIDE_COLUMN], rows=BATCH_IMAGES):
        held = pa.table(batch).filter(pc.is_valid(batch[REFERENCE_COLUMN]))
        area = held["width"].to_numpy() * held["height"].to_numpy()
        reference, outside = (histogram_rows(held[name]) for name in (REFERENCE_COLUMN, OUTSIDE_COLUMN))
        for size in np.unique(area):
            of_size, before = area == size, sums[int(size)]
            sums[int(size)] = (
                before[0] + reference[of_size].sum(axis=0),
                before[1] + outside[of_size].sum(axis=0),
                before[2] + int(np.count_nonzero(of_size)),
            )
    return dict(sums)


def _above(histogram: NDArray[np.int64]) -> NDArray[np.int64]:
    """(BINS,) pixels above each lower edge."""
    return np.cumsum(histogram[::-1])[::-1]


def _ratio(numerator: NDArray[np.int64], denominator: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.where(denominator > 0, numerator / np.where(denominator > 0, denominator, 1), np.nan)


RECALL = 19, 20  # 95 % in whole numbers, so that no rounding decides
COLUMNS = ("recording", REFERENCE_COLUMN, OUTSIDE_COLUMN)
Histograms = NDArray[np.float64]


class ThresholdFreeMetrics(BaseModel):
    """What a likelihood is worth at all thresholds together.

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


def threshold_free_metrics(batches: Iterable[pa.RecordBatch]) -> ThresholdFreeMetrics | None:
    """Take the metrics, one batch of images in memory at a time.

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
    fpr95 = _metric(_rate_at_recall, of_recording, cases=int(negative.sum()))
    return ThresholdFreeMetrics(
        auprc=_metric(_average_precision, of_recording, cases=int(positive.sum())),
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

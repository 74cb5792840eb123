"""Scores at every threshold, from histograms that were counted once, and the metrics that need no threshold.

Masks at any edge of the histograms' bins, and so the whole curve, follow without another look at an image. The area
under it and the false-positive rate at 95 % recall are those of masks at these edges, which exist.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from bench.evaluation.counts import BINS, OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.evaluation.intervals import FEWEST_RECORDINGS, RATIO, jackknife
from bench.evaluation.summary import Metric

IMAGES_AT_ONCE = 4096  # 10 MB of histograms
HISTOGRAMS = REFERENCE_COLUMN, OUTSIDE_COLUMN
HISTOGRAM_COLUMNS = ["recording", "width", "height", *HISTOGRAMS]
BIN_COLUMNS = [f"{name}_{number}" for name in HISTOGRAMS for number in range(BINS)]
Histograms = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThresholdSweep:
    """The metrics of masks "likelihood above the threshold" at every lower edge of the bins, over all images with one.

    Attributes:
        recall: (BINS,) float64, TP / (TP + FN) by increasing threshold, first that of a mask of everything; NaN without
            any G.
        false_positive_coverage: (BINS,) float64, mean over images of FP / (width x height).
    """

    recall: NDArray[np.float64]
    false_positive_coverage: NDArray[np.float64]


def threshold_sweep(frames: Iterable[pd.DataFrame]) -> ThresholdSweep | None:
    """Take the metrics at every edge, one part in memory at a time.

    Args:
        frames: as of `sum_histograms`.

    Returns:
        None for a method without a likelihood.
    """
    by_area = sum_histograms(frames).groupby("area_px").sum()
    if not len(by_area):
        return None
    positive, negative = _histograms(by_area)
    false_shares = (_from_above(negative) / by_area.index.to_numpy()[:, None]).sum(axis=0)
    found = positive.sum(axis=0)
    return ThresholdSweep(
        recall=_share(_from_above(found), found.sum()),
        false_positive_coverage=false_shares / int(by_area["images"].sum()),
    )


RECALL = 19, 20  # 95 % in whole numbers, so that no rounding decides


class ThresholdFreeMetrics(BaseModel):
    """Metrics of a likelihood over all thresholds together.

    Attributes:
        auprc: area under precision over recall, as the sum of precision x gain in recall (average precision).
        fpr95: share of the negative pixels above the highest edge that leaves at least 95 % of the positive ones above.
        images: with a likelihood.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    auprc: Metric
    fpr95: Metric
    images: int


def threshold_free_metrics(frames: Iterable[pd.DataFrame]) -> ThresholdFreeMetrics | None:
    """Take the metrics, one part in memory at a time.

    Args:
        frames: as of `sum_histograms`.

    Returns:
        None for a method without a likelihood.

    Source:
        Davis and Goadrich 2006 (no linear interpolation between points of the curve); Hendrycks and Gimpel 2017 and
        Chan et al. 2021 (false-positive rate at 95 % recall).
    """
    by_recording = sum_histograms(frames).groupby("recording").sum()
    if not len(by_recording):
        return None
    of_recording = np.stack(_histograms(by_recording), axis=1)  # (S, 2, BINS)
    positive, negative = of_recording.sum(axis=0)
    return ThresholdFreeMetrics(
        auprc=_metric(_average_precision, of_recording, cases=int(positive.sum())),
        fpr95=_metric(_rate_at_recall, of_recording, cases=int(negative.sum())),
        images=int(by_recording["images"].sum()),
    )


def sum_histograms(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Sum the histograms of the images with a likelihood, one part in memory at a time.

    Args:
        frames: rows of `FRAMES_SCHEMA` in any order, at least `HISTOGRAM_COLUMNS`, in parts of whole recordings; the
            histograms null where there is none.

    Returns:
        One row for each recording and area of its images, index `recording` and `area_px`: `images`, and the sums of
        both histograms, `BIN_COLUMNS`, whole numbers.
    """
    parts = []
    for rows in frames:
        held = rows[rows[REFERENCE_COLUMN].notna()]
        key = [held["recording"].rename("recording"), (held["width"] * held["height"]).rename("area_px")]
        bins = [np.array(held[name].tolist(), dtype=np.float64).reshape(-1, BINS) for name in HISTOGRAMS]
        wide = pd.DataFrame(np.hstack(bins), index=held.index, columns=BIN_COLUMNS)
        parts.append(wide.assign(images=1).groupby(key).sum())
    return pd.concat(parts)


def _histograms(sums: pd.DataFrame) -> tuple[Histograms, Histograms]:
    """(N, BINS) of each row, positives and negatives."""
    positive, negative = np.split(sums[BIN_COLUMNS].to_numpy(), 2, axis=1)
    return positive, negative


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


def _rate_at_recall(positive: Histograms, negative: Histograms) -> Histograms:
    """(...) from (..., BINS): false-positive rate at the highest edge with 95 % recall; NaN without positives."""
    tp, fp, total = _from_above(positive), _from_above(negative), positive.sum(axis=-1)
    enough = RECALL[1] * tp >= RECALL[0] * total[..., None]
    edge = np.count_nonzero(enough, axis=-1) - 1  # recall falls with the edge
    above = np.take_along_axis(fp, edge[..., None], axis=-1)[..., 0]
    return np.where(total > 0, _share(above, negative.sum(axis=-1)), np.nan)


def _from_above(histogram: Histograms) -> Histograms:
    """(..., BINS) pixels above the lower edge of each bin."""
    return np.cumsum(histogram[..., ::-1], axis=-1)[..., ::-1]


def _share(part: Histograms, whole: Histograms, *, empty: float = np.nan) -> Histograms:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), empty)

"""Each image counted into two histograms over the motion likelihood: pixels of G, and of V outside all G and I."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.counts import Regions, sum_by_kind
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


def count_likelihood(
    likelihood: NDArray[np.float32], regions: Regions, *, cell_size_px: int, is_score: bool = False
) -> dict[str, NDArray[np.int64]]:
    """Count an image into both histograms; bin k is the interval (EDGES[k], EDGES[k + 1]], and bin 0 holds 0 too.

    Args:
        likelihood: (rows, columns), of each cell; NaN counts as 0, as it is above no threshold.
        regions: of the image.
        cell_size_px: side of a cell, px.
        is_score: whether the likelihood is a score in [0, 1], whose bins have the edges `SCORE_EDGES`.

    Returns:
        (BINS,) int64 each, pixels of all G by `REFERENCE_COLUMN`, of V outside all G and I by `OUTSIDE_COLUMN`.

    Raises:
        ShapeError: the cells do not tile the image.
    """
    bins = find_bins(likelihood, SCORE_EDGES if is_score else EDGES)
    return {
        column: sum_by_kind(region, bins, cell_size_px=cell_size_px, bins=BINS, name="likelihood")
        for column, region in ((REFERENCE_COLUMN, regions.moving), (OUTSIDE_COLUMN, regions.outside))
    }


def find_bins(likelihood: NDArray[np.float32], edges: NDArray[np.float64] = EDGES) -> NDArray[np.int64]:
    """The bin of each likelihood or score, in its shape; k where edges[k] < value <= edges[k + 1], 0 for NaN."""
    return np.searchsorted(edges[1:-1], np.nan_to_num(likelihood, nan=0.0).astype(np.float64), side="left")

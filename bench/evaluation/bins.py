"""Half-open bins `[a, b)` of a breakdown; the last one is open to the right."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray


def bin_names(edges: tuple[float, ...]) -> tuple[str, ...]:
    """Names of the bins, for example "[0, 2)", "[2, 4)", "[4, inf)" of the edges 0, 2, 4."""
    return tuple(f"[{low:g}, {high:g})" for low, high in pairwise((*edges, np.inf)))


def number_bins(values: NDArray[np.float64], *, edges: tuple[float, ...]) -> NDArray[np.int64]:
    """The bin of each value.

    Args:
        values: (N,) float64.
        edges: increasing.

    Returns:
        (N,) int64, place in `bin_names(edges)`; -1 for NaN and below the first edge.
    """
    # A value on an edge belongs to the bin that starts there; NaN would be sorted behind all.
    index = np.searchsorted(np.array(edges), values, side="right") - 1
    return np.where(np.isnan(values), -1, index)


def name_bins(values: NDArray[np.float64], *, edges: tuple[float, ...]) -> NDArray[np.object_]:
    """The bin of each value.

    Args:
        values: (N,) float64.
        edges: increasing.

    Returns:
        (N,) names of `bin_names(edges)`; "" for NaN and below the first edge.
    """
    names = np.array(["", *bin_names(edges)], dtype=object)
    return names[number_bins(values, edges=edges) + 1]

"""The slices that the rows of a run are cut into: categories, classes, bins of range, speed and points, cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Columns

ALL_MOVING = "all_moving"
FRAMES = "frames"
CATEGORY = "category"


def bin_names(edges: tuple[float, ...]) -> tuple[str, ...]:
    """Names of the bins, for example "[0, 2)", "[2, 4)", "[4, inf)" of the edges 0, 2, 4."""
    return tuple(f"[{low:g}, {high:g})" for low, high in pairwise((*edges, np.inf)))


def number_bins(values: NDArray[np.float64], *, edges: tuple[float, ...]) -> NDArray[np.int64]:
    """The bin of each value.

    Args:
        values: (N,) float64.
        edges: increasing.

    Returns:
        (N,) int64, index into `bin_names(edges)`; -1 for NaN and below the first edge.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Breakdown:
    """Rows cut into slices.

    Attributes:
        names: of the slices.
        of_row: (N,) int64, index of each row's slice in `names`; -1 for a number that is unknown or below all bins.
    """

    names: tuple[str, ...]
    of_row: NDArray[np.int64]


def object_breakdowns(evaluated: Columns, *, protocol: Protocol, cameras: Sequence[str]) -> dict[str, Breakdown]:
    """The splits of evaluated object-frames by name: "category", "all_moving", then the breakdowns."""
    return {
        CATEGORY: _worded(evaluated, "category", [str(name) for name in protocol.reference.categories]),
        ALL_MOVING: _undivided(evaluated, ALL_MOVING),
        "object_class": _worded(evaluated, "object_class", protocol.reference.classes),
        "range_m": _binned(evaluated, "range_m", protocol.bins.range_m),
        "ego_speed_mps": _binned(evaluated, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": _worded(evaluated, "camera", cameras),
        "points": _binned(evaluated, "points", protocol.bins.points),
    }


def frame_breakdowns(scored: Columns, *, protocol: Protocol, cameras: Sequence[str]) -> dict[str, Breakdown]:
    """The splits of scored image-frames by name: "frames", then the breakdowns."""
    return {
        FRAMES: _undivided(scored, FRAMES),
        "ego_speed_mps": _binned(scored, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": _worded(scored, "camera", cameras),
    }


def slice_name(breakdown: str, name: str) -> str:
    """What a slice is called among all: "crossing", "all_moving", "range_m=[0, 2)"."""
    return name if breakdown in {CATEGORY, ALL_MOVING, FRAMES} else f"{breakdown}={name}"


def _undivided(rows: Columns, name: str) -> Breakdown:
    return Breakdown(names=(name,), of_row=np.zeros(len(rows), dtype=np.int64))


def _worded(rows: Columns, column: str, names: Sequence[str]) -> Breakdown:
    codes, words = rows.words(column)
    numbers = np.array([*(names.index(word) if word in names else -1 for word in words), -1], dtype=np.int64)
    of_row = numbers[codes]
    assert (of_row >= 0).all(), f"every row has one {column} of {list(names)}"
    return Breakdown(names=tuple(names), of_row=of_row)


def _binned(rows: Columns, column: str, edges: tuple[float, ...]) -> Breakdown:
    return Breakdown(names=bin_names(edges), of_row=number_bins(rows.numbers(column), edges=edges))

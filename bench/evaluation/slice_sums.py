"""Sums by recording and slice: all that any figure of a run needs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.evaluation.slices import Split

Column = NDArray[np.float64]
Terms = Mapping[str, Column]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SliceSums:
    """Sums of some terms over the rows of each slice of a split, by recording.

    Attributes:
        names: of the slices, K of them.
        rows: (S, K) int64, how many there are.
        tracks: (S, K) int64, objects that they come from; 0 for image-frames.
        terms: name -> (S, K) float64.
    """

    names: tuple[str, ...]
    rows: NDArray[np.int64]
    tracks: NDArray[np.int64]
    terms: dict[str, NDArray[np.float64]]


def sum_slices(
    split: Split, terms: Terms, *, recording: NDArray[np.int64], recordings: int, track: NDArray[np.int64] | None
) -> SliceSums:
    """Add up the rows of each recording and slice, in their order.

    Args:
        split: of N rows.
        terms: name -> (N,) float64.
        recording: (N,) int64, number of each row's recording.
        recordings: how many there are.
        track: (N,) int64, number of each row's object within all recordings; None for image-frames.
    """
    kinds = len(split.names)
    shape, known = (recordings, kinds), split.of_row >= 0
    whole = bool(known.all())
    cell = (recording * kinds + split.of_row) if whole else (recording[known] * kinds + split.of_row[known])

    def added(values: Column | None) -> NDArray[np.float64]:
        weights = values if whole or values is None else values[known]
        sums = np.bincount(cell, weights=weights, minlength=recordings * kinds)
        return sums.astype(np.float64, copy=False).reshape(shape)

    tracks = np.zeros(shape, dtype=np.int64)
    if track is not None and len(track):
        # The number of a pair of cell and object; each once.
        pairs = pd.unique(cell * (int(track.max()) + 1) + (track if whole else track[known]))
        tracks = np.bincount(pairs // (int(track.max()) + 1), minlength=recordings * kinds).reshape(shape)
    return SliceSums(
        names=split.names,
        rows=added(None).astype(np.int64),
        tracks=tracks,
        terms={name: added(values) for name, values in terms.items()},
    )


def place_sums(parts: Iterable[tuple[NDArray[np.int64], SliceSums]], *, recordings: int) -> SliceSums:
    """Lay parts of other recordings beside each other.

    Args:
        parts: (S',) int64 numbers of the recordings of a part, and their sums; no recording in two parts, terms that
            a part does not have are 0 there.
        recordings: how many there are in all.
    """
    held = list(parts)
    assert held, "at least one part"
    first = held[0][1]
    names = sorted({name for _, sums in held for name in sums.terms})

    def placed(tables: Sequence[NDArray[np.float64] | NDArray[np.int64] | None]) -> NDArray[np.float64]:
        whole = np.zeros((recordings, len(first.names)))
        for (numbers, _), table in zip(held, tables, strict=True):
            if table is not None:
                whole[numbers] = table
        return whole

    return SliceSums(
        names=first.names,
        rows=placed([sums.rows for _, sums in held]).astype(np.int64),
        tracks=placed([sums.tracks for _, sums in held]).astype(np.int64),
        terms={name: placed([sums.terms.get(name) for _, sums in held]) for name in names},
    )

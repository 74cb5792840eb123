"""Ratios of sums over the rows of a table, with their intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bench.evaluation.bootstrap import cluster_interval
from bench.evaluation.summary import Figure

Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cases:
    """Rows to take figures over: the evaluated object-frames, or the scored image-frames.

    Attributes:
        rows: N of them, in canonical order, so that sums do not depend on how the table was sorted.
        recording: (N,) int64, number of the recording of each row.
        weights: (draws, S) int64, from `sequence_weights`, over all recordings of the run.
    """

    rows: pd.DataFrame
    recording: NDArray[np.int64]
    weights: NDArray[np.int64]

    def column(self, name: str) -> NDArray[np.float64]:
        """A numeric column: (N,) float64, NaN where null."""
        return self.rows[name].to_numpy(dtype=np.float64, na_value=np.nan)

    def ratio(self, numerator: ArrayLike, *, over: ArrayLike = 1, where: Rows | None = None) -> Figure:
        """The ratio sum(numerator) / sum(over), the mean of `numerator` by default.

        Args:
            numerator: (N,); any value, NaN included, in rows where `over` is 0.
            over: (N,) or a number, >= 0; rows with 0 are no cases.
            where: (N,) bool, the slice; None for all rows.
        """
        over = np.broadcast_to(np.asarray(over, dtype=np.float64), self.recording.shape)
        rows = over > 0 if where is None else where & (over > 0)
        numerators = self._sums(np.asarray(numerator, dtype=np.float64), rows)
        denominators = self._sums(over, rows)
        cases = float(denominators.sum())
        return Figure(
            value=float(numerators.sum()) / cases if cases else math.nan,
            ci95=cluster_interval(numerators, denominators, weights=self.weights),
            cases=int(cases),
        )

    def _sums(self, values: NDArray[np.float64], rows: Rows) -> NDArray[np.float64]:
        """(S,) sum of each recording."""
        sums = np.bincount(self.recording[rows], weights=values[rows], minlength=self.weights.shape[1])
        return sums.astype(np.float64, copy=False)

"""How many object-frames are found when more than one pixel is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.columns import Columns
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows, as_source
from bench.evaluation.terms import coverage

STEPS = 1000  # finer than any picture
THRESHOLDS: NDArray[np.float64] = np.arange(STEPS + 1) / STEPS
THRESHOLDS.setflags(write=False)
COLUMNS = ("status", "category", "tp", "fn", "chance_tp")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoverageCurve:
    """Object-frames by how much of them is covered.

    Attributes:
        at_least: (STEPS + 1,) int64, those covered by at least `THRESHOLDS`; the first counts any pixel, the paper's
            rule.
        object_frames: all of them.
    """

    at_least: NDArray[np.int64]
    object_frames: int

    @property
    def rate(self) -> NDArray[np.float64]:
        """(STEPS + 1,) float64, share of the object-frames; NaN without any."""
        return self.at_least / self.object_frames if self.object_frames else np.full(STEPS + 1, np.nan)


def coverage_curves(objects: Rows, *, protocol: Protocol) -> dict[str, tuple[CoverageCurve, CoverageCurve]]:
    """The curve of each category and that of chance, a batch of rows in memory at a time.

    Args:
        objects: of `OBJECTS_SCHEMA`, rows in any order, in memory or stored.
        protocol: that the run was made with.

    Returns:
        By category: the curve of its evaluated object-frames, and that against the masks of other frames, over the
        object-frames that have one.
    """
    curves = {str(name): (_nothing(), _nothing()) for name in protocol.reference.categories}
    for batch in as_source(objects).batches(COLUMNS):
        rows = Columns(pa.table(batch))
        evaluated = rows.is_word("status", "evaluated")
        tp, fn, chance_tp = (rows.numbers(name) for name in ("tp", "fn", "chance_tp"))
        for name, (found, by_chance) in curves.items():
            where = evaluated & rows.is_word("category", name)
            has_chance = where & ~np.isnan(chance_tp)
            missed = tp[has_chance] + fn[has_chance] - chance_tp[has_chance]
            curves[name] = (
                _add(found, coverage(tp[where], fn[where])),
                _add(by_chance, coverage(chance_tp[has_chance], missed)),
            )
    return curves


def _nothing() -> CoverageCurve:
    return CoverageCurve(at_least=np.zeros(STEPS + 1, dtype=np.int64), object_frames=0)


def _add(curve: CoverageCurve, covered: NDArray[np.float64]) -> CoverageCurve:
    reached = np.searchsorted(THRESHOLDS, covered, side="right")  # thresholds that are not above it
    from_above = np.cumsum(np.bincount(reached, minlength=STEPS + 2)[::-1])[::-1]
    at_least = from_above[1:].astype(np.int64)
    at_least[0] = np.count_nonzero(covered > 0)
    return CoverageCurve(
        at_least=curve.at_least + at_least,
        object_frames=curve.object_frames + len(covered),
    )

"""Doubts that follow from a track as it stands, whoever made it: a reviewer can mend them, and they are gone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.annotation.store import Doubt

HOLE = 1.5  # usual steps between two states, from which on one is missing


def hole_doubts(times_ns: NDArray[np.int64], step_ns: int) -> tuple[Doubt, ...]:
    """A doubt where a track has no box in sweeps between its first and its last.

    Args:
        times_ns: (N,) int64, of its states, increasing.
        step_ns: usual time between two.
    """
    missing = [round((end - start) / step_ns) - 1 for start, end in holes(times_ns, step_ns)]
    if not missing:
        return ()
    count = max(sum(missing), 1)
    return (Doubt(reason=f"hole of {count} sweep{'s' if count > 1 else ''}", value=count),)


def holes(times_ns: NDArray[np.int64], step_ns: int) -> list[tuple[int, int]]:
    """The last time before each hole and the first time after it."""
    return [(int(start), int(end)) for start, end in pairwise(times_ns) if end - start > HOLE * step_ns]

"""How objects that are known by their points alone move: from the middles of the points over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

SECOND_NS = 1_000_000_000
WINDOW_NS = SECOND_NS  # the visible side of an object changes: shorter windows give its jitter, not its motion


def middle_velocities(times_ns: NDArray[np.int64], middles_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Velocity at each time: the slope of a straight line through the middles half a second before and after.

    Args:
        times_ns: (N,) int64, increasing; mean time of the points.
        middles_m: (N, 3) float64, m, world frame; NaN where unknown.

    Returns:
        (N, 3) float64, m/s, world axes; NaN where fewer than two middles are known within the window.
    """
    velocities = np.full(middles_m.shape, np.nan)
    known = np.flatnonzero(np.isfinite(middles_m).all(axis=1))
    known_ns = times_ns[known]
    first = np.searchsorted(known_ns, times_ns - WINDOW_NS // 2, side="left")
    last = np.searchsorted(known_ns, times_ns + WINDOW_NS // 2, side="right")
    for row in np.flatnonzero(last - first >= 2):
        used = known[first[row] : last[row]]
        seconds = (times_ns[used] - times_ns[row]) / SECOND_NS
        away = seconds - seconds.mean()
        velocities[row] = away @ middles_m[used] / (away @ away)
    return velocities

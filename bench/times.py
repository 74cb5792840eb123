"""Times in nanoseconds, and the unit of those that ought to be, by how far apart they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

SECOND_NS = 1_000_000_000
SHORTEST_STEP_NS, LONGEST_STEP_NS = 4e5, 2e9  # between rows or images of anything on a vehicle
EPOCH_NS = 1e18, 4.6e18  # from 2001 to 2115, where times count from 1970
FACTORS = {10**3: "microseconds", 10**6: "milliseconds", 10**9: "seconds"}


def other_unit(times_ns: ArrayLike) -> tuple[str, int] | None:
    """The unit that times seem to have instead of nanoseconds, and the factor to multiply them by.

    Args:
        times_ns: (N,) numbers, in any order, also some of them several times.

    Returns:
        None where they may be nanoseconds, or where no unit makes steps of 0.4 ms to 2 s of them.
    """
    times = np.sort(np.asarray(times_ns, dtype=np.float64))
    if len(times) < 2 or not np.isfinite(times).all():
        return None
    step = float(np.median(np.diff(times))) or float(times[-1] - times[0]) / (len(times) - 1)
    if not 0 < step < SHORTEST_STEP_NS:
        return None
    possible = [factor for factor in FACTORS if SHORTEST_STEP_NS <= step * factor <= LONGEST_STEP_NS]
    if not possible:
        return None
    factor = min(possible, key=lambda candidate: not EPOCH_NS[0] <= times[0] * candidate <= EPOCH_NS[1])
    return FACTORS[factor], factor


def unit_hint(times_ns: ArrayLike) -> str:
    """Hint on times of another unit; empty where they may be nanoseconds."""
    other = other_unit(times_ns)
    return "" if other is None else f"these would be {other[0]}: multiply them by {other[1]}"

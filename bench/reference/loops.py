"""The loop over patches as machine code; imported on use, since loading the compiler takes a while."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.geometry import Floats
from bench.machine_code import compiled, inlined


@inlined
def _cell(position_px: float, most: int) -> int:
    """First pixel at or beyond a position, clamped to 0 and `most`."""
    return int(min(max(0.0, np.ceil(position_px)), most))


@compiled
def count_patches(u: Floats, v: Floats, counts: NDArray[np.int32]) -> None:
    """Count the convex patches that hold each pixel's centre.

    Every edge adds one to the pixels right of it where it runs down and subtracts one where it runs up, with all
    patches oriented the same way.

    Args:
        u: (4, N) float64, px, of the corners in order, from the window's first pixel.
        v: (4, N), likewise.
        counts: (rows, columns + 1) int32, zeros, to be filled; the last column is none of the window's.
    """
    rows, columns = counts.shape
    for k in range(u.shape[1]):
        area = (u[2, k] - u[0, k]) * (v[3, k] - v[1, k]) - (v[2, k] - v[0, k]) * (u[3, k] - u[1, k])
        if area == 0.0:
            continue
        for corner in range(4):
            following = (corner + 1) % 4
            start_u, start_v, end_v = u[corner, k], v[corner, k], v[following, k]
            first, last = _cell(start_v, rows), _cell(end_v, rows)  # rows of pixels at or below the ends
            if first == last:
                continue
            slope = (u[following, k] - start_u) / (end_v - start_v)
            at_zero = start_u - start_v * slope
            sign = 1 if (area > 0.0) == (last > first) else -1
            for row in range(min(first, last), max(first, last)):
                counts[row, _cell(slope * row + at_zero, columns - 1)] += sign
    for row in range(rows):
        for column in range(1, columns):
            counts[row, column] += counts[row, column - 1]

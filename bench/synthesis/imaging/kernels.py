"""Weights and look-ups that loops over pixels and triangles share; compiled into those that call them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import inlined


@inlined
def corner_weights(
    planes: NDArray[np.float32], t: int | np.integer[Any], x: np.float32, y: np.float32, z: np.float32
) -> tuple[np.float32, np.float32, np.float32]:
    """Weights of a triangle's corners for a ray, see `visibility`; their sum is 1 over the distance."""
    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
    return i, j, k


@inlined
def bilinear(row: np.float32, column: np.float32, values: NDArray[np.float32]) -> np.float32:
    """The value between the four cells around a point."""
    whole_row, whole_column = np.int32(row), np.int32(column)
    a, b = row - np.float32(whole_row), column - np.float32(whole_column)
    i, j = np.uintp(whole_row), np.uintp(whole_column)
    next_i, next_j = i + np.uintp(1), j + np.uintp(1)
    upper = values[i, j] + b * (values[i, next_j] - values[i, j])
    lower = values[next_i, j] + b * (values[next_i, next_j] - values[next_i, j])
    return np.float32(upper + a * (lower - upper))


@inlined
def share_below(row: np.float32, column: np.float32, limit: np.float32, values: NDArray[np.float32]) -> np.float32:
    """Bilinear share of the four cells around a point whose value is at most a limit."""
    zero, one = np.float32(0.0), np.float32(1.0)
    whole_row, whole_column = np.int32(row), np.int32(column)
    a, b = row - np.float32(whole_row), column - np.float32(whole_column)
    i, j = np.uintp(whole_row), np.uintp(whole_column)
    next_i, next_j = i + np.uintp(1), j + np.uintp(1)
    upper = (one - b if values[i, j] <= limit else zero) + (b if values[i, next_j] <= limit else zero)
    lower = (one - b if values[next_i, j] <= limit else zero) + (b if values[next_i, next_j] <= limit else zero)
    return np.float32(upper + a * (lower - upper))

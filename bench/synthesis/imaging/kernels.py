"""Loops over pixels and triangles as machine code that is cached for the next process, and what these loops share.

Without fast-math and threads, so that every run gives the same bytes; floating-point division by zero gives infinity.

Loops over pixels hand many arrays around and make none; counting references to each array costs more than the work
(three times, for shading), so compiled functions count none: they own nothing that could be freed.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

Function = TypeVar("Function", bound=Callable[..., object])

# Cached machine code holds functions and constants of other files too, while numba looks at the function's own file
# only: so there is a cache folder for each state of all of them.
_FILES = sorted(Path(__file__).parent.glob("*.py"))
SOURCES = hashlib.sha256(b"".join(path.read_bytes() for path in _FILES)).hexdigest()
_BESIDE = Path(__file__).parent / "__pycache__"
_WRITABLE = os.access(_BESIDE if _BESIDE.exists() else _BESIDE.parent, os.W_OK)
# Beside a package that an administrator installed its user writes nothing.
CACHE = (_BESIDE if _WRITABLE else user_cache_path("fisheye-bench", appauthor=False)) / f"numba-{SOURCES[:16]}"


def compiled(function: Function) -> Function:
    """Compile a function that makes no arrays, on its first call."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, str(CACHE)
    try:
        return cast(Function, numba.njit(cache=True, **options)(function))
    except (RuntimeError, OSError):  # no folder may be written: compile in every process
        return cast(Function, numba.njit(**options)(function))
    finally:
        config.CACHE_DIR = before


def inlined(function: Function) -> Function:
    """Compile a function into those that call it, which spares them handing over its arguments."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", inline="always")(function))


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

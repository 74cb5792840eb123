"""Machine code for loops over pixels and triangles, kept for the next process.

Without fast-math and threads, so that every run gives the same bytes; floating-point division by zero gives infinity.

Loops over pixels hand many arrays around and make none; counting who holds each array costs more than the work (three
times, for shading), so `looped` leaves it out: its functions own nothing that could be freed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])

# Kept machine code holds functions and constants of other files too; numba by itself looks at the function's own file.
SOURCES = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))).hexdigest()


def compiled(function: Function) -> Function:
    """Compile a function on its first call."""
    return _kept(function)


def looped(function: Function) -> Function:
    """Compile a function that makes no arrays, and hence counts no references."""
    return _kept(function, _nrt=False)


def inlined(function: Function) -> Function:
    """Compile a function into those that call it, which spares them handing over its arguments."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", inline="always")(function))


def _kept(function: Function, **options: Any) -> Function:
    try:
        made: Any = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    except RuntimeError:  # neither the package's folder nor the user's may be written: compile in every process
        return cast(Function, numba.njit(nogil=True, error_model="numpy", **options)(function))
    made._cache._cache_file._source_stamp = SOURCES
    return cast(Function, made)

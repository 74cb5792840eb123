"""Machine code for loops over pixels and triangles, cached for the next process.

Without fast-math and threads, so that every run gives the same bytes; floating-point division by zero gives infinity.

Loops over pixels hand many arrays around and make none; counting references to each array costs more than the work
(three times, for shading), so compiled functions count none: they own nothing that could be freed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])

# Cached machine code holds functions and constants of other files too, while numba looks at the function's own file
# only: so there is a cache folder for each state of all of them.
_FILES = sorted(Path(__file__).parent.glob("*.py"))
SOURCES = hashlib.sha256(b"".join(path.read_bytes() for path in _FILES)).hexdigest()
CACHE = Path(__file__).parent / "__pycache__" / f"numba-{SOURCES[:16]}"


def compiled(function: Function) -> Function:
    """Compile a function that makes no arrays, on its first call."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, str(CACHE)
    try:
        return cast(Function, numba.njit(cache=True, **options)(function))
    except (RuntimeError, OSError):  # the package's folder may not be written: compile in every process
        return cast(Function, numba.njit(**options)(function))
    finally:
        config.CACHE_DIR = before


def inlined(function: Function) -> Function:
    """Compile a function into those that call it, which spares them handing over its arguments."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", inline="always")(function))

"""Loops as machine code that is cached for the next process.

Without fast-math and threads, so that every run gives the same bytes; floating-point division by zero gives infinity.

Compiled functions make no arrays and count no references to those that they are given: counting costs more than the
work of a loop over pixels that hands many arrays around (three times, for shading).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from platformdirs import user_cache_path

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile a function that makes no arrays, on its first call."""
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False}
    config: Any = numba.config
    before, config.CACHE_DIR = config.CACHE_DIR, str(cache_folder(Path(function.__code__.co_filename).parent))
    try:
        return cast(Function, numba.njit(cache=True, **options)(function))
    except (RuntimeError, OSError):  # no folder may be written: compile in every process
        return cast(Function, numba.njit(**options)(function))
    finally:
        config.CACHE_DIR = before


def inlined(function: Function) -> Function:
    """Compile a function into those that call it, which spares them handing over its arguments."""
    return cast(Function, numba.njit(nogil=True, error_model="numpy", inline="always")(function))


def cache_folder(package: Path) -> Path:
    """Folder for the machine code of a package's functions, another one for each state of all its sources.

    Machine code holds functions and constants of the files beside it too, while numba looks at the function's own only.
    """
    sources = hashlib.sha256(b"".join(path.read_bytes() for path in sorted(package.glob("*.py")))).hexdigest()
    beside = package / "__pycache__"
    writable = os.access(beside if beside.exists() else package, os.W_OK)
    # Beside a package that an administrator installed its user writes nothing.
    return (beside if writable else user_cache_path("fisheye-bench", appauthor=False)) / f"numba-{sources[:16]}"

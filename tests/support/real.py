"""Where the real samples lie, and the mark of tests that need them."""

import os
from pathlib import Path

import pytest

REAL = Path(os.environ.get("FISHEYE_BENCH_REAL", "/nonexistent"))

needs_real = pytest.mark.skipif(
    "FISHEYE_BENCH_REAL" not in os.environ, reason="FISHEYE_BENCH_REAL does not name the folder of real samples"
)

from __future__ import annotations

import numpy as np

from bench.synthesis.imaging.compiled import CACHE, SOURCES, compiled


@compiled
def doubled(values: np.ndarray) -> float:
    return float(2.0 * values.sum())


def test_cached_machine_code_belongs_to_the_sources_as_they_are() -> None:
    """By itself numba would take it again when a file changes that the function's own file imports."""
    assert doubled(np.ones(3)) == 6.0
    assert CACHE.name.endswith(SOURCES[:16])
    assert list(CACHE.rglob("*doubled*.nbi"))

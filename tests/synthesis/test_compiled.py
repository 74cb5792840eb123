from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.synthesis.imaging.compiled import SOURCES, compiled


@compiled
def doubled(values: np.ndarray) -> float:
    return float(2.0 * values.sum())


def test_kept_machine_code_belongs_to_the_sources_as_they_are() -> None:
    # numba would keep it when a file changes that the function's own file imports.
    assert doubled(np.ones(3)) == 6.0
    index = Path(doubled._cache._cache_file._index_path)  # type: ignore[attr-defined]
    assert SOURCES.encode() in index.read_bytes()

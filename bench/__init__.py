"""Benchmark of moving-object segmentation in automotive fisheye images.

Moving objects are annotated in the lidar point cloud, projected into the fisheye image, and the bounding
polygon is the reference that a segmentation method is scored against (Mariotti and Eising 2020).

From Python, as docs/reference.md shows: `bench.score` compares arrays; `bench.open_dataset`, `bench.run` and
`bench.load_run` give data sets and runs; most commands are a function of their name, such as `bench.compare` and
`bench.validate`. Each is imported when it is used first. Start reading in `bench.evaluation`. Which package may import
which: docs/maintainers.md.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8"))  # lists the public names, with their types
_MODULES = {
    name.name: str(line.module) for line in _STUB.body if isinstance(line, ast.ImportFrom) for name in line.names
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'bench' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})

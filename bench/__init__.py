"""Benchmark of moving-object segmentation in automotive fisheye images.

Moving objects are annotated in the lidar point cloud, projected into the fisheye image, and the bounding
polygon is the reference that a segmentation method is scored against (Mariotti and Eising 2020).

From Python: `bench.score`, `bench.interval`, `bench.open_dataset`, `bench.run`, `bench.load_run`,
`bench.export_reference`, `bench.read_reference`, `bench.RecordingWriter`, see docs/python.md; each is imported when it
is used first. Start reading in `bench.evaluation`. Which package may import which: docs/architecture.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.api.arrays import Score, interval, score
    from bench.api.datasets import Dataset, Frame, open_dataset
    from bench.api.references import export_reference, read_reference
    from bench.api.runs import Run, load_run, run
    from bench.recordings import RecordingWriter

__version__ = "0.1.0"
__all__ = [
    "Dataset",
    "Frame",
    "RecordingWriter",
    "Run",
    "Score",
    "export_reference",
    "interval",
    "load_run",
    "open_dataset",
    "read_reference",
    "run",
    "score",
]

_PLACES = {
    **dict.fromkeys(("Score", "interval", "score"), "bench.api.arrays"),
    **dict.fromkeys(("Dataset", "Frame", "open_dataset"), "bench.api.datasets"),
    **dict.fromkeys(("export_reference", "read_reference"), "bench.api.references"),
    **dict.fromkeys(("Run", "load_run", "run"), "bench.api.runs"),
    "RecordingWriter": "bench.recordings",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'bench' has no attribute {name!r}")
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})

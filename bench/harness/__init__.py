"""The harness: plan the units of work, run them, store what they count, reduce it to a summary.

The unit is recording x camera x chunk of images. What a unit counted is stored as one file, atomically; the summary is
a pure reduction over these files. A unit that fails is reported and the rest goes on. The harness hands a method
images, calibration and ego-motion, never annotations.
"""

from bench.harness.frames import FramePipeline, ProcessedFrame
from bench.harness.oracles import build_scorable, scorable_methods
from bench.harness.provenance import Provenance
from bench.harness.run import RunRequest, run_benchmark, score_part
from bench.harness.run_folder import run_name
from bench.harness.stored import (
    RunSummary,
    StoredRows,
    StoredRun,
    open_tables,
    read_image_maps,
    read_run,
    read_tables,
)
from bench.harness.unit import Part, Unit, plan_units

__all__ = [
    "FramePipeline",
    "Part",
    "ProcessedFrame",
    "Provenance",
    "RunRequest",
    "RunSummary",
    "StoredRows",
    "StoredRun",
    "Unit",
    "build_scorable",
    "open_tables",
    "plan_units",
    "read_image_maps",
    "read_run",
    "read_tables",
    "run_benchmark",
    "run_name",
    "scorable_methods",
    "score_part",
]

"""The harness: three stages that meet in files.

The **answers** of a method (`answers`), the **references** of the data (`references`) and the **counts** of answers
against references by a protocol (`counts`) are files, one for each task: a recording's camera, in chunks of images. A
file that is there is done, whoever wrote it. `run` plans the tasks, has an executor take the images of each through the
stages and reduces the counts to a summary; `stored` reads it again. What a run is of is its `manifest`. A task or
image that fails is reported and the rest goes on. The harness hands a method images, calibration and ego-motion, never
annotations (`frames`).
"""

from bench.harness.counts import open_tables
from bench.harness.exact import build_scorable, scorable_methods
from bench.harness.frames import FramePipeline, ProcessedFrame
from bench.harness.run import RunRequest, ScoredPart, parse_part, run_benchmark, score_part
from bench.harness.stored import Provenance, RunSummary, StoredRun, read_run, read_tables

__all__ = [
    "FramePipeline",
    "ProcessedFrame",
    "Provenance",
    "RunRequest",
    "RunSummary",
    "ScoredPart",
    "StoredRun",
    "build_scorable",
    "open_tables",
    "parse_part",
    "read_run",
    "read_tables",
    "run_benchmark",
    "scorable_methods",
    "score_part",
]

"""What is computed elsewhere for a run: the two tasks, and a Dask cluster as a place for them.

What a unit comes to does not depend on where it was computed; see `bench.parallel` for the contract of a place.
"""

from bench.harness.work.cluster import Cluster, Terms, scheduler_address
from bench.harness.work.tasks import (
    PlannedRecording,
    RunSpec,
    ScoredUnit,
    UnitTask,
    plan_recording,
    score_unit,
)

__all__ = [
    "Cluster",
    "PlannedRecording",
    "RunSpec",
    "ScoredUnit",
    "Terms",
    "UnitTask",
    "plan_recording",
    "scheduler_address",
    "score_unit",
]

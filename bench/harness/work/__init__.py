"""Where the units of a run are computed: here, in processes side by side, or on a cluster.

What a unit comes to does not depend on where it was computed. A place to compute gives back what was done as it is
done, and says which tasks were lost with the process that worked on them.
"""

from bench.harness.work.cluster import Cluster, Terms, scheduler_address
from bench.harness.work.places import Lost, Place, in_turn, staying
from bench.harness.work.processes import Processes, usable_cores
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
    "Lost",
    "Place",
    "PlannedRecording",
    "Processes",
    "RunSpec",
    "ScoredUnit",
    "Terms",
    "UnitTask",
    "in_turn",
    "plan_recording",
    "scheduler_address",
    "score_unit",
    "staying",
    "usable_cores",
]

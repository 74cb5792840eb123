"""Units on a Dask cluster that is there already: executor, what its workers must have, and examples of starting one.

The process that the command starts plans, hands out tasks and stores what comes back; workers only read data and keep
steps in their cache. Whatever dies, stored units stay, and the same command goes on from there.
"""

from bench.harness.cluster.connection import scheduler_address
from bench.harness.cluster.executor import ClusterExecutor
from bench.harness.cluster.requirements import WorkerRequirements

__all__ = ["ClusterExecutor", "WorkerRequirements", "scheduler_address"]

"""Files that start a run on many machines, ready to be filled in: for SLURM with and without Dask, for Kubernetes."""

from bench.harness.cluster.examples.reading import EXAMPLES, cluster_example

__all__ = ["EXAMPLES", "cluster_example"]

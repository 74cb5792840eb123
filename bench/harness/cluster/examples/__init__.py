"""Files that start a run on many machines, ready to be filled in: for SLURM with and without Dask, for Kubernetes."""

from __future__ import annotations

from importlib import resources

from bench.errors import UnknownNameError

EXAMPLES = {"slurm-array": "slurm-array.sh", "slurm-dask": "slurm-dask.sh", "kubernetes": "kubernetes.yaml"}


def cluster_example(name: str) -> str:
    """The text of an example.

    Args:
        name: one of `EXAMPLES`.

    Raises:
        UnknownNameError: another one.
    """
    if name not in EXAMPLES:
        raise UnknownNameError("example", name, EXAMPLES)
    return resources.files(__name__).joinpath(EXAMPLES[name]).read_text(encoding="utf-8")

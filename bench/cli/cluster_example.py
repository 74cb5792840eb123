"""`cluster-example`: files that start a run on many machines."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli.console import write_out


def cluster_example(
    name: Annotated[str, typer.Argument(help="slurm-array, slurm-dask or kubernetes.")],
) -> None:
    """Print a file that starts a run on many machines, ready to be filled in."""
    from bench.harness.cluster import examples

    write_out(examples.cluster_example(name))

"""`merge`: one run of the parts that `run --shard` scored."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli import options


def merge(
    run: Annotated[str, typer.Argument(help="Folder of the run that is made.")],
    parts: Annotated[
        list[str] | None, typer.Argument(help="Folders that hold the parts, where they are not in RUN itself.")
    ] = None,
    overwrite: options.Overwrite = False,
    pictures: options.Pictures = True,
) -> None:
    """Make one run of the parts that `run --shard` scored."""
    from bench.cli import runs

    if runs.merge(run, parts or [], overwrite=overwrite, pictures=pictures):
        raise typer.Exit(options.FAILURES)

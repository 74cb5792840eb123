"""`run`: the main job, data set in, table out."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli.options import (
    FAILURES,
    Cache,
    Dataset,
    InputErrors,
    MethodName,
    NoCache,
    Overwrite,
    Pictures,
    Protocols,
    Scheduler,
    Settings,
    Split,
    Workers,
)


def run(
    dataset: Dataset,
    method: MethodName = "spherical",
    set_: Settings = None,
    input_error: InputErrors = None,
    protocol: Protocols = "paper-v1",
    split: Split = None,
    out: Annotated[
        str | None,
        typer.Option(metavar="FOLDER", help="Folder of the run; default: reports/runs/<data set>-<method>."),
    ] = None,
    overwrite: Overwrite = False,
    pictures: Pictures = True,
    workers: Workers = None,
    cache: Cache = None,
    no_cache: NoCache = False,
    scheduler: Scheduler = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Score part I of N only; `merge` joins the parts.")
    ] = None,
) -> None:
    """Score a method on a data set: the paper's table, the range maps, pictures.

    A run that was interrupted continues where it stopped, by the same command.
    """
    from bench.cli import runs
    from bench.cli.request import Computing

    asked = runs.ScoringOptions(
        dataset=dataset,
        method=method,
        settings=set_ or [],
        input_errors=input_error or [],
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
        computing=Computing(workers=workers, cache=cache, no_cache=no_cache, scheduler=scheduler),
    )
    failures = runs.run(asked, pictures=pictures) if shard is None else runs.run_part(asked, part=shard)
    if failures:
        raise typer.Exit(FAILURES)

"""`run`: the main job, data set in, table out."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli import options


def run(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    set_: options.Settings = None,
    input_error: options.InputErrors = None,
    protocol: options.Protocols = "paper-v1",
    split: options.Split = None,
    out: Annotated[
        str | None,
        typer.Option(metavar="FOLDER", help="Folder of the run; default: reports/runs/<data set>-<method>."),
    ] = None,
    overwrite: options.Overwrite = False,
    pictures: options.Pictures = True,
    workers: options.Workers = None,
    cache: options.Cache = None,
    no_cache: options.NoCache = False,
    scheduler: options.Scheduler = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Score part I of N only; the command without it ends the run.")
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
        raise typer.Exit(options.FAILURES)

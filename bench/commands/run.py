"""`run`: the main job, data set in, table out."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.commands import options
from bench.commands.command import TEXT, Place
from bench.commands.console import FAILURES, print_failures, say
from bench.commands.progress import Report, progress_bar, resumable
from bench.commands.runs import PROTOCOLS, Run, print_cost, print_runs, score


def run(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    *,
    settings: options.Settings = None,
    input_errors: options.InputErrors = None,
    protocol: options.Protocols = PROTOCOLS,
    split: options.Split = None,
    out: Annotated[
        Place,
        typer.Option(metavar="FOLDER", help="Folder of the run; default: reports/runs/<data set>-<method>."),
        TEXT,
    ] = None,
    overwrite: options.Overwrite = False,
    pictures: options.Pictures = True,
    workers: options.Workers = 1,
    shard: Annotated[
        str | None,
        typer.Option(metavar="I/N", help="Score only part I of N; the same command without --shard finishes the run."),
    ] = None,
    progress: Report | None = None,
) -> Run:
    """Score a method on a data set; write tables and pictures.

    An interrupted run continues with the same command. The method is asked once, whatever the
    number of protocols.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        method: by name, as "module:Class", or an object of a class that derives from `bench.methods.Method`.
        settings: parameters of a method that is given by name.
        input_errors: injected into what the method is given, by the names of `bench.recordings.InputErrors`, for
            example `{"pitch_deg": 0.5}`; the reference keeps the truth.
        protocol: names or files with commas in between.
        split: of the data set; None for all of it.
        out: folder of the run; None for `reports/runs/<data set>-<method>`.
        overwrite: replace another run in the folder.
        pictures: also draw an example frame of every category.
        workers: processes, or an executor, of `bench.execution` or any of `concurrent.futures`. More than one need a
            method that can be imported, not one of a notebook's cell, and in a program `if __name__ == "__main__":`
            around the call.
        shard: "I/N" for a part of the work, to be shared by several machines; the same call without it ends the run.
        progress: called with the images done and their number.

    Returns:
        The results by the first protocol; `others` are those by the others.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: settings that the method does not take, or beside an object; an input error that is no number.
        DataError: nothing of the data set could be used, or `out` holds another run.
    """
    from bench.commands.data import as_executor, rendered_card
    from bench.commands.runs import run_request
    from bench.harness import Part, score_part

    request = run_request(
        dataset,
        method,
        settings=settings,
        input_errors=input_errors,
        protocol=protocol,
        split=split,
        out=out,
        overwrite=overwrite,
    )
    part = None if shard is None else Part.parse(shard)
    executor = as_executor(workers)
    rendered_card(request.card, request.split, executor=executor)
    if part is None:
        hint = f"a run does not validate its data; check them with: fisheye-bench validate {request.card.address}"
        remarks = [hint] if request.card.scenario is None else []
        return score(request, executor=executor, pictures=pictures, remarks=remarks, progress=progress)
    title = f"scoring part {part} of {request.card.name}"
    with resumable(request.folder), progress_bar(title, "images", progress) as report:
        return Run(folder=request.folder, part=score_part(request, part, executor=executor, progress=report))


def show(scored: Run) -> int:
    """Print the run, or what was done of a part of one."""
    return print_runs(scored) if scored.part is None else _show_part(scored)


def _show_part(scored: Run) -> int:
    part = scored.part
    assert part is not None
    done = sum(not outcome.failure for outcome in part.tasks.values())
    say(
        f"{done} of the {len(part.tasks)} tasks of this part are done in {scored.folder}, of {part.tasks_of_run} in all"
    )
    say("next, when all parts are done: the same command without --shard")
    print_cost(part.provenance(images=0))
    print_failures(part.failures, all_in="the summary.json of the finished run")
    return FAILURES if part.failures else 0

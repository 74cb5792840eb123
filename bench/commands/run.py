"""`run`: the main job, data set in, table out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.console import note, print_failures, say
from bench.commands.progress import Report, progress_bar, resumable
from bench.commands.runs import print_cost, print_run, score
from bench.commands.validate import print_findings, validate
from bench.errors import DataError, UsageError

if TYPE_CHECKING:
    from bench.api.runs import Run
    from bench.execution import TaskExecutor
    from bench.harness import Part, RunRequest
    from bench.methods import Method
    from bench.recordings import DatasetCard
    from bench.validation import ValidationReport

LEADERBOARD = Path("reports/leaderboard/leaderboard.json")  # as `make leaderboard` wrote it; else the one that ships


def run(
    dataset: str | Path | DatasetCard,
    method: str | Method = "spherical",
    *,
    settings: Mapping[str, object] | None = None,
    protocol: str | Path = "paper-v1",
    split: str | None = None,
    input_errors: Mapping[str, object] | None = None,
    out: str | Path | None = None,
    overwrite: bool = False,
    workers: int | TaskExecutor = 1,
    progress: Report | None = None,
) -> Run:
    """Score a method on a data set and store the run with its tables and range maps.

    A run that was interrupted continues where it stopped, by the same call; of another protocol, no method is asked.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        method: by name, as "module:Class", or an object of a class that derives from `bench.methods.Method`.
        settings: parameters of a method that is given by name.
        protocol: by name or file.
        split: of the data set; None for all of it.
        input_errors: injected into what the method is given, by the names of `bench.recordings.InputErrors`, for
            example `{"pitch_deg": 0.5}`; the reference keeps the truth.
        out: folder of the run; None for `reports/runs/<data set>-<method>`.
        overwrite: replace another run in the folder.
        workers: processes, or an executor. More than one need a method that can be imported, not one of a notebook's
            cell, and in a program `if __name__ == "__main__":` around the call.
        progress: called with the images done and their number.

    Raises:
        UnknownNameError: no data set, method, protocol, split or input error of this name.
        UsageError: settings that the method does not take, or beside an object; an input error that is no number.
        DataError: nothing of the data set could be used, or `out` holds another run.
    """
    from bench.api.datasets import as_executor
    from bench.api.runs import Run, run_request
    from bench.commands.request import rendered_card
    from bench.harness import run_benchmark
    from bench.reporting.run_tables import write_report_files

    request = run_request(
        dataset,
        method,
        settings=settings,
        protocols=[protocol],
        split=split,
        input_errors=input_errors,
        out=out,
        overwrite=overwrite,
    )
    executor = as_executor(workers)
    rendered_card(request.card, split, executor=executor)
    asked = replace(request, executor=executor, progress=progress)
    (found,) = run_benchmark(asked, finish=write_report_files)
    return Run(stored=found)


def command(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    settings: options.Settings = None,
    input_errors: options.InputErrors = None,
    protocol: options.Protocols = "paper-v1",
    split: options.Split = None,
    recording: Annotated[list[str] | None, typer.Option(help="Score this recording only; repeatable.")] = None,
    limit: Annotated[
        int | None,
        typer.Option(min=2, max=10**9 - 1, metavar="N", help="Quick look: the first N images of each camera."),
    ] = None,
    out: Annotated[
        str | None,
        typer.Option(metavar="FOLDER", help="Folder of the run; default: reports/runs/<data set>-<method>."),
    ] = None,
    overwrite: options.Overwrite = False,
    require_valid: Annotated[
        bool, typer.Option("--require-valid", help="Validate the data first; refuse errors, put the rest on the page.")
    ] = False,
    pictures: options.Pictures = True,
    workers: options.Workers = 1,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Score part I of N only; the command without it ends the run.")
    ] = None,
) -> int:
    """Score a method on a data set: the paper's table, the range maps, pictures.

    A run that was interrupted continues where it stopped, by the same command.
    """
    from bench.api.datasets import as_executor
    from bench.api.runs import run_request
    from bench.commands.request import rendered_card
    from bench.harness import Part
    from bench.recordings.cards import shipped_folder
    from bench.reporting.leaderboard import best_line

    request = run_request(
        dataset,
        method,
        settings=settings,
        input_errors=input_errors,
        protocols=[name.strip() for name in protocol.split(",")],
        split=_part_of_data(split, recording, limit),
        out=out,
        overwrite=overwrite,
    )
    part = None if shard is None else Part.parse(shard)
    request = replace(request, executor=as_executor(workers))
    rendered_card(request.card, request.split, executor=request.executor)
    validation = _validated(request) if require_valid else None
    if part is not None:
        failed = _run_part(request, part)
    else:
        scored = score(request, pictures=pictures, validation=validation)
        for stored, report in scored:
            print_run(stored, report)
        failed = any(stored.summary.failures for stored, _ in scored)
        if request.card.scenario is None and validation is None:
            note(f"a run does not validate its data; check them with: fisheye-bench validate {dataset}")
        board = LEADERBOARD if LEADERBOARD.is_file() else shipped_folder("leaderboard") / LEADERBOARD.name
        if best := best_line(board, dataset=request.card.name, beside=scored[-1][0].protocol.name):
            say(best)
    return options.FAILURES if failed else 0


def _part_of_data(split: str | None, recordings: list[str] | None, limit: int | None) -> str | None:
    """The split that the options name together, as `open_dataset` reads it."""
    if split is not None and recordings:
        raise UsageError("--recording: expected none beside --split, which takes recordings as well")
    chosen = ",".join(recordings) if recordings else split
    return chosen if limit is None else f"{chosen or ''}[:{limit}]"


def _validated(request: RunRequest) -> ValidationReport:
    """Validate the data of a run and print what is wrong with them.

    Raises:
        DataError: it is more than warnings.
    """
    from bench.validation import Severity

    report = validate(request.card, split=request.split)
    print_findings(report)
    if errors := report.count(Severity.ERROR):
        expected, got = "data that validate finds no errors in", f"{errors} errors"
        hint = "correct them, leave these recordings out in the card, or run without --require-valid"
        raise DataError(request.card.file, expected=expected, got=got, hint=hint)
    return report


def _run_part(request: RunRequest, part: Part) -> bool:
    """Score a part of the tasks and say what comes next; return whether something failed."""
    from bench.harness import score_part

    with resumable(request.folder), progress_bar(f"scoring part {part} of {request.card.name}", "images") as progress:
        scored = score_part(replace(request, progress=progress), part)
    done = sum(not outcome.failure for outcome in scored.tasks.values())
    say(f"part {part}: {done} of its {len(scored.tasks)} tasks are done in {request.folder}, of {scored.tasks_of_run} "
        f"in all; the same command without --shard ends the run")  # fmt: skip
    print_cost(scored.provenance(images=0))
    print_failures(scored.failures, all_in="the summary.json of the finished run")
    return bool(scored.failures)

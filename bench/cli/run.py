"""`run`: the main job, data set in, table out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note, print_failures, say
from bench.cli.progress import progress_bar, resumable
from bench.errors import DataError, UsageError

if TYPE_CHECKING:
    from bench.harness import Part, RunRequest
    from bench.validation import ValidationReport

LEADERBOARD = Path("reports/leaderboard/leaderboard.json")  # as `make leaderboard` wrote it; else the one that ships


def run(
    dataset: options.Dataset,
    method: options.MethodName = "spherical",
    set_: options.Settings = None,
    input_error: options.InputErrors = None,
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
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Score part I of N only; the command without it ends the run.")
    ] = None,
) -> None:
    """Score a method on a data set: the paper's table, the range maps, pictures.

    A run that was interrupted continues where it stopped, by the same command.
    """
    from bench.api.runs import run_request
    from bench.cli.request import equip, rendered_card
    from bench.cli.runs import score
    from bench.harness import Part
    from bench.methods.settings import parse_settings
    from bench.recordings.cards import shipped_folder
    from bench.reporting.leaderboard.texts import best_line

    request = run_request(
        dataset,
        method,
        settings=parse_settings(set_),
        input_errors=parse_settings(input_error, option="--input-error"),
        protocols=[name.strip() for name in protocol.split(",")],
        split=_part_of_data(split, recording, limit),
        out=out,
        overwrite=overwrite,
    )
    part = None if shard is None else Part.parse(shard)
    rendered_card(request.card, request.split)
    validation = _validated(request) if require_valid else None
    request = equip(request, workers=workers, scheduler=scheduler)
    if part is not None:
        failed = _run_part(request, part)
    else:
        title = f"scoring {request.method.name} on {request.card.name}"
        runs = score(request, title=title, pictures=pictures, validation=validation)
        failed = any(run.summary.failures for run in runs)
        if request.card.scenario is None and validation is None:
            note(f"a run does not validate its data; check them with: fisheye-bench validate {dataset}")
        board = LEADERBOARD if LEADERBOARD.is_file() else shipped_folder("leaderboard") / LEADERBOARD.name
        if best := best_line(board, dataset=request.card.name, beside=runs[-1].protocol.name):
            say(best)
    if failed:
        raise typer.Exit(options.FAILURES)


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
    from bench.cli.validate import show_findings
    from bench.validation import Severity

    report = show_findings(request.card, request.split)
    if errors := report.count(Severity.ERROR):
        expected, got = "data that validate finds no errors in", f"{errors} errors"
        hint = "correct them, leave these recordings out in the card, or run without --require-valid"
        raise DataError(request.card.file, expected=expected, got=got, hint=hint)
    return report


def _run_part(request: RunRequest, part: Part) -> bool:
    """Score a part of the tasks and say what comes next; return whether something failed."""
    from bench.cli.runs import print_cost
    from bench.harness import score_part

    with resumable(request.folder), progress_bar(f"scoring part {part} of {request.card.name}", "images") as progress:
        scored = score_part(replace(request, progress=progress), part)
    done = sum(not outcome.failure for outcome in scored.tasks.values())
    say(f"part {part}: {done} of its {len(scored.tasks)} tasks are done in {request.folder}, of {scored.tasks_of_run} "
        f"in all; the same command without --shard ends the run")  # fmt: skip
    print_cost(scored.provenance(images=0))
    print_failures(scored.failures, all_in="the summary.json of the finished run")
    return bool(scored.failures)

"""`verify`: does a run hold what its answers score?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import TEXT
from bench.commands.console import say
from bench.commands.progress import Report, progress_bar

if TYPE_CHECKING:
    from bench.harness.verify import Verification
    from bench.recordings import DatasetCard


def verify(
    run: options.StoredRun,
    dataset: Annotated[
        str | Path | DatasetCard | None,
        typer.Option("--data", metavar="CARD", help="The data set; default: the card that the run names."),
        TEXT,
    ] = None,
    *,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Verification:
    """Count a run again from its stored answers and the data, without its method, and say what differs.

    Exits with 0 where nothing does, and your leaderboards call the run verified; with 1 where something differs.

    Args:
        run: stored, or its folder.
        dataset: card, by path or by name.
        workers: processes, or an executor, that count.
        progress: called with the images done and their number.

    Returns:
        `differences`, one line each, none of a run that holds what its answers score; and `images`, how many were
        counted.

    Raises:
        UnknownNameError: no data set of this name.
        DataError: a file of the run or of the data is missing or damaged.
    """
    from bench.api.datasets import as_executor
    from bench.api.runs import load_run, run_folder
    from bench.commands.request import rendered_card
    from bench.harness.verify import verify_run

    folder, executor = run_folder(run), as_executor(workers)
    of_run = load_run(folder).manifest.dataset
    card = rendered_card(of_run.card if dataset is None else dataset, of_run.split, executor=executor)
    with progress_bar(f"counting {folder.name} again", "images", progress) as report:
        return verify_run(folder, card, executor=executor, progress=report)


def show(found: Verification) -> int:
    """Print what differs; 1 where something does."""
    for line in found.differences:
        say(f"differs: {line}", style="red")
    if not found.differences:
        say(f"equal: the run holds what its answers score, {found.images} images counted again")
    return 1 if found.differences else 0

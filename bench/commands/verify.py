"""`verify`: does a run hold what its answers score?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import TEXT
from bench.commands.console import Report, note, progress_bar, say
from bench.commands.run import NamedRun, load_run, run_folder
from bench.errors import UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.harness.verify import Verification
    from bench.recordings import DatasetCard


def verify(
    run: NamedRun,
    dataset: Annotated[str | Path | DatasetCard | None, typer.Option("--data", metavar="CARD"), TEXT] = None,
    *,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> Verification:
    """Recount a run from its stored answers and the data, without its method, and list differences.

    Exit status 0 if nothing differs (your leaderboards then mark the run as verified), 1 if something does.

    Args:
        run: stored, or its folder.
        dataset: your copy of the data; default: the shipped card of this name.
        workers: processes, or an executor, that count.
        progress: called with the images done and their number.

    Returns:
        `differences`, one line each, none of a run that holds what its answers score; and `images`, how many were
        counted.

    Raises:
        UnknownNameError: no data set of this name.
        UsageError: no `dataset`, and the run is of none that ships.
        DataError: a file of the run or of the data is missing or damaged.

    Examples:
        fisheye-bench verify reports/runs/demo-spherical
    """
    from bench.harness.verify import verify_run

    folder, executor = run_folder(run), options.as_executor(workers)
    card = card_to_verify(folder, dataset)
    note(f"data: card {card.file}, root {card.root}")
    card = options.rendered_card(card, load_run(folder).manifest.dataset.split, executor=executor)
    with progress_bar(f"counting {folder.name} again", "images", progress) as report:
        return verify_run(folder, card, executor=executor, progress=report)


def card_to_verify(run: Path, dataset: str | Path | DatasetCard | None) -> DatasetCard:
    """The card by which a run is counted again; never one that only the run names.

    Args:
        run: its folder.
        dataset: as of `verify`.

    Raises:
        UnknownNameError: no data set of this name.
        UsageError: no `dataset`, and the run is of none that ships.
        DataError: the card cannot be read.
    """
    from bench.harness.datasets import shipped_card

    if dataset is not None:
        return options.as_card(dataset)
    name = load_run(run).manifest.dataset.name
    if (shipped := shipped_card(name)) is None:
        raise UsageError(
            f"{run}: expected a run of a data set that ships with the package, got {name!r}; "
            f"name the card of your own copy with --data"
        )
    return shipped


def show(verification: Verification) -> int:
    """Print what differs; 1 where something does."""
    for line in verification.differences:
        say(f"differs: {line}", style="red")
    if not verification.differences:
        say(f"equal: the run holds what its answers score, {counted(verification.images, 'image')} counted again")
    return 1 if verification.differences else 0

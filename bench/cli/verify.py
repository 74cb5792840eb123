"""`verify`: does a run hold what its answers score?"""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import say
from bench.cli.progress import progress_bar


def verify(
    run: options.StoredRun,
    data: Annotated[
        str | None,
        typer.Option(metavar="CARD", help="Your copy of the data; default: the card of this name that ships."),
    ] = None,
    workers: options.Workers = None,
) -> None:
    """Count a run again from its stored answers and the data, without its method, and say what differs.

    Exits with 0 where nothing does, and your leaderboards call the run verified; with 1 where something differs.
    """
    from bench.api.runs import load_run, run_folder
    from bench.api.verify import card_to_verify, verify
    from bench.cli.request import rendered_card, worker_processes

    folder = run_folder(run)
    card = card_to_verify(folder, data)
    say(f"data: card {card.file}, root {card.root}")
    card = rendered_card(card, load_run(folder).manifest.dataset.split)
    with progress_bar(f"counting {folder.name} again", "images") as progress:
        found = verify(folder, card, workers=worker_processes(workers), progress=progress)
    for line in found.differences:
        say(f"differs: {line}", style="red")
    if found.differences:
        raise typer.Exit(1)
    say(f"equal: {folder} holds what its answers score, {found.images} images counted again")

"""`leaderboard`: all methods on one page, scored first where that is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import note_files, say, say_damaged, show
from bench.cli.progress import interruptible, progress_bar
from bench.errors import BenchError, UsageError


def leaderboard(
    folder: Annotated[Path, typer.Argument(help="Folder that holds runs at any depth.")] = Path("reports/runs"),
    score: Annotated[
        list[str] | None,
        typer.Option(metavar="DATASET", help="First score all methods on this data set, into FOLDER; repeatable."),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="With --score: these methods; settings behind colons, as in spherical:flow=dis. Default: all that are "
            "registered, and on rendered data the exact masks.",
        ),
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="With --score: protocols with commas in between, in one pass.")
    ] = "paper-v1,surface-v1",
    out: Annotated[
        Path | None, typer.Option(help="Also write the page, the chart, leaderboard.md, .csv, .json into this folder.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Show methods on the same images, from rendered data sets.")] = True,
    workers: options.Workers = None,
) -> None:
    """List all runs of a folder, those that compare in one table each; with --score, make them first.

    Runs that are there and up to date are not computed again.
    """
    from bench.api.leaderboard import leaderboard
    from bench.reporting.leaderboard.texts import leaderboard_tables

    if score is None and (methods is not None or workers is not None):
        raise UsageError("leaderboard: expected --score beside --methods and --workers, which say how to score")
    failures = sum(
        score_all(dataset, methods=methods, protocol=protocol, runs=folder, workers=workers) for dataset in score or ()
    )
    with progress_bar("drawing the same images", "runs") as progress:
        ranked = leaderboard(folder, out=out, pictures=pictures, progress=progress)
    show(leaderboard_tables(ranked.found))
    say_damaged(ranked.found.damaged)
    for problem in ranked.problems:
        say(f"no picture: {problem}", style="yellow")
    note_files(ranked.files)
    if ranked.found.damaged or failures:
        raise typer.Exit(options.FAILURES)


def score_all(dataset: str, *, methods: str | None, protocol: str, runs: Path, workers: int | None) -> int:
    """Score methods on a data set, each by all protocols in one pass; what is there and up to date is not computed.

    Args:
        dataset: card, or its name.
        methods: as `competitors`.
        protocol: names or files, with commas in between.
        runs: folder of runs; those of the data set go into one below it that is called as the data set.
        workers: processes; None for one per core.

    Returns:
        How many methods, images, units and recordings could not be used; each method's reason is printed.
    """
    from bench.api.leaderboard import competitors, score_competitor
    from bench.cli.request import rendered_card, worker_processes

    card = rendered_card(dataset)
    failures, left = 0, "what is scored stays, and the same command goes on from there"
    protocols = [name.strip() for name in protocol.split(",")]
    for competitor in competitors(card, methods):
        try:
            with interruptible(left), progress_bar(f"scoring {competitor.name} on {card.name}", "images") as progress:
                scored = score_competitor(
                    card,
                    competitor,
                    protocols=protocols,
                    runs=runs,
                    workers=worker_processes(workers),
                    progress=progress,
                )
        except BenchError as error:
            say(f"left out: {card.name}, {competitor.folder}: {error}", style="red")
            failures += 1
            continue
        failures += max(len(run.summary.failures) for run in scored)
        asked = scored[0].summary.provenance.images_asked
        say(f"{card.name}, {competitor.folder}: {asked} images answered, the others were there")
    return failures

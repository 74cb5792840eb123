"""`leaderboard`: all methods on one page, scored first where that is asked for."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli import options
from bench.cli.console import note_files, say, show
from bench.cli.progress import interruptible, progress_bar
from bench.errors import BenchError, UsageError

if TYPE_CHECKING:
    from bench.cli.request import Computing
    from bench.harness import RunRequest, RunSummary
    from bench.recordings import DatasetCard

# Settings that make another method of one; the others come from the registry alone.
VARIANTS = {"spherical": ("flow=dis", "first_guess=true")}
EXACT_FLOW = "exact-flow"
# Beside the methods, on data with truth: the exact masks, the same on the paper's cells, and exact flow.
CEILINGS = ("truth", "truth:cell_size_px=5", EXACT_FLOW)


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
            "registered, and on rendered data the exact masks and exact flow.",
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
    cache: options.Cache = None,
    no_cache: options.NoCache = False,
) -> None:
    """List all runs of a folder, those that compare in one table each; with --score, make them first.

    Runs that are there and up to date are not computed again.
    """
    from bench.cli.request import Computing
    from bench.reporting.leaderboard.page import write_leaderboard
    from bench.reporting.leaderboard.reading import read_leaderboard
    from bench.reporting.leaderboard.texts import leaderboard_tables

    if score is None and (methods is not None or workers is not None):
        raise UsageError("leaderboard: expected --score beside --methods and --workers, which say how to score")
    computing = Computing(workers=workers, cache=cache, no_cache=no_cache)
    failures = sum(
        score_all(dataset, methods=methods, protocol=protocol, runs=folder, computing=computing)
        for dataset in score or ()
    )
    found = read_leaderboard(folder)
    show(leaderboard_tables(found))
    for run, fault in found.damaged:
        say(f"damaged: {run}: {fault}", style="red")
    if out is not None:
        with progress_bar("drawing the same images", "runs") as progress:
            files, problems = write_leaderboard(found, out, pictures=pictures, progress=progress)
        for problem in problems:
            say(f"no picture: {problem}", style="yellow")
        note_files(files)
    if found.damaged or failures:
        raise typer.Exit(options.FAILURES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Competitor:
    """A method that is scored.

    Attributes:
        name: of the method.
        settings: "name=value".
        timed: what it costs is worth telling: it is a method.
    """

    name: str
    settings: tuple[str, ...]
    timed: bool = True

    @property
    def folder(self) -> str:
        """Name of the folder of its run; where a scenario lies is no part of it."""
        words = [self.name, *(setting for setting in self.settings if not setting.startswith("scenario="))]
        return re.sub(r"[^A-Za-z0-9_.-]+", "-", "-".join(words))


def competitors(card: DatasetCard, methods: str | None) -> list[Competitor]:
    """List the methods that are scored on a data set.

    Args:
        card: the data set.
        methods: names with commas in between, settings behind colons; None for every registered method, its variants
            and, on rendered data, what bounds them.

    Raises:
        UsageError: a setting that is none.
    """
    from bench.cli.request import split_methods
    from bench.methods import known_methods

    if methods is None:
        variants = {known: [f"{known}:{setting}" for setting in VARIANTS.get(known, ())] for known in known_methods()}
        names = [name for known in known_methods() for name in (known, *variants[known])]
        methods = ",".join([*names, *(CEILINGS if card.scenario is not None else ())])
    return [_competitor(name, settings, card) for _, name, settings in split_methods(methods)]


def _competitor(name: str, settings: list[str], card: DatasetCard) -> Competitor:
    from bench.methods import known_methods

    named = any(setting.startswith("scenario=") for setting in settings)
    if name == EXACT_FLOW and card.scenario is not None and not named:
        settings = [*settings, f"scenario={card.scenario}"]
    return Competitor(name=name, settings=tuple(settings), timed=name in known_methods() or ":" in name)


def score_all(dataset: str, *, methods: str | None, protocol: str, runs: Path, computing: Computing) -> int:
    """Score methods on a data set, each by all protocols in one pass; what is there and up to date is not computed.

    Args:
        dataset: card, or its name.
        methods: as `competitors`.
        protocol: names or files, with commas in between.
        runs: folder of runs; those of the data set go into one below it that is called as the data set.
        computing: where and how.

    Returns:
        How many methods, images, units and recordings could not be used; each method's reason is printed.
    """
    from bench.cli.request import render_if_synthetic, scoring_requests
    from bench.recordings import load_card

    card = load_card(dataset)
    render_if_synthetic(card)
    failures = 0
    for competitor in competitors(card, methods):
        try:
            requests = scoring_requests(
                dataset,
                competitor.name,
                settings=competitor.settings,
                protocol=protocol,
                split=None,
                out=runs / card.name / competitor.folder,
                overwrite=True,
            )
            summaries = _score(computing.equip(requests), timed=competitor.timed)
        except BenchError as error:
            say(f"left out: {card.name}, {competitor.folder}: {error}", style="red")
            failures += 1
            continue
        failures += max(len(summary.failures) for summary in summaries)
        work = summaries[0].provenance.work
        computed = 0 if work is None else work.images_computed
        say(f"{card.name}, {competitor.folder}: {computed} images computed, the others were there")
    return failures


def _score(requests: list[RunRequest], *, timed: bool) -> list[RunSummary]:
    """Score one method, time it, and write the page of the run that is judged."""
    from bench.harness import run_protocols
    from bench.harness.perf import method_cost, read_cost, write_cost
    from bench.reporting.leaderboard.reading import RANKING_PROTOCOL
    from bench.reporting.page.build import write_page

    first, cost = requests[0], None
    if timed:
        cost = method_cost(first.card, first.method, protocol=first.protocol, known=read_cost(first.out))

    def finish(results: Path, summary: RunSummary) -> None:
        if cost is not None:
            write_cost(results, cost)
        if summary.protocol.name == RANKING_PROTOCOL:
            write_page(results, pictures=False)

    left = "what is scored stays, and the same command goes on from there"
    with interruptible(left), progress_bar(f"scoring {first.method.name} on {first.card.name}", "images") as progress:
        return run_protocols([replace(request, progress=progress) for request in requests], finish=finish)

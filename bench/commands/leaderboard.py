"""`leaderboard`: all methods on one page, scored first where that is asked for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import PATH, Words
from bench.commands.console import note_files, print_blocks, say
from bench.commands.progress import Report, interruptible, progress_bar
from bench.commands.runs import PROTOCOLS, RUNS, split_protocols
from bench.errors import BenchError, UsageError
from bench.plain_text import counted

if TYPE_CHECKING:
    from bench.execution import TaskExecutor
    from bench.harness import StoredRun
    from bench.recordings import DatasetCard
    from bench.reporting.leaderboard import Leaderboard

LEFT = "what is scored stays, and the same command goes on from there"

# Settings that make another method of one; the others come from the registry alone.
VARIANTS = {"spherical": ("flow=dis", "first_guess=true")}
# Beside the methods, on data with truth: the exact masks, and the same on the paper's cells.
CEILINGS = ("truth", "truth:cell_size_px=5")


@dataclass(frozen=True, slots=True, kw_only=True)
class Competitor:
    """A method that is scored.

    Attributes:
        name: of the method.
        settings: "name=value".
    """

    name: str
    settings: tuple[str, ...]

    @property
    def folder(self) -> str:
        """Name of the folder of its run."""
        return re.sub(r"[^A-Za-z0-9_.-]+", "-", "-".join([self.name, *self.settings]))


def competitors(card: DatasetCard, methods: str | None) -> list[Competitor]:
    """List the methods that are scored on a data set.

    Args:
        card: the data set.
        methods: names with commas in between, settings behind colons; None for every registered method, its variants
            and, on rendered data, what bounds them.

    Raises:
        UsageError: a setting that is none.
    """
    from bench.methods import known_methods
    from bench.methods.settings import split_methods

    if methods is None:
        variants = {known: [f"{known}:{setting}" for setting in VARIANTS.get(known, ())] for known in known_methods()}
        names = [name for known in known_methods() for name in (known, *variants[known])]
        methods = ",".join([*names, *(CEILINGS if card.scenario is not None else ())])
    return [Competitor(name=name, settings=tuple(settings)) for _, name, settings in split_methods(methods)]


def score_competitor(
    card: DatasetCard, competitor: Competitor, *, protocol: str, runs: Path, executor: TaskExecutor
) -> list[StoredRun]:
    """Score one method by all protocols in one pass, and write the page of the run that is ranked.

    What is there and up to date is not computed.

    Args:
        card: the data set, rendered.
        competitor: the method.
        protocol: names or files with commas in between.
        runs: folder of runs.
        executor: computes.

    Raises:
        UnknownNameError, UsageError, DataError: as `bench.run`.
    """
    from bench.commands.runs import run_request
    from bench.harness import run_benchmark
    from bench.methods.settings import parse_settings
    from bench.reporting.leaderboard import RANKING_PROTOCOL
    from bench.reporting.run_page import write_page

    settings, out = parse_settings(competitor.settings), runs / card.name / competitor.folder
    request = run_request(card, competitor.name, settings=settings, protocol=protocol, out=out, overwrite=True)

    def finish(run: StoredRun) -> None:
        if run.protocol.name == RANKING_PROTOCOL:
            write_page(run.folder, pictures=False)

    with interruptible(LEFT), progress_bar(f"scoring {competitor.name} on {card.name}", "images") as report:
        return run_benchmark(request, executor=executor, progress=report, finish=finish)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeaderboardReport:
    """All runs of a folder, ranked.

    Attributes:
        found: `groups` of runs that compare, each with its `entries`, best first; and what could not be read.
        files: that were written, the page first.
        problems: why pictures are missing, one line each.
        scored: what was scored first, one line for each method.
        left_out: methods that could not be scored, and why, one line each.
        failures: images, tasks and recordings that could not be used, and these methods.
    """

    found: Leaderboard
    files: tuple[Path, ...] = ()
    problems: tuple[str, ...] = ()
    scored: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    failures: int = 0


def leaderboard(
    folder: Annotated[str | Path, typer.Argument(help="Folder with runs at any depth."), PATH] = RUNS,
    *,
    score: Annotated[
        Sequence[str],
        typer.Option(metavar="DATASET", help="First score methods on this data set, into FOLDER; repeatable."),
        Words(list[str] | None, lambda given: given or (), default=None),
    ] = (),
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="With --score: these methods, with settings after colons, as in spherical:flow=dis; default: all "
            "registered ones, and on rendered data the exact masks.",
        ),
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="With --score: protocols with commas in between, in one pass.")
    ] = PROTOCOLS,
    out: Annotated[
        str | Path | None,
        typer.Option(help="Also write page, chart and tables into this folder."),
        PATH,
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Show methods on the same images of rendered data sets.")] = True,
    workers: options.Workers = 1,
    progress: Report | None = None,
) -> LeaderboardReport:
    """Rank the runs of a folder, one table for each group of comparable runs; with --score, make the runs first.

    Rows that ship with the package stand beside those that compare. Runs that are up to date are not computed again.

    Args:
        folder: holds runs; those that are scored go into one below it that is called as the data set.
        score: data sets, by card or name.
        methods: as of `competitors`.
        protocol: names or files, with commas in between.
        out: None to write none.
        pictures: False for tables alone.
        workers: processes, or an executor, that score.
        progress: called with the runs drawn and their number, for each group anew.

    Raises:
        DataError: there is no folder, or no run in it.
        UnknownNameError, UsageError: as `competitors`.
    """
    from bench.commands.data import as_card, as_executor, rendered_card
    from bench.evaluation import load_protocol
    from bench.harness import build_scorable
    from bench.methods.settings import parse_settings
    from bench.recordings.cards import shipped_folder
    from bench.reporting.leaderboard import read_leaderboard, with_shipped
    from bench.reporting.leaderboard_page import write_leaderboard

    if not score and methods is not None:
        raise UsageError("leaderboard: expected --score beside --methods, which say what to score")
    scored, left_out, failures, executor = list[str](), list[str](), 0, as_executor(workers)
    asked = [(card, competitors(card, methods)) for card in map(as_card, score)]
    for name in split_protocols(protocol) if score else ():
        load_protocol(name)  # mistakes are told before anything is rendered
    for competitor in asked[0][1] if asked and methods is not None else ():
        build_scorable(competitor.name, parse_settings(competitor.settings))
    for card, named in asked:
        rendered_card(card, executor=executor)
        for competitor in named:
            called = f"{card.name}, {competitor.folder}"
            try:
                runs = score_competitor(card, competitor, protocol=protocol, runs=Path(folder), executor=executor)
            except BenchError as error:
                left_out.append(f"{called}: {error}")
                continue
            failures += max(len(run.summary.failures) for run in runs)
            answered = counted(runs[0].summary.provenance.images_asked, "image")
            scored.append(f"{called}: {answered} answered, the others were there")
    found, shipped = read_leaderboard(Path(folder)), shipped_folder("leaderboard")
    if out is None or Path(out).resolve() != shipped.resolve():  # what is written there is what ships
        found = with_shipped(found, shipped / "leaderboard.json")
    files, problems = tuple[Path, ...](), tuple[str, ...]()
    if out is not None:
        with progress_bar("drawing the same images", "runs", progress) as report:
            files, problems = write_leaderboard(found, Path(out), pictures=pictures, progress=report)
    return LeaderboardReport(
        found=found,
        files=files,
        problems=problems,
        scored=tuple(scored),
        left_out=tuple(left_out),
        failures=failures + len(left_out),
    )


def show(ranked: LeaderboardReport) -> int:
    """Print what was scored, the tables, what is wrong, and the files."""
    from bench.reporting.leaderboard_page import leaderboard_tables

    for line in ranked.scored:
        say(line)
    for line in ranked.left_out:
        say(f"left out: {line}", style="red")
    print_blocks(leaderboard_tables(ranked.found))
    for run, fault in ranked.found.damaged:
        say(f"damaged: {run}: {fault}", style="red")
    for problem in ranked.problems:
        say(f"no picture: {problem}", style="yellow")
    note_files(ranked.files)
    return options.FAILURES if ranked.found.damaged or ranked.failures else 0

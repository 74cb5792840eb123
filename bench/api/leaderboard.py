"""Leaderboards: which methods they compare, how each is scored, timed and reported, and how runs are ranked."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bench.api.datasets import as_card, as_executor, rendered_card
from bench.api.runs import DEFAULT_PROTOCOL, RUNS, run_request
from bench.execution import TaskExecutor
from bench.harness import StoredRun, run_benchmark
from bench.harness.stages import Progress
from bench.methods import known_methods
from bench.methods.settings import parse_settings, split_methods
from bench.recordings import DatasetCard
from bench.reporting.leaderboard.page import write_leaderboard
from bench.reporting.leaderboard.reading import RANKING_PROTOCOL, Leaderboard, read_leaderboard
from bench.reporting.page.build import write_page

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


def competitors(dataset: str | Path | DatasetCard, methods: str | None = None) -> list[Competitor]:
    """List the methods that are scored on a data set.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        methods: names with commas in between, settings behind colons; None for every registered method, its variants
            and, on rendered data, what bounds them.

    Raises:
        UnknownNameError: no data set of this name.
        UsageError: a setting that is none.
    """
    card = as_card(dataset)
    if methods is None:
        variants = {known: [f"{known}:{setting}" for setting in VARIANTS.get(known, ())] for known in known_methods()}
        names = [name for known in known_methods() for name in (known, *variants[known])]
        methods = ",".join([*names, *(CEILINGS if card.scenario is not None else ())])
    return [Competitor(name=name, settings=tuple(settings)) for _, name, settings in split_methods(methods)]


def score_competitor(
    dataset: str | Path | DatasetCard,
    competitor: Competitor,
    *,
    protocols: Sequence[str | Path] = (DEFAULT_PROTOCOL, RANKING_PROTOCOL),
    runs: str | Path = RUNS,
    workers: int | TaskExecutor = 1,
    progress: Progress | None = None,
) -> list[StoredRun]:
    """Score one method for a leaderboard and write the page of the run that is ranked.

    What is there and up to date is not computed.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        competitor: the method.
        protocols: by name or file; the method is asked once.
        runs: folder of runs; those of the data set go into one below it that is called as the data set.
        workers: processes, or an executor.
        progress: called with the images done and their number.

    Returns:
        The results by each protocol.

    Raises:
        UnknownNameError, UsageError, DataError: as `bench.run`.
    """
    executor = as_executor(workers)
    card = rendered_card(dataset, executor=executor)
    settings, out = parse_settings(competitor.settings), Path(runs) / card.name / competitor.folder
    request = replace(
        run_request(card, competitor.name, settings=settings, protocols=protocols, out=out, overwrite=True),
        executor=executor,
        progress=progress,
    )

    def finish(run: StoredRun) -> None:
        if run.protocol.name == RANKING_PROTOCOL:
            write_page(run.folder, pictures=False)

    return run_benchmark(request, finish=finish)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeaderboardReport:
    """All runs of a folder, ranked.

    Attributes:
        found: `groups` of runs that compare, each with its `entries`, best first; and what could not be read.
        files: that were written, the page first.
        problems: why pictures are missing, one line each.
    """

    found: Leaderboard
    files: tuple[Path, ...] = ()
    problems: tuple[str, ...] = ()


def leaderboard(
    folder: str | Path = RUNS,
    *,
    out: str | Path | None = None,
    pictures: bool = True,
    progress: Progress | None = None,
) -> LeaderboardReport:
    """Rank all runs of a folder, those that compare in one group each, as `fisheye-bench leaderboard` does.

    Args:
        folder: holds runs at any depth.
        out: folder of page, chart and tables; None to write none.
        pictures: show methods on the same images, from rendered data sets.
        progress: called with the runs drawn and their number, for each group anew.

    Raises:
        DataError: there is no folder, or no run in it.
    """
    found = read_leaderboard(Path(folder))
    if out is None:
        return LeaderboardReport(found=found)
    files, problems = write_leaderboard(found, Path(out), pictures=pictures, progress=progress)
    return LeaderboardReport(found=found, files=files, problems=problems)

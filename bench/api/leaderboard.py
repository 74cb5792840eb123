"""Methods that a leaderboard compares: which they are, and how each is scored, timed and reported."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.api.runs import run_request
from bench.harness import RunRequest, StoredRun, run_benchmark
from bench.harness.perf import method_cost, read_cost, write_cost
from bench.methods import known_methods
from bench.methods.settings import parse_settings, split_methods
from bench.recordings import DatasetCard
from bench.reporting.leaderboard.reading import RANKING_PROTOCOL
from bench.reporting.page.build import write_page

# Settings that make another method of one; the others come from the registry alone.
VARIANTS = {"spherical": ("flow=dis", "first_guess=true")}
EXACT_FLOW = "exact-flow"
# Beside the methods, on data with truth: the exact masks, the same on the paper's cells, and exact flow.
CEILINGS = ("truth", "truth:cell_size_px=5", EXACT_FLOW)


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
    if methods is None:
        variants = {known: [f"{known}:{setting}" for setting in VARIANTS.get(known, ())] for known in known_methods()}
        names = [name for known in known_methods() for name in (known, *variants[known])]
        methods = ",".join([*names, *(CEILINGS if card.scenario is not None else ())])
    return [_competitor(name, settings, card) for _, name, settings in split_methods(methods)]


def _competitor(name: str, settings: list[str], card: DatasetCard) -> Competitor:
    named = any(setting.startswith("scenario=") for setting in settings)
    if name == EXACT_FLOW and card.scenario is not None and not named:
        settings = [*settings, f"scenario={card.scenario}"]
    return Competitor(name=name, settings=tuple(settings), timed=name in known_methods() or ":" in name)


def competitor_request(
    card: DatasetCard, competitor: Competitor, *, protocols: Sequence[str], runs: Path
) -> RunRequest:
    """Assemble the runs of a method, one for each protocol, as `bench.api.runs.run_request`.

    Args:
        card: the data set.
        competitor: the method.
        protocols: names or files.
        runs: folder of runs; those of the data set go into one below it that is called as the data set.
    """
    settings, out = parse_settings(competitor.settings), runs / card.name / competitor.folder
    return run_request(card, competitor.name, settings=settings, protocols=protocols, out=out, overwrite=True)


def score_competitor(request: RunRequest, *, timed: bool) -> dict[Path, StoredRun]:
    """Score one method, time it, and write the page of the run that is ranked.

    Args:
        request: its runs, one for each protocol.
        timed: measure its cost, where the run's folder does not hold it.
    """
    cost = None
    if timed:
        run, rules = next(iter(request.runs.items()))
        cost = method_cost(request.card, request.method, protocol=rules, known=read_cost(run))

    def finish(run: StoredRun) -> None:
        if cost is not None:
            write_cost(run.folder, cost)
        if run.protocol.name == RANKING_PROTOCOL:
            write_page(run.folder, pictures=False)

    return run_benchmark(request, finish=finish)

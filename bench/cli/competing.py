"""Scores all methods on a data set, for the leaderboard."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from bench.cli.computing import Computing, render_if_synthetic, split_method
from bench.cli.console import progress_bar, say
from bench.cli.interrupts import interruptible
from bench.cli.running import ScoringOptions, requested_runs
from bench.errors import BenchError
from bench.harness import RunSummary, run_protocols
from bench.harness.perf import method_cost, read_cost, write_cost
from bench.methods import known_methods
from bench.recordings import DatasetCard, load_card
from bench.reporting.leaderboard.reading import JUDGED
from bench.reporting.page.build import write_page

# Settings that make another method of one; the others come from the registry alone.
VARIANTS = {"spherical": ("flow=dis", "first_guess=true")}
EXACT_FLOW = "exact-flow"
# Beside the methods, on data with truth: the exact masks, the same on the paper's cells, and exact flow.
CEILINGS = ("truth", "truth:cell_size_px=5", EXACT_FLOW)


@dataclass(frozen=True, slots=True, kw_only=True)
class Competitor:
    """What is scored.

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
    """Who competes on a data set.

    Args:
        card: the data set.
        methods: names with commas in between, settings behind colons; None for every registered method, its variants
            and, on rendered data, what bounds them.

    Raises:
        UsageError: a setting that is none.
    """
    if methods is not None:
        names = [text.strip() for text in methods.split(",")]
    else:
        names = [name for known in known_methods() for name in (known, *_variants(known))]
        names += CEILINGS if card.scenario is not None else ()
    return [_competitor(name, card) for name in names]


def _variants(name: str) -> list[str]:
    return [f"{name}:{setting}" for setting in VARIANTS.get(name, ())]


def _competitor(text: str, card: DatasetCard) -> Competitor:
    name, settings = split_method(text)
    told = any(setting.startswith("scenario=") for setting in settings)
    if name == EXACT_FLOW and card.scenario is not None and not told:
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
    card = load_card(dataset)
    render_if_synthetic(card)
    failures = 0
    for competitor in competitors(card, methods):
        asked = ScoringOptions(
            dataset=dataset,
            method=competitor.name,
            settings=competitor.settings,
            protocol=protocol,
            split=None,
            out=str(runs / card.name / competitor.folder),
            overwrite=True,
            computing=computing,
        )
        try:
            summaries = _score(asked, timed=competitor.timed)
        except BenchError as error:
            say(f"left out: {card.name}, {competitor.folder}: {error}", style="red")
            failures += 1
            continue
        failures += max(len(summary.failures) for summary in summaries)
        work = summaries[0].provenance.work
        computed = 0 if work is None else work.images_computed
        say(f"{card.name}, {competitor.folder}: {computed} images computed, the others were there")
    return failures


def _score(asked: ScoringOptions, *, timed: bool) -> list[RunSummary]:
    """Score one method, time it, and write the page of the run that is judged."""
    requests = requested_runs(asked, render=False)
    first, cost = requests[0], None
    if timed:
        cost = method_cost(first.card, first.method, protocol=first.protocol, known=read_cost(first.out))

    def finish(results: Path, summary: RunSummary) -> None:
        if cost is not None:
            write_cost(results, cost)
        if summary.protocol.name == JUDGED:
            write_page(results, pictures=False)

    left = "what is scored stays, and the same command goes on from there"
    with interruptible(left), progress_bar(f"scoring {asked.method} on {first.card.name}", "images") as progress:
        return run_protocols([replace(request, progress=progress) for request in requests], finish=finish)

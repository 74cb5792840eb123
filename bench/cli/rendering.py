"""Render scenarios."""

from __future__ import annotations

from pathlib import Path

from bench.cli.console import progress_bar, say
from bench.cli.interrupts import interruptible
from bench.recordings import DatasetCard


def render(scenario: Path, out: Path, *, workers: int | None = None) -> None:
    """Render a scenario with a progress bar and say where."""
    from bench.synthesis import synthesize  # a second, and data that are there already need none of it

    left = f"the recordings that are done are in {out}, and the same command goes on from there"
    with interruptible(left), progress_bar(f"rendering {scenario.stem}", "recordings") as report:
        folders = synthesize(scenario, out, workers=workers, progress=report)
    say(f"{len(folders)} recordings in {out}")


def render_if_synthetic(card: DatasetCard) -> None:
    """Render what a card's scenario asks for and is not there yet."""
    if card.scenario is not None and card.remote_root is None:
        render(card.scenario, card.root)

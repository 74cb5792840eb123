"""Data that are rendered first, with a bar."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.api.datasets import as_card, render_if_missing
from bench.commands.console import detail, note
from bench.commands.progress import Report, interruptible, progress_bar
from bench.execution import TaskExecutor
from bench.recordings import DatasetCard


@contextmanager
def rendering(scenario: Path, out: Path) -> Iterator[Report]:
    """A progress bar for rendering, and what is left when that is interrupted."""
    left = f"the recordings that are done are in {out}, and the same command goes on from there"
    with interruptible(left), progress_bar(f"rendering {scenario.stem}", "recordings") as report:
        yield report


def rendered_card(
    dataset: str | Path | DatasetCard,
    split: str | None = None,
    *,
    executor: TaskExecutor | None = None,
    as_it_is: bool = False,
) -> DatasetCard:
    """The card of a data set, rendered as by `bench.api.datasets.rendered_card`, with a bar."""
    card = as_card(dataset)
    detail(f"card {card.file}, root {card.content.root}")
    if card.scenario is not None and not (as_it_is and card.root.is_dir()):
        with rendering(card.scenario, card.root) as report:
            workers = None if executor is None else executor.workers  # of all cores
            count = render_if_missing(card, split, workers=workers, progress=report)
        if count:
            note(f"{count} recordings in {card.root}")
    return card

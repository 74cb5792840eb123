"""Data sets and executors that commands are given by name; what a scenario renders is rendered first, with a bar."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

from bench.commands.console import detail, note
from bench.commands.progress import Report, interruptible, progress_bar
from bench.execution import FuturesExecutor, TaskExecutor, local_executor
from bench.plain_text import counted
from bench.recordings import DatasetCard, load_card


def as_card(dataset: str | Path | DatasetCard) -> DatasetCard:
    """The card of a data set, read where it is not given itself.

    Raises:
        UnknownNameError: no card of this name.
        DataError: it cannot be read.
    """
    return dataset if isinstance(dataset, DatasetCard) else load_card(dataset)


def as_executor(workers: int | Executor | TaskExecutor) -> TaskExecutor:
    """The executor of so many processes: one computes in this process; or the one that is given."""
    if isinstance(workers, Executor):
        return FuturesExecutor(pool=workers)
    return local_executor(workers) if isinstance(workers, int) else workers


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
    """The card of a data set, of which what its scenario asks for in a split is rendered where it is not there yet.

    Args:
        dataset: card, by path or by a name that `fisheye-bench list` shows.
        split: of the data set; None for all of it.
        executor: of what is done with the data; as many of its workers render. None for one process per core.
        as_it_is: render nothing where the data have a folder, however much of them is in it.

    Raises:
        UnknownNameError: no card or split of this name.
        DataError: the card or its scenario cannot be used.
    """
    from bench.harness.datasets import render_if_missing

    card = as_card(dataset)
    detail(f"card {card.file}, root {card.content.root}")
    if card.scenario is not None and not (as_it_is and card.root.is_dir()):
        with rendering(card.scenario, card.root) as report:
            workers = None if executor is None else executor.workers
            count = render_if_missing(card, split, workers=workers, progress=report)
        if count:
            note(f"{counted(count, 'recording')} in {card.root}")
    return card

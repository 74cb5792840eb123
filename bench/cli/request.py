"""From options to objects: data set, executor; and data that are rendered first."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from bench.api.datasets import as_card, render_if_missing
from bench.cli.console import detail, note
from bench.cli.progress import interruptible, progress_bar
from bench.errors import UsageError
from bench.execution import DaskExecutor, ProcessExecutor, TaskExecutor, usable_cores
from bench.harness import RunRequest
from bench.recordings import DatasetCard


def equip(request: RunRequest, *, workers: int | None, scheduler: str | None) -> RunRequest:
    """Give a run its executor, as the options say.

    Args:
        request: the run.
        workers: processes, as they were asked for; None for one per core.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.

    Raises:
        UsageError: options that contradict each other.
        DataError: no such cluster.
    """
    if scheduler is None:
        return replace(request, executor=worker_processes(workers))
    if workers is not None:
        raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
    return replace(request, executor=DaskExecutor.connect(scheduler))


def worker_processes(workers: int | None) -> TaskExecutor:
    """Processes of this machine beside that of the command, so that no method ends it without a word.

    Args:
        workers: how many; None for one per core.
    """
    return ProcessExecutor(workers=workers or usable_cores())


@contextmanager
def rendering(scenario: Path, out: Path) -> Iterator[Callable[[float, int], None]]:
    """A progress bar for rendering, and what is left when that is interrupted."""
    left = f"the recordings that are done are in {out}, and the same command goes on from there"
    with interruptible(left), progress_bar(f"rendering {scenario.stem}", "recordings") as report:
        yield report


def rendered_card(dataset: str | DatasetCard, split: str | None = None, *, as_it_is: bool = False) -> DatasetCard:
    """The card of a data set, rendered as by `bench.api.datasets.rendered_card`, with a bar."""
    card = as_card(dataset)
    detail(f"card {card.file}, root {card.content.root}")
    if card.scenario is not None and not (as_it_is and card.root.is_dir()):
        with rendering(card.scenario, card.root) as report:
            count = render_if_missing(card, split, progress=report)
        if count:
            note(f"{count} recordings in {card.root}")
    return card

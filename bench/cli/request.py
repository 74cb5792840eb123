"""From options to objects: data set, method, protocol, executor, cache; and data that are rendered first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from bench.api.datasets import as_card, render_if_missing
from bench.api.runs import as_cache
from bench.cli.console import detail, note
from bench.cli.progress import interruptible, progress_bar
from bench.errors import UsageError
from bench.execution import ProcessExecutor, TaskExecutor, usable_cores
from bench.harness import RunRequest
from bench.harness.cache import default_folder
from bench.harness.cluster import ClusterExecutor, WorkerRequirements, scheduler_address
from bench.recordings import DatasetCard


def equip(
    request: RunRequest,
    *,
    workers: int | None,
    cache: Path | None,
    no_cache: bool,
    scheduler: str | None,
    reads: Sequence[Path] = (),
) -> RunRequest:
    """Give runs of data that exist their executor and cache, as the options say.

    Args:
        request: the runs.
        workers: processes, as they were asked for; None for one per core.
        cache: folder of cached steps; None for the usual one.
        no_cache: keep nothing.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.
        reads: files and folders that the method reads beside the data set.

    Raises:
        UsageError: options that contradict each other, or a cluster that cannot compute for this run.
        DataError: no such cluster.
    """
    stored, card = as_cache(cache_path(cache, no_cache=no_cache)), request.card
    if scheduler is None:
        return replace(request, executor=worker_processes(workers), cache=stored)
    if workers is not None:
        raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
    local = card.root if card.remote_root is None else None
    data = [path for path in (local, card.annotations) if path is not None and path.exists()]
    requirements = WorkerRequirements.of(request.method, reads=(*data, *reads), cache=stored)
    return replace(request, executor=ClusterExecutor.connect(scheduler_address(scheduler), requirements), cache=stored)


def cache_path(cache: Path | None, *, no_cache: bool) -> Path | None:
    """Folder of cached steps, the usual one unless another is named; None to store none."""
    return None if no_cache else cache or default_folder()


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
    if card.scenario is not None and card.remote_root is None and not (as_it_is and card.root.is_dir()):
        with rendering(card.scenario, card.root) as report:
            count = render_if_missing(card, split, progress=report)
        if count:
            note(f"{count} recordings in {card.root}")
    return card

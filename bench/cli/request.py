"""From options to objects: data set, method, protocol, executor, cache; and data that are rendered first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from bench.api.datasets import as_card, render_if_missing
from bench.api.runs import as_cache, run_request
from bench.cli.console import detail, note
from bench.cli.progress import interruptible, progress_bar
from bench.errors import UsageError
from bench.execution import ProcessExecutor, TaskExecutor, usable_cores
from bench.harness import RunRequest
from bench.harness.cache import CacheFolder, default_folder
from bench.harness.cluster import ClusterExecutor, WorkerRequirements, scheduler_address
from bench.methods import Scorable
from bench.methods.settings import parse_settings
from bench.recordings import DatasetCard


@dataclass(frozen=True, slots=True, kw_only=True)
class Computing:
    """Options of commands that score.

    Attributes:
        workers: processes, as they were asked for; None for one per core.
        cache: folder of cached steps; None for the usual one.
        no_cache: keep nothing.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.
    """

    workers: int | None = None
    cache: Path | None = None
    no_cache: bool = False
    scheduler: str | None = None

    def executor(self, card: DatasetCard, method: Scorable, *, reads: Sequence[Path] = ()) -> TaskExecutor:
        """Return the executor that computes the units.

        Args:
            card: the data set, which exists.
            method: to be scored.
            reads: files and folders that the method reads beside the data set.

        Raises:
            UsageError: options that contradict each other, or a cluster that cannot compute for this run.
            DataError: no such cluster.
        """
        if self.scheduler is None:
            return worker_processes(self.workers)
        if self.workers is not None:
            raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
        local = card.root if card.remote_root is None else None
        data = [path for path in (local, card.annotations) if path is not None and path.exists()]
        requirements = WorkerRequirements.of(method, reads=(*data, *reads), cache=self.cache_folder)
        return ClusterExecutor.connect(scheduler_address(self.scheduler), requirements)

    def equip(self, request: RunRequest, *, reads: Sequence[Path] = ()) -> RunRequest:
        """Give runs of data that exist their executor and cache; `reads` as of `executor`."""
        executor = self.executor(request.card, request.method, reads=reads)
        return replace(request, executor=executor, cache=self.cache_folder)

    @property
    def cache_path(self) -> Path | None:
        """Folder of cached steps; None to store none."""
        return None if self.no_cache else self.cache or default_folder()

    @property
    def cache_folder(self) -> CacheFolder | None:
        """The cache of steps; None for none."""
        return as_cache(self.cache_path)


def worker_processes(workers: int | None) -> TaskExecutor:
    """Processes of this machine beside that of the command, so that no method ends it without a word.

    Args:
        workers: how many; None for one per core.
    """
    return ProcessExecutor(workers=workers or usable_cores())


def scoring_request(
    dataset: str,
    method: str,
    *,
    settings: Sequence[str] | None,
    input_errors: Sequence[str] | None = None,
    protocol: str,
    split: str | None,
    out: str | Path | None,
    overwrite: bool,
) -> RunRequest:
    """Assemble the runs that a command line names, one for each protocol; as `bench.api.runs.run_request`.

    Args:
        dataset: card, or its name.
        method: name, or "module:Class".
        settings: of the method, "name=value".
        input_errors: injected into what the method is given, "name=value".
        protocol: names or files, with commas in between; the method is asked once for all of them.
        split: of the data set; None for all of it.
        out: folder of the run; None for the usual one.
        overwrite: replace another run.
    """
    return run_request(
        dataset,
        method,
        settings=parse_settings(settings),
        protocols=[name.strip() for name in protocol.split(",")],
        split=split,
        input_errors=parse_settings(input_errors, option="--input-error"),
        out=out,
        overwrite=overwrite,
    )


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

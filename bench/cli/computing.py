"""Where and how a command computes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import UsageError
from bench.execution import ProcessExecutor, SerialExecutor, TaskExecutor, usable_cores
from bench.harness.cache import CacheFolder, default_folder
from bench.harness.cluster import ClusterExecutor, Terms, scheduler_address
from bench.methods import Method
from bench.recordings import DatasetCard


@dataclass(frozen=True, slots=True, kw_only=True)
class Computing:
    """Options of commands that score.

    Attributes:
        workers: processes, as they were asked for; None for one per core.
        cache: folder for kept steps; None for the usual one.
        no_cache: keep nothing.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.
    """

    workers: int | None = None
    cache: Path | None = None
    no_cache: bool = False
    scheduler: str | None = None

    def executor(self, card: DatasetCard, method: Method, *, reads: Sequence[Path] = ()) -> TaskExecutor:
        """What computes the units.

        Args:
            card: the data set, which is there.
            method: to be scored.
            reads: what the method reads beside the data set.

        Raises:
            UsageError: options that contradict each other, or a cluster that cannot compute for this run.
            DataError: no such cluster.
        """
        if self.scheduler is None:
            return local_executor(self.workers)
        if self.workers is not None:
            raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
        local = card.root if card.remote_root is None else None
        data = [path for path in (local, card.annotations) if path is not None and path.exists()]
        terms = Terms.of(method, reads=(*data, *reads), cache=self.cache_folder)
        return ClusterExecutor.of_fit_workers(scheduler_address(self.scheduler), terms)

    @property
    def cache_folder(self) -> CacheFolder | None:
        """Where steps are kept; None for nowhere."""
        return None if self.no_cache else CacheFolder(folder=self.cache or default_folder())


def local_executor(workers: int | None) -> TaskExecutor:
    """Processes of this machine.

    Args:
        workers: how many; None for one per core.
    """
    count = workers or usable_cores()
    return SerialExecutor() if count == 1 else ProcessExecutor(workers=count)

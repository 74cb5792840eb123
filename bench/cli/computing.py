"""Where and how a command computes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.errors import UsageError
from bench.harness.cache import CacheFolder, default_folder
from bench.harness.work import Cluster, Terms, scheduler_address
from bench.methods import Method
from bench.parallel import Place, Processes, in_turn
from bench.recordings import DatasetCard


@dataclass(frozen=True, slots=True, kw_only=True)
class Workforce:
    """A place to compute.

    Attributes:
        place: the place.
        workers: processes there.
    """

    place: Place
    workers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Computing:
    """Options of commands that score.

    Attributes:
        workers: processes, as they were asked for; None for one per core.
        processes: of this machine, which start already; None where this one computes alone, or a cluster does.
        cache: folder for kept steps; None for the usual one.
        no_cache: keep nothing.
        scheduler: address, or file, of a Dask scheduler whose workers compute; None for this machine.
    """

    workers: int | None = None
    processes: Processes | None = None
    cache: Path | None = None
    no_cache: bool = False
    scheduler: str | None = None

    def workforce(self, card: DatasetCard, method: Method, *, reads: Sequence[Path] = ()) -> Workforce:
        """What computes the units.

        Args:
            card: the data set, which is there.
            method: to be scored.
            reads: what the method reads beside the data set.

        Raises:
            UsageError: options that contradict each other, or a cluster that cannot compute for this run.
            DataError: no such cluster.
        """
        if self.scheduler is not None:
            if self.workers is not None:
                raise UsageError("--workers: expected none beside --scheduler, whose workers are started apart")
            local = card.root if card.remote_root is None else None
            data = [path for path in (local, card.annotations) if path is not None and path.exists()]
            terms = Terms.of(method, reads=(*data, *reads), cache=self.cache_folder)
            cluster = Cluster(scheduler=scheduler_address(self.scheduler), terms=terms)
            return Workforce(place=cluster, workers=cluster.workers())
        if self.processes is None:
            return Workforce(place=in_turn, workers=1)
        return Workforce(place=self.processes, workers=self.processes.workers)

    @property
    def cache_folder(self) -> CacheFolder | None:
        """Where steps are kept; None for nowhere."""
        return None if self.no_cache else CacheFolder(folder=self.cache or default_folder())

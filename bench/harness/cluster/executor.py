"""Processes of any number of machines, under a Dask scheduler that is there already."""

from __future__ import annotations

import pickle
import zlib
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Self, TypeVar
from uuid import uuid4

from bench.errors import DataError, UsageError
from bench.execution import FailedTask
from bench.harness.cluster.connection import connected
from bench.harness.cluster.requirements import WorkerRequirements
from bench.harness.cluster.worker import Call, Parcel, Unfit, compute, unmet

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE_S = 120.0  # without any worker; they may take long to start
FETCH_S = 60.0  # until a result is asked for once more, when the worker that holds it is gone
POLL_S = 0.5

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(kw_only=True, eq=False)
class ClusterExecutor:
    """Computes tasks on the workers of a Dask cluster; see `bench.execution.TaskExecutor`.

    As many tasks are under way as there are workers, so memory does not grow with their number, and a worker that dies
    takes no task with it but the one that it computed. Dask gives that one to another worker as often as the
    scheduler's `allowed-failures` says. A worker process computes one task at a time with one thread for each library,
    however many threads it has.

    Attributes:
        scheduler: its address, for example tcp://host:8786.
        requirements: what each worker must have.
        workers: how many processes there were when the run began.
        patience_s: how long to wait for the first worker, or for another one when all have gone.
    """

    scheduler: str
    requirements: WorkerRequirements
    workers: int = 0
    patience_s: float = PATIENCE_S
    shares_disk: bool = field(default=False, init=False)
    _connections: list[tuple[ExitStack, Client]] = field(default_factory=list, init=False, repr=False)

    @classmethod
    def of_fit_workers(
        cls, scheduler: str, requirements: WorkerRequirements, *, patience_s: float = PATIENCE_S
    ) -> Self:
        """The executor of a cluster that has workers, all of them fit for the run.

        Raises:
            UsageError: Dask is not installed, or a worker has other code, or does not see the data.
            DataError: no scheduler, or no worker.
        """
        executor = cls(scheduler=scheduler, requirements=requirements, patience_s=patience_s)
        with executor:
            workers = executor._workers()
            executor.workers = workers.wait_for_one()
            workers.refuse_unfit(requirements)
        return executor

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            client = self._connections[-1][1] if self._connections else opened.enter_context(connected(self.scheduler))
            self._connections.append((opened.pop_all(), client))
        return self

    def __exit__(self, *_: object) -> None:
        self._connections.pop()[0].close()

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """See `TaskExecutor.compute`.

        Raises:
            UsageError: as `workers`.
            DataError: the scheduler does not answer, or no longer, or all workers have gone.
        """
        parcel = Parcel(
            run_id=uuid4().hex, requirements=self.requirements, work=zlib.compress(pickle.dumps(function), level=1)
        )
        waiting = deque(tasks)
        running: dict[Any, tuple[Future[Any], Task]] = {}
        finished: SimpleQueue[Future[Any]] = SimpleQueue()
        with self:
            workers = self._workers()
            try:
                while waiting or running:
                    for _ in range(min(workers.size() - len(running), len(waiting))):
                        task = waiting.popleft()
                        future = workers.submit(parcel, task)
                        running[future.key] = future, task
                        future.add_done_callback(finished.put)
                    try:
                        future = finished.get(timeout=POLL_S)
                    except Empty:
                        continue
                    answer = workers.answer(future)
                    if answer is None:
                        future.add_done_callback(finished.put)
                        continue
                    _, task = running.pop(future.key)
                    future.release()
                    yield task, answer[0]
            finally:
                for future, _ in running.values():
                    future.release()  # nobody waits for it: what has not begun never does

    def _workers(self) -> _Workers:
        return _Workers(client=self._connections[-1][1], scheduler=self.scheduler, patience_s=self.patience_s)


@dataclass(kw_only=True)
class _Workers:
    """The workers of a scheduler, as a client sees them."""

    client: Client
    scheduler: str
    patience_s: float
    seen_s: float = 0.0

    def __post_init__(self) -> None:
        self.seen_s = monotonic()

    def size(self) -> int:
        """How many workers there are; 0 for a while."""
        if self.client.status != "running":
            raise self.lost()
        try:
            count = len(self.client.nthreads())
        except OSError as error:
            raise self.lost() from error
        if count:
            self.seen_s = monotonic()
        elif monotonic() - self.seen_s > self.patience_s:
            got = f"none for {self.patience_s:g} s"
            do = f"start some, for example: dask worker {self.scheduler} --nthreads 1, then give the same command again"
            raise DataError(self.scheduler, expected="workers", got=got, do=do)
        return count

    def wait_for_one(self) -> int:
        """How many workers there are, at least one."""
        while not (count := self.size()):
            sleep(POLL_S)
        return count

    def refuse_unfit(self, requirements: WorkerRequirements) -> None:
        """Ask each worker that is there now whether it is fit."""
        call = pickle.dumps(Call(function=unmet, arguments=(requirements,)))
        try:
            answers = self.client.run(pickle.loads, call, on_error="return")
        except OSError as error:
            raise self.lost() from error
        for address, found in answers.items():
            if isinstance(found, OSError):
                continue  # it has gone meanwhile
            if isinstance(found, Exception):
                raise _without_package(found) or found
            if found is not None:
                raise UsageError(f"worker {address}: {found}")

    def submit(self, parcel: Parcel, task: object) -> Future[Any]:
        """Send a task on its way."""
        key = f"fisheye-bench-{uuid4().hex}"
        call = Call(function=compute, arguments=(parcel, pickle.dumps(task)))
        return self.client.submit(pickle.loads, pickle.dumps(call), key=key, pure=False)

    def answer(self, future: Future[Any]) -> tuple[Any] | None:
        """What became of a task; None where it is computed once more, since its result went with a worker."""
        from distributed import KilledWorker

        if future.status == "error":
            fault = future.exception()
            if isinstance(fault, KilledWorker):
                return (FailedTask(reason=_ending(fault)),)
            unfit = _without_package(fault)
            if unfit is not None:
                raise unfit
            future.result()  # raises with the traceback of the worker
        if future.status == "cancelled":
            raise self.lost()
        if future.status != "finished":
            return None
        try:
            result = future.result(timeout=FETCH_S)
        except TimeoutError:
            return None
        except (CancelledError, OSError) as error:
            raise self.lost() from error
        if isinstance(result, Unfit):
            raise UsageError(result.reason)
        return (result,)

    def lost(self) -> DataError:
        """The error of a connection that is gone."""
        do = "start it and its workers, then give the same command again: units that are stored are not computed again"
        return DataError(self.scheduler, expected="the Dask scheduler", got="a connection that was lost", do=do)


def _ending(fault: Any) -> str:
    times = fault.allowed_failures + 1
    return f"its worker ended while it worked on it, {times} times; the last was {fault.last_worker.address}"


def _without_package(fault: Any) -> UsageError | None:
    """The error of a worker that lacks this package, or has one of an age that does not know these files."""
    if not (isinstance(fault, ImportError) and (fault.name or "").partition(".")[0] == "bench"):
        return None
    return UsageError(f"a worker cannot import fisheye-bench ({fault}); install it on all machines as it is here")

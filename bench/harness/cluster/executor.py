"""Processes of any number of machines, under a Dask scheduler that is there already."""

from __future__ import annotations

import pickle
import platform
import threading
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, chdir
from dataclasses import dataclass, field
from functools import lru_cache
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Self, TypeVar
from uuid import uuid4

from bench.errors import DataError, UsageError
from bench.execution import FailedTask
from bench.harness.cluster.connection import connected
from bench.harness.cluster.requirements import WorkerRequirements
from bench.threads import single_threaded

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
    _connection: ExitStack = field(default_factory=ExitStack, init=False, repr=False)
    _client: Client | None = field(default=None, init=False, repr=False)
    _entered: int = field(default=0, init=False, repr=False)
    _seen_s: float = field(default=0.0, init=False, repr=False)

    @classmethod
    def connect(cls, scheduler: str, requirements: WorkerRequirements, *, patience_s: float = PATIENCE_S) -> Self:
        """The executor of a cluster that has workers, all of them fit for the run.

        Raises:
            UsageError: Dask is not installed, or a worker has other code, or does not see the data.
            DataError: no scheduler, or no worker.
        """
        executor = cls(scheduler=scheduler, requirements=requirements, patience_s=patience_s)
        with executor:
            while not (count := executor._worker_count()):
                sleep(POLL_S)
            executor.workers = count
            executor._refuse_unfit_workers()
        return executor

    def __enter__(self) -> Self:
        if self._client is None:
            self._client = self._connection.enter_context(connected(self.scheduler))
            self._seen_s = monotonic()
        self._entered += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._entered -= 1
        if not self._entered:
            self._client = None
            self._connection.close()

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """See `TaskExecutor.compute`.

        Raises:
            UsageError: as `connect`, of a worker that came later.
            DataError: the scheduler does not answer, or no longer, or all workers have gone.
        """
        call = pickle.dumps((uuid4().hex, self.requirements, pickle.dumps(function)))
        waiting = deque(tasks)
        running: dict[Any, tuple[Future[Any], Task]] = {}
        finished: SimpleQueue[Future[Any]] = SimpleQueue()
        with self:
            try:
                while waiting or running:
                    for _ in range(min(self._worker_count() - len(running), len(waiting))):
                        future = self._running().submit(_compute, call, pickle.dumps(waiting[0]), pure=False)
                        running[future.key] = future, waiting.popleft()
                        future.add_done_callback(finished.put)
                    try:
                        future = finished.get(timeout=POLL_S)
                    except Empty:
                        continue
                    answer = self._answer(future)
                    if answer is None:
                        future.add_done_callback(finished.put)
                        continue
                    _, task = running.pop(future.key)
                    future.release()
                    yield task, answer[0]
            finally:
                for future, _ in running.values():
                    future.release()  # nobody waits for it: what has not begun never does

    def _running(self) -> Client:
        if self._client is None or self._client.status != "running":
            raise self._lost()
        return self._client

    def _worker_count(self) -> int:
        """Return the number of workers; 0 at most for `patience_s`."""
        try:
            count = len(self._running().nthreads())
        except OSError as error:
            raise self._lost() from error
        if count:
            self._seen_s = monotonic()
        elif monotonic() - self._seen_s > self.patience_s:
            got = f"none for {self.patience_s:g} s"
            hint = (
                f"start some, for example: dask worker {self.scheduler} --nthreads 1, then give the same command again"
            )
            raise DataError(self.scheduler, expected="workers", got=got, hint=hint)
        return count

    def _refuse_unfit_workers(self) -> None:
        content = pickle.dumps(self.requirements)  # a worker without this package can say so of bytes alone
        self._ask_workers(pickle.loads, content)
        for address, reason in self._ask_workers(WorkerRequirements.unmet, self.requirements).items():
            if reason is not None:
                raise UsageError(f"worker {address}: {reason}")

    def _ask_workers(self, function: Callable[[Any], Any], argument: object) -> dict[str, Any]:
        try:
            answers = self._running().run(function, argument, on_error="return")
        except OSError as error:
            raise self._lost() from error
        for address, found in answers.items():
            if isinstance(found, ImportError):
                near = "install it on all machines as it is here"
                raise UsageError(f"worker {address}: it cannot import fisheye-bench ({found}); {near}")
            if isinstance(found, Exception) and not isinstance(found, OSError):
                raise found
        return {
            address: found for address, found in answers.items() if not isinstance(found, OSError)
        }  # gone meanwhile

    def _answer(self, future: Future[Any]) -> tuple[Any] | None:
        """The result of a task; None where it is computed once more, since its result went with a worker."""
        from distributed import KilledWorker

        if future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker):
                times, address = error.allowed_failures + 1, error.last_worker.address
                reason = f"its worker ended while it worked on it, {times} times; the last was {address}"
                return (FailedTask(reason=reason),)
            future.result()  # raises with the traceback of the worker
        if future.status == "cancelled":
            raise self._lost()
        if future.status != "finished":
            return None
        try:
            return (future.result(timeout=FETCH_S),)
        except TimeoutError:
            return None
        except (CancelledError, OSError) as error:
            raise self._lost() from error

    def _lost(self) -> DataError:
        hint = (
            "start it and its workers, then give the same command again: units that are stored are not computed again"
        )
        return DataError(self.scheduler, expected="the Dask scheduler", got="a connection that was lost", hint=hint)


_one_at_a_time = threading.Lock()


def _compute(call: bytes, task: bytes) -> object:
    """Compute a task on a worker, which stays as it was."""
    with _one_at_a_time:
        requirements, function = _opened(call)
        with chdir(requirements.folder), single_threaded():
            return function(pickle.loads(task))


@lru_cache(maxsize=1)  # a method may keep things between images
def _opened(call: bytes) -> tuple[WorkerRequirements, Callable[[Any], Any]]:
    """The function of a run, which is opened only where its requirements are met."""
    requirements: WorkerRequirements
    _, requirements, function = pickle.loads(call)
    reason = requirements.unmet()
    if reason is not None:
        raise UsageError(f"worker on {platform.node()}: {reason}")
    with chdir(requirements.folder):
        return requirements, pickle.loads(function)

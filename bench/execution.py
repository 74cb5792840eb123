"""Tasks on executors: in this process, or in processes of this machine; `bench.harness.cluster` has one for Dask.

What a task gives does not depend on the executor. Results come back as they are done, and a task that ends the process
that computes it is told, while the others go on. Nothing here knows what the tasks are.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread, current_thread, main_thread
from typing import Any, Protocol, Self, TypeVar
from uuid import uuid4

from bench.errors import OutputError
from bench.threads import single_threaded, use_one_thread

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3  # of a task whose process ends while it computes it
LARGEST_MESSAGE_BYTES = 2048  # with what the pool adds it is written at once (PIPE_BUF), or half of it could arrive
SAFE_PATH = "PYTHONSAFEPATH"


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, slots=True, kw_only=True)
class FailedTask:
    """A task without a result.

    Attributes:
        reason: what became of the process that computed it.
    """

    reason: str


class TaskExecutor(Protocol):
    """Computes tasks in any order; it keeps its workers inside a `with` block, which may be entered more than once."""

    @property
    def workers(self) -> int:
        """How many tasks are computed at a time."""
        ...

    @property
    def shares_disk(self) -> bool:
        """Whether workers write where this process reads."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """Compute tasks and give each back once with its result, as it is done.

        An exception that `function` raises is raised here. Closing the generator ends the work within two seconds.

        Args:
            function: of a module, or a partial of one; it is called with each task.
            tasks: they travel to other processes.
        """
        ...


@dataclass(frozen=True, slots=True)
class SerialExecutor:
    """Computes tasks in this process, one after the other, every library in one thread."""

    workers: int = 1
    shares_disk: bool = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """See `TaskExecutor.compute`."""
        with single_threaded():
            for task in tasks:
                yield task, function(task)


@dataclass(kw_only=True, eq=False)
class ProcessExecutor:
    """Computes tasks in processes of this machine, every library in one thread.

    When a process is killed, the pool is built anew; the tasks that were under way are computed one by one, in a pool
    of their own, so that the one that ends its process is found and the others lose nothing but time. At most one task
    more than there are workers is under way, so that memory does not grow with their number.

    Attributes:
        workers: how many processes.
    """

    workers: int
    shares_disk: bool = field(default=True, init=False)
    _pool: _Pool | None = field(default=None, init=False, repr=False)
    _entered: int = field(default=0, init=False, repr=False)

    def __enter__(self) -> Self:
        self._entered += 1
        return self

    def __exit__(self, *error: object) -> None:
        self._entered -= 1
        if not self._entered or any(error):
            self._close(now=any(error))

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """See `TaskExecutor.compute`."""
        call = pickle.dumps(function)
        waiting = deque(tasks)
        running: dict[Future[Any], Task] = {}
        with self:
            while waiting or running:
                broken = False
                try:
                    while waiting and len(running) <= self.workers:
                        future = self._submit(call, waiting[0])
                        running[future] = waiting.popleft()
                    done, _ = wait(running, return_when=FIRST_COMPLETED)
                except BrokenProcessPool:  # a process ended while it had nothing to do, or did not start
                    broken, done = True, set(running)
                for future in done:
                    if isinstance(future.exception() if future.done() else None, BrokenProcessPool):
                        broken = True
                    elif future.done():
                        yield running.pop(future), _value(future.result())
                if broken:
                    suspects = [*running.values()] or [waiting.popleft()]
                    running = {}
                    self._close(now=True)
                    for task in suspects:
                        yield task, _alone(call, task)

    def _submit(self, call: bytes, task: object) -> Future[Any]:
        if self._pool is None:
            self._pool = _Pool(self.workers)
        return self._pool.submit(call, task)

    def _close(self, *, now: bool) -> None:
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.close(now=now)


class _Pool:
    """A `ProcessPoolExecutor` whose processes end at once when it is closed, or when this process ends in any way.

    They hold one end of a pipe and end when the other end is gone. An interrupt from the keyboard reaches this process
    alone. Large results travel as files: a process that is killed in the middle of a message would leave half of it in
    the pipe that all of them share, and nobody could read on.
    """

    def __init__(self, workers: int) -> None:
        context = get_context("spawn")
        self._theirs, self._ours = context.Pipe(duplex=False)
        begin = (self._theirs, os.environ.get(SAFE_PATH))
        self._results = TemporaryDirectory(prefix="fisheye-bench-", ignore_cleanup_errors=True)
        with _processes_may_start():  # that which counts semaphores
            self._executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=begin)

    def submit(self, call: bytes, task: object) -> Future[Any]:
        with _processes_may_start():
            return self._executor.submit(_call, call, task, self._results.name)

    def close(self, *, now: bool) -> None:
        if now:
            self._ours.close()
        self._executor.shutdown(cancel_futures=now)
        self._ours.close()
        self._theirs.close()
        self._results.cleanup()


def _alone(call: bytes, task: object) -> Any:
    """The result of a task that was under way when a process ended, in a process of its own."""
    for _ in range(ATTEMPTS - 1):
        pool = _Pool(1)
        try:
            return _value(pool.submit(call, task).result())
        except BrokenProcessPool:
            continue
        finally:
            pool.close(now=True)
    reason = "its process ended without a result, as when memory runs out or a library crashes"
    return FailedTask(reason=f"{reason}, {ATTEMPTS} times")


@contextmanager
def _processes_may_start() -> Iterator[None]:
    """Let processes start without a look for libraries into the working folder; an interrupt waits until they have.

    The mask is for them: they inherit it. This process may get the interrupt in a thread of a library, which has not
    blocked it, and Python would raise it here: half of a process would be left, and say so.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    interrupts: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    if waits := handler is not None and current_thread() is main_thread():
        signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]) if sys.platform != "win32" else None
    try:
        yield
    finally:
        _restore_safe_path(before)
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)
        if waits:
            signal.signal(signal.SIGINT, handler)
        if interrupts:
            signal.raise_signal(signal.SIGINT)


def _restore_safe_path(value: str | None) -> None:
    if value is None:
        os.environ.pop(SAFE_PATH, None)
    else:
        os.environ[SAFE_PATH] = value


def _begin(parent: Connection, safe_path: str | None) -> None:
    """Prepare a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    _restore_safe_path(safe_path)
    Thread(target=_end_with, args=(parent,), daemon=True).start()
    use_one_thread()


def _end_with(parent: Connection) -> None:
    with suppress(EOFError, OSError):
        parent.recv_bytes()
    os._exit(1)


_unpickled: list[tuple[bytes, Callable[[Any], Any]]] = []  # the last function; a method may keep things between tasks


def _value(result: bytes | Path) -> Any:
    """What a task gave, from what came back from its process."""
    if isinstance(result, bytes):
        return pickle.loads(result)
    value = pickle.loads(result.read_bytes())
    result.unlink()
    return value


def _call(function: bytes, task: object, folder: str) -> bytes | Path:
    """Call a function in a worker process; give its pickled result, or the file that holds it."""
    if not (_unpickled and _unpickled[0][0] == function):
        _unpickled[:] = [(function, pickle.loads(function))]
    try:
        result = pickle.dumps(_unpickled[0][1](task), protocol=pickle.HIGHEST_PROTOCOL)
    except SystemExit as error:
        raise RuntimeError(f"a task called sys.exit({error.code!r})") from error
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:  # noqa: BLE001 - whatever its class does when it is pickled
            raise RuntimeError("".join(traceback.format_exception(error))) from None
        raise
    if len(result) <= LARGEST_MESSAGE_BYTES:
        return result
    file = Path(folder) / uuid4().hex
    try:
        file.write_bytes(result)
    except OSError as error:
        raise OutputError.of(error, file) from error
    return file

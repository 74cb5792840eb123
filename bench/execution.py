"""Tasks on executors: in this process, or in processes of this machine; `bench.harness.cluster` has one for Dask.

The result of a task does not depend on the executor. Results come back as they are done, and a task that ends the
process that computes it is named, while the others go on. Nothing here knows what the tasks are.
"""

from __future__ import annotations

import os
import pickle
import signal
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import Connection, wait
from threading import Thread, current_thread, main_thread
from typing import Any, Protocol, Self, TypeVar
from weakref import finalize

from bench.threads import single_threaded, use_one_thread

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3  # of a task whose process ends while it computes it
LOOK_S = 0.5  # between looks whether the processes at work are still there
END_S = 5.0  # for a process without a task to end
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
        """Number of tasks that are computed at a time."""
        ...

    @property
    def shares_disk(self) -> bool:
        """True if workers write where this process reads."""
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

    Each worker has one task at a time, so memory does not grow with the number of tasks, and a pipe of its own, so a
    worker that is killed, even while it answers, costs its own task only. Such tasks are computed again at the end,
    one by one with no other worker, since memory may have run out.

    Attributes:
        workers: how many processes.
    """

    workers: int
    shares_disk: bool = field(default=True, init=False)
    _idle: list[_Worker] = field(default_factory=list, init=False, repr=False)
    _entered: int = field(default=0, init=False, repr=False)

    def __enter__(self) -> Self:
        self._entered += 1
        return self

    def __exit__(self, *error: object) -> None:
        self._entered -= 1
        if not self._entered:
            self._end_idle(now=any(error))

    def _end_idle(self, *, now: bool = False) -> None:
        idle, self._idle = self._idle, []
        _end(idle, now=now)

    def compute(
        self, function: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[Task, Result | FailedTask]]:
        """See `TaskExecutor.compute`."""
        call = pickle.dumps(function)
        with self:
            tasks = yield from self._attempt(call, tasks, self.workers)
            for _ in range(1, ATTEMPTS if tasks else 1):
                self._end_idle()
                tasks = yield from self._attempt(call, tasks, 1)
        reason = "its process ended without a result, as when memory runs out or a library crashes"
        for task in tasks:
            yield task, FailedTask(reason=f"{reason}, {ATTEMPTS} times")

    def _attempt(
        self, call: bytes, tasks: Sequence[Task], at_once: int
    ) -> Generator[tuple[Task, Any], None, Sequence[Task]]:
        """Compute each task once; return those whose worker ended meanwhile."""
        waiting, ended = deque(tasks), []
        busy: dict[Any, tuple[_Worker, Task]] = {}

        def begin() -> None:
            while waiting and len(busy) < at_once:
                worker = self._idle.pop() if self._idle else _Worker()
                busy[worker.pipe] = worker, waiting[0]
                worker.send(call, waiting.popleft())

        try:
            begin()
            while busy:
                for pipe in _answered(busy):
                    worker, task = busy[pipe]
                    answer = worker.answer()
                    del busy[pipe]
                    if answer is None:
                        _end([worker])
                        ended.append(task)
                    else:
                        self._idle.append(worker)
                    begin()
                    if answer is not None:
                        result, error = answer
                        if error is not None:
                            raise error
                        yield task, result
        finally:
            _end([worker for worker, _ in busy.values()], now=True)
        return ended


def local_executor(workers: int) -> TaskExecutor:
    """The executor of this machine: this process alone, or processes beside it.

    Args:
        workers: how many tasks at a time.
    """
    return SerialExecutor() if workers <= 1 else ProcessExecutor(workers=workers)


class _Worker:
    """A process that computes one task after the other, as this process sees it."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        finalize(self, self.pipe.close)  # at exit, too: Python waits for its processes then
        self.process = context.Process(target=_work, args=(theirs, os.environ.get(SAFE_PATH)))
        with theirs, _starting():
            self.process.start()

    def send(self, call: bytes, task: object) -> None:
        """Give it a task; whether it is still there, its answer tells."""
        content = pickle.dumps((call, task))
        with suppress(OSError):
            self.pipe.send_bytes(content)

    def answer(self) -> Any:
        """Wait for the result of its task and the error, one of them None; None when it has ended."""
        if not (self.process.is_alive() or self.pipe.poll()):
            return None
        try:
            content = self.pipe.recv_bytes()
        except (EOFError, OSError):
            return None
        return pickle.loads(content)


def _answered(busy: Mapping[Any, tuple[_Worker, object]]) -> Sequence[Any]:
    """Wait for workers that have answered, or ended; their pipes.

    A pipe alone does not tell that its worker ended: processes that the task started hold it open, too.
    """
    while True:
        ended = [pipe for pipe, (worker, _) in busy.items() if not worker.process.is_alive()]
        if found := wait([*busy], timeout=0 if ended else LOOK_S) or ended:
            return found


def _end(workers: Sequence[_Worker], *, now: bool = False) -> None:
    """End processes, in the middle of a task too where it must be now."""
    for worker in workers:
        if now:
            worker.process.kill()
        worker.pipe.close()
    for worker in workers:
        worker.process.join(END_S)
        worker.process.kill()  # a library may wait for processes of its own
        worker.process.join()


@contextmanager
def _starting() -> Iterator[None]:
    """Let a process start without a look for libraries into the working folder; an interrupt waits until it has.

    The process inherits the mask, so that it says nothing of an interrupt before it ignores it. This one may get it in
    a thread of a library, which has not blocked it, and Python would raise it while half of a process is started.
    """
    interrupts: list[int] = []
    main, unsafe = current_thread() is main_thread(), SAFE_PATH not in os.environ
    os.environ.setdefault(SAFE_PATH, "1")
    handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number)) if main else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        if unsafe:
            del os.environ[SAFE_PATH]
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, handler)
        if interrupts:
            signal.raise_signal(signal.SIGINT)


def _work(pipe: Connection, safe_path: str | None) -> None:
    """Compute the tasks that come through a pipe until it is closed, or the process that started this one ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if safe_path is None:
        del os.environ[SAFE_PATH]
    Thread(target=_end_with, args=(parent_process(),), daemon=True).start()
    use_one_thread()
    with suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(_answer(pipe.recv_bytes()))
    for child in active_children():  # a pool that a task left open, for which Python would wait
        child.terminate()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@lru_cache(maxsize=1)
def _function(call: bytes) -> Any:
    return pickle.loads(call)


def _answer(content: bytes) -> bytes:
    """The pickled result of a task and its error, in a worker; one of them is None."""
    try:
        call, task = pickle.loads(content)
        return pickle.dumps((_function(call)(task), None), protocol=pickle.HIGHEST_PROTOCOL)
    except SystemExit as error:
        failed: Exception = RuntimeError(f"a task called sys.exit({error.code!r})")
    except Exception as error:  # noqa: BLE001 - it is raised where the task came from
        failed = error
    told = "".join(traceback.format_exception(failed))
    failed.add_note(f"in a worker process:\n{told}")
    try:
        answer = pickle.dumps((None, failed))
        pickle.loads(answer)
    except Exception:  # noqa: BLE001 - whatever its class does when it is pickled
        return pickle.dumps((None, RuntimeError(told)))
    return answer

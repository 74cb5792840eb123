"""Tasks on executors of `concurrent.futures`: this process, processes of this machine, a Dask cluster, or any other.

The result of a task does not depend on the executor. A task that ends its worker is named, and the others go on.
Nothing here knows what the tasks are.
"""

from __future__ import annotations

import ctypes
import logging
import os
import re
import resource
import signal
import sys
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import chdir, closing, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import active_children, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Lock, Thread, current_thread, main_thread
from typing import Self, TypeAlias, TypeVar

from bench.errors import DataError, UsageError

Task = TypeVar("Task")
Result = TypeVar("Result")

SAFE_PATH = "PYTHONSAFEPATH"
CONNECTION_S = 10.0  # until a scheduler that does not answer is not there
ENDED = "its worker ended without a result, as when memory runs out or a library crashes, also when it was alone"

# One thread per library and memory that stays: or processes fight for cores, and timings mean nothing. The libraries
# are imported on use, since other processes start before they are loaded.
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
KEPT_BYTES = 1 << 29
LARGEST_MAPPED_BYTES = 1 << 25  # glibc takes no more


def reuse_freed_memory() -> None:
    """Have the C library keep what is freed for the rest of this process, instead of giving it back to the system.

    Flow, counts and rendering take and free the same tens of megabytes for every image. Taken from the system anew,
    page by page, they cost Farnebäck's flow a seventh of its time. The peak stays what it was. Only glibc is told;
    other libraries are left as they are.
    """
    tell = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if tell is not None:
        tell(M_MMAP_THRESHOLD, LARGEST_MAPPED_BYTES)
        tell(M_TRIM_THRESHOLD, KEPT_BYTES)


THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Keep libraries to one thread for the rest of this process, those too that are loaded later: a worker's start."""
    import cv2
    from threadpoolctl import threadpool_limits

    reuse_freed_memory()
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    cv2.setNumThreads(1)
    threadpool_limits(1)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep OpenCV and BLAS to one thread inside the block; freed memory is reused from here on."""
    import cv2
    from threadpoolctl import threadpool_limits

    reuse_freed_memory()
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        cv2.setNumThreads(threads)


def largest_resident_mb() -> float:
    """Largest resident size so far, MB: of this process and its workers on Linux, of this process alone elsewhere."""
    known = ""
    for pid in (os.getpid(), *(child.pid for child in active_children())):
        with suppress(OSError):  # not on Linux, or it ends just now
            known += Path(f"/proc/{pid}/status").read_text()
    if sizes_kb := [int(size) for size in re.findall(r"VmHWM:\s+(\d+)", known)]:
        return max(sizes_kb) / 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6  # macOS: bytes


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, slots=True, kw_only=True)
class FailedTask:
    """A task without a result.

    Attributes:
        reason: what became of its worker.
    """

    reason: str


Computed: TypeAlias = Generator[tuple[Task, Result | FailedTask]]
Progress: TypeAlias = Callable[[float, int], None]  # called with what is done and with all that there is


class TaskExecutor(ABC):
    """Computes tasks in any order; inside a `with` block its workers stay for the next tasks.

    Attributes:
        workers: how many tasks at a time.
    """

    workers: int

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    @abstractmethod
    def compute(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Computed[Task, Result]:
        """Compute tasks and give each back once with its result, as it is done.

        A process computes one task at a time. An exception that `function` raises is raised here. Closing the generator
        stops the workers at once.

        Args:
            function: of a module, or a partial of one; it is called with each task.
            tasks: they travel to other processes.
        """


def compute_all(
    executor: TaskExecutor,
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    progress: Progress | None = None,
) -> list[Result | FailedTask]:
    """Compute tasks and return their results in the order of the tasks, all in memory.

    Args:
        executor: computes them.
        function: as of `TaskExecutor.compute`.
        tasks: the same.
        progress: called with the tasks done and their number.
    """
    results: dict[int, Result | FailedTask] = {}
    with executor, closing(executor.compute(function, tasks)) as computed:
        for task, result in computed:
            results[id(task)] = result
            if progress is not None:
                progress(len(results), len(tasks))
    return [results[id(task)] for task in tasks]


@dataclass(frozen=True)
class SerialExecutor(TaskExecutor):
    """Computes tasks in this process, one after the other, every library in one thread."""

    workers: int = 1

    def compute(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Computed[Task, Result]:
        """Give each task back once with its result, as `TaskExecutor.compute` says."""
        with single_threaded():
            for task in tasks:
                yield task, function(task)


@dataclass(kw_only=True, eq=False)
class ProcessExecutor(TaskExecutor):
    """Computes tasks in processes of this machine, every library in one thread.

    A pool does not tell which of its tasks ended a worker. So each worker has one task at a time, and those that were
    at work then are computed again at the end, each alone: the one that ends its worker again is the one.

    Attributes:
        workers: how many processes.
    """

    workers: int
    _entered: int = field(default=0, init=False, repr=False)
    _pool: _Pool | None = field(default=None, init=False, repr=False)

    def __enter__(self) -> Self:
        self._entered += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._entered -= 1
        if not self._entered:
            self._end()

    def compute(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Computed[Task, Result]:
        """Give each task back once with its result, as `TaskExecutor.compute` says."""
        waiting, suspects = deque(tasks), list[Task]()
        with self:
            while waiting:
                suspects += yield from self._compute(function, waiting, self.workers)
            for task in suspects:
                if (yield from self._compute(function, deque([task]), 1)):
                    yield task, FailedTask(reason=ENDED)

    def _compute(
        self, function: Callable[[Task], Result], waiting: deque[Task], at_once: int
    ) -> Generator[tuple[Task, Result], None, list[Task]]:
        """Compute tasks from the left until none is left or a worker ends; return those that were at work then."""
        busy: dict[Future[Result], Task] = {}
        pool = self._pool = self._pool or _Pool(self.workers)
        done = set[Future[Result]]()  # they stay in `busy` while `submit` may find that another worker has ended
        try:
            while waiting or busy:
                while waiting and len(busy) - len(done) < at_once:
                    busy[pool.submit(function, waiting[0])] = waiting[0]
                    waiting.popleft()
                for future in done:
                    result = future.result()
                    yield busy.pop(future), result
                done = wait(busy, return_when=FIRST_COMPLETED).done
        except BrokenExecutor:
            ended = [future for future in busy if future.done() and future.exception() is None]
            results = [(busy.pop(future), future.result()) for future in ended]
            self._end()
            yield from results
            return list(busy.values())
        finally:
            if busy:  # whoever asked for the results wants no more of them
                self._end()
        return []

    def _end(self) -> None:
        if self._pool is not None:
            self._pool.end()
        self._pool = None


@dataclass(frozen=True, kw_only=True)
class FuturesExecutor(TaskExecutor):
    """Computes tasks on any executor of `concurrent.futures`, such as that of another engine.

    Its workers see the same files under the same paths. A process computes one task at a time.

    Attributes:
        pool: the executor; whoever made it shuts it down.
        workers: how many; 0 where unknown.
        lost: exceptions that say that a task has lost its worker.
    """

    pool: Executor
    workers: int = 0
    lost: tuple[type[BaseException], ...] = (BrokenExecutor,)

    def compute(self, function: Callable[[Task], Result], tasks: Sequence[Task]) -> Computed[Task, Result]:
        """Give each task back once with its result, as `TaskExecutor.compute` says."""
        call = partial(_in_worker, Path.cwd(), function)
        futures = {self.pool.submit(call, task): task for task in tasks}
        try:
            while futures:
                for future in wait(futures, return_when=FIRST_COMPLETED).done:
                    task = futures.pop(future)
                    try:
                        yield task, future.result()
                    except self.lost as error:
                        yield task, FailedTask(reason=" ".join(str(error).split()))
        finally:
            for future in futures:
                future.cancel()


def dask_executor(scheduler: str) -> FuturesExecutor:
    """The executor of a Dask cluster; it gives a task whose worker ends to others, some times.

    Args:
        scheduler: address, as tcp://HOST:PORT, or the file that `dask scheduler --scheduler-file` writes.

    Raises:
        UsageError: Dask is not installed.
        DataError: no scheduler, or no worker.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        hint = "install it: pip install 'fisheye-bench[cluster]'"
        raise UsageError(
            f"--workers: expected a number, or Dask, which is optional, got none ({error}); {hint}"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)  # what matters of its messages is raised
    named = {"address": scheduler} if "://" in scheduler else {"scheduler_file": scheduler}
    try:
        client = Client(**named, timeout=CONNECTION_S, set_as_default=False, name="fisheye-bench")
    except (OSError, ValueError, TimeoutError) as error:
        hint = "start one with `dask scheduler`, and workers with `dask worker`; or compute here, with --workers N"
        got = f"none within {CONNECTION_S:g} s ({' '.join(str(error).split())})"
        raise DataError(scheduler, expected="a Dask scheduler", got=got, hint=hint) from error
    workers = len(client.nthreads())
    if not workers:
        hint = f"start some: dask worker {client.scheduler_info()['address']}"
        raise DataError(scheduler, expected="a Dask cluster with workers", got="none", hint=hint)
    return FuturesExecutor(pool=client.get_executor(pure=False), workers=workers, lost=(KilledWorker,))


def local_executor(workers: int) -> TaskExecutor:
    """The executor of this machine: this process alone, or processes beside it.

    Args:
        workers: how many tasks at a time.
    """
    return SerialExecutor() if workers <= 1 else ProcessExecutor(workers=workers)


class _Pool:
    """Processes that end with the process that started them, whatever they are doing then."""

    def __init__(self, workers: int) -> None:
        context, safe_path = get_context("spawn"), os.environ.get(SAFE_PATH)
        self._theirs, self._ours = context.Pipe(duplex=False)
        with _starting():  # Python starts a process that keeps track of semaphores
            self._executor = ProcessPoolExecutor(
                workers, mp_context=context, initializer=_start_worker, initargs=(self._theirs, safe_path)
            )

    def submit(self, function: Callable[[Task], Result], task: Task) -> Future[Result]:
        """Begin a task, with a new process where all are at work."""
        with _starting():
            return self._executor.submit(_in_worker, Path.cwd(), function, task)

    def end(self) -> None:
        """End the processes, in the middle of a task too."""
        self._ours.close()
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._theirs.close()


_alone = Lock()  # in a worker whose threads share what a task holds


def _in_worker(folder: Path, function: Callable[[Task], Result], task: Task) -> Result:
    """Compute a task in another process, in the folder in which the run was started."""
    try:
        with _alone, chdir(folder), single_threaded():
            return function(task)
    except SystemExit as error:  # it would end the process that waits for the result
        raise RuntimeError(f"a task called sys.exit({error.code!r})") from error


def _start_worker(pipe: Connection, safe_path: str | None) -> None:
    """Prepare a worker: an interrupt is the business of the process that started it, at whose end it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    if safe_path is None:
        os.environ.pop(SAFE_PATH, None)
    Thread(target=_end_with, args=(pipe,), daemon=True).start()
    use_one_thread()


def _end_with(pipe: Connection) -> None:
    """End this process when the other end of a pipe is closed, as it is by whoever holds it, or by the system."""
    try:
        pipe.recv_bytes()
    except (EOFError, OSError):
        for child in active_children():  # a pool of the task's own
            child.kill()
        os._exit(1)


@contextmanager
def _starting() -> Iterator[None]:
    """Let processes start without a look for libraries into the working folder; an interrupt waits until they have.

    They inherit the mask, so that they say nothing of an interrupt before they ignore it.
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
            os.environ.pop(SAFE_PATH, None)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if main:
            signal.signal(signal.SIGINT, handler)
        if interrupts:
            signal.raise_signal(signal.SIGINT)

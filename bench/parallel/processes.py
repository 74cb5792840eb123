"""Processes of this machine, side by side; one that is killed takes nothing with it but its task."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Container, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from time import monotonic
from typing import Any, TypeVar

from bench.parallel.places import ATTEMPTS, Lost
from bench.parallel.starting import interrupts_later, load_ahead
from bench.parallel.worker import GRACE_S, Computed, Raised, Worker

Task = TypeVar("Task")
Done = TypeVar("Done")


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(kw_only=True, eq=False)
class Processes:
    """A place to compute; see `bench.parallel.places.Place`.

    On Linux they are forked from a server that has loaded what they need, so that any number of them costs one start;
    elsewhere they are spawned. They keep every library to one thread. A task whose process ends without an
    answer is given to another one, three times in all. A process holds one task at a time, so that memory does not
    grow with their number. One call at a time.

    Attributes:
        workers: how many.
        loads: modules that they have imported before they have a task.
    """

    workers: int
    loads: Sequence[str] = ()
    _crew: list[Worker] = field(default_factory=list, repr=False)
    _stay: bool = field(default=False, repr=False)

    def __call__(self, work: Callable[[Task], Done], tasks: Sequence[Task]) -> Generator[tuple[Task, Done | Lost]]:
        """Compute tasks."""
        try:
            yield from self._compute(work, tasks)
        except BaseException:
            self._end_all()
            raise
        finally:
            if not self._stay:
                self._end_all()

    @contextmanager
    def staying(self) -> Iterator[None]:
        """Keep the processes from one call to the next inside the block."""
        self._stay = True
        try:
            yield
        finally:
            self._stay = False
            self._end_all()

    @contextmanager
    def started(self) -> Iterator[None]:
        """Have the processes load while this one does; those that are left end with the block."""
        try:
            if not load_ahead(self.loads):
                self._start(self.workers)
            yield
        finally:
            self._end_all()

    def _compute(self, work: Callable[[Task], Done], tasks: Sequence[Task]) -> Generator[tuple[Task, Done | Lost]]:
        waiting = deque((task, 1) for task in tasks)
        busy: dict[Worker, tuple[Task, int]] = {}
        done: list[tuple[Task, Done | Lost]] = []
        while waiting or busy or done:
            for worker in self._idle(busy, len(waiting)):
                busy[worker] = waiting.popleft()
                worker.begin(work, busy[worker][0])
            yield from done  # while the processes work
            done = []
            for worker in _with_an_answer(busy):
                (task, attempt), answer = busy.pop(worker), worker.answer()
                if not isinstance(answer, Lost):
                    done.append((task, _value(answer)))
                    continue
                self._crew.remove(worker)
                worker.end()
                if attempt < ATTEMPTS:
                    waiting.append((task, attempt + 1))
                else:
                    done.append((task, Lost(reason=f"{answer.reason}, {ATTEMPTS} times")))

    def _idle(self, busy: Container[Worker], tasks: int) -> list[Worker]:
        """Workers for tasks that wait; those that are missing start, all before the first is waited for."""
        idle = sum(worker not in busy for worker in self._crew)
        self._start(min(tasks - idle, self.workers - len(self._crew)))
        return [worker for worker in self._crew if worker not in busy][:tasks]

    def _start(self, count: int) -> None:
        for _ in range(count):
            with interrupts_later():
                self._crew.append(Worker(self.loads))

    def _end_all(self) -> None:
        """End processes, all within the same second."""
        crew, self._crew = self._crew, []
        for worker in crew:
            worker.tell_to_end()
        until_s = monotonic() + GRACE_S
        for worker in crew:
            worker.end(grace_s=until_s - monotonic())


def _with_an_answer(workers: Iterable[Worker]) -> list[Worker]:
    """Those that have one, or have ended; waits for the first."""
    by_sign: dict[Any, Worker] = {sign: worker for worker in workers for sign in worker.signs}
    return list(dict.fromkeys(by_sign[sign] for sign in wait(list(by_sign)))) if by_sign else []


def _value(answer: Computed | Raised) -> Any:
    if isinstance(answer, Raised):
        raise answer.error
    return answer.value

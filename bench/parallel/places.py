"""The contract of a place to compute, and the plainest of them: this process."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from bench.threads import single_threaded

Task = TypeVar("Task")
Done = TypeVar("Done")

ATTEMPTS = 3  # of a task whose process ends while it works on it


@dataclass(frozen=True, slots=True, kw_only=True)
class Lost:
    """A task that ended the process that worked on it, every time.

    Attributes:
        reason: how the process ended.
    """

    reason: str


class Place(Protocol):
    """Computes tasks in any order."""

    def __call__(self, work: Callable[[Task], Done], tasks: Sequence[Task]) -> Generator[tuple[Task, Done | Lost]]:
        """Compute tasks and give each back once, as it is done.

        An exception that `work` raises is raised here; what it wants to survive, it returns. Closing the iterator ends
        the work within two seconds.

        Args:
            work: a function of a module, or a partial of one.
            tasks: what it is called with; they travel to other processes.
        """
        ...


@runtime_checkable
class StayingPlace(Place, Protocol):
    """A place that can keep what it computes with from one call to the next."""

    def staying(self) -> AbstractContextManager[None]:
        """Keep it inside the block."""
        ...


def staying(place: Place) -> AbstractContextManager[None]:
    """Keep what a place computes with from one call to the next inside the block, where it can."""
    return place.staying() if isinstance(place, StayingPlace) else nullcontext()


def in_turn(work: Callable[[Task], Done], tasks: Sequence[Task]) -> Generator[tuple[Task, Done | Lost]]:
    """Compute tasks in this process, one after the other."""
    with single_threaded():
        for task in tasks:
            yield task, work(task)

"""Progress of a run while it goes on: seconds by stage, and how far it is."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from typing import TypeVar

Number = TypeVar("Number", int, float)


class StageClock:
    """Adds up seconds per named stage; time of a stage within another counts once, for the inner one.

    Args:
        now: tells seconds.
    """

    def __init__(self, now: Callable[[], float] = perf_counter) -> None:
        self._now = now
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._within: list[float] = []  # seconds of inner stages, for each stage that is open

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block as part of a stage."""
        start = self._now()
        self._within.append(0.0)
        try:
            yield
        finally:
            whole = self._now() - start
            self.seconds[name] += whole - self._within.pop()
            if self._within:
                self._within[-1] += whole


def add_up(counted: Iterable[Mapping[str, Number]]) -> dict[str, Number]:
    """Add up by name, for example the seconds of several clocks."""
    total: Counter[str] = Counter()
    for one in counted:
        total.update(one)
    return dict(sorted(total.items()))


Progress = Callable[[float, int], None]


def no_progress(_done: float, _total: int) -> None:
    """Progress that is not shown."""


def part_of(progress: Progress | None, *, number: int, total: int) -> Progress | None:
    """Takes the progress of one of several parts that follow each other, and tells that of the whole in parts.

    Args:
        progress: of the whole; None for nobody.
        number: parts that are done.
        total: parts in all.
    """
    if progress is None:
        return None
    return lambda done, of: progress(number + done / max(of, 1), total)

"""Timing pieces of work in turns, by the processor's clock of this thread: a busy machine slows all of them alike."""

from collections.abc import Callable, Mapping
from time import thread_time

from bench.threads import single_threaded


def best_seconds(works: Mapping[str, Callable[[], object]], *, rounds: int) -> dict[str, float]:
    """The shortest of several times of each piece of work; one round beforehand is not counted."""
    found = {name: float("inf") for name in works}
    with single_threaded():
        for turn in range(rounds + 1):
            for name, work in works.items():
                start = thread_time()
                work()
                seconds = thread_time() - start
                if turn:
                    found[name] = min(found[name], seconds)
    return found

"""What a test may take: time and Python's memory."""

import gc
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def at_most(seconds: int) -> Iterator[None]:
    """What waits for ever is a failure."""

    def late(*_: object) -> None:
        raise AssertionError(f"nothing after {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def peak_bytes(run: Callable[[], object]) -> int:
    """The most memory that Python holds in a call.

    The smaller of two calls counts: servers of other tests in this process can only add to one.
    """
    peaks = []
    for _ in range(2):
        gc.collect()
        tracemalloc.start()
        try:
            run()
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    return min(peaks)


@contextmanager
def memory_below(most_bytes: int) -> Iterator[None]:
    """Python's memory stays below so much in the block."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < most_bytes

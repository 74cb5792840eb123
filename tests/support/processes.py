"""Watching processes that a test started."""

import resource
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 300.0  # of a busy machine


def alive(pid: int) -> bool:
    """Whether a process runs."""
    return _runs("pid", pid)


def group_lives(leader: int) -> bool:
    """Whether a process of the group runs."""
    return _runs("pgid", leader)


def _runs(column: str, number: int) -> bool:
    """Whether ps lists a process that has not ended; one that waits to be told of has."""
    listed = subprocess.run(["ps", "-A", "-o", f"{column}=", "-o", "stat="], check=True, capture_output=True, text=True)
    rows = (line.split() for line in listed.stdout.splitlines())
    return any(int(listed_number) == number and not state.startswith("Z") for listed_number, state in rows)


def pids(file: Path) -> list[int]:
    """Processes that noted themselves in a file, one a line."""
    return [int(line) for line in file.read_text().splitlines()] if file.exists() else []


def until(condition: Callable[[], bool], expected: str) -> None:
    """Wait for a condition; fail when it does not come."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"expected {expected}"
        time.sleep(0.02)


@contextmanager
def files_of(size_bytes: int) -> Iterator[None]:
    """Let the kernel refuse files that grow beyond a size, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

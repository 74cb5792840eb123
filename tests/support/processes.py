"""Watching processes that a test started."""

import os
import resource
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 300.0  # of a busy machine


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be told of does not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat")
    try:
        return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it ended just now
        return False


def group_lives(leader: int) -> bool:
    """Whether a process of the group runs; one that has ended and waits to be told of does not."""
    listed = subprocess.run(["ps", "-A", "-o", "pgid=", "-o", "stat="], check=True, capture_output=True, text=True)
    rows = (line.split() for line in listed.stdout.splitlines())
    return any(int(group) == leader and not state.startswith("Z") for group, state in rows)


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

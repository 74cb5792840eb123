"""Processes that start before this one imports what they need too, and imports that go quicker."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from bench.parallel import Processes, usable_cores

LOADED = ("bench.cli", "bench.harness.work", "bench.methods.spherical.method")  # what tasks of most runs need


@contextmanager
def early_processes(workers: int | None, *, scheduler: str | None) -> Iterator[Processes | None]:
    """Have the processes of a run load while the block goes on; those that are left at its end are ended.

    Args:
        workers: how many; None for one per core.
        scheduler: of a cluster that computes instead; None for this machine.

    Yields:
        The processes; None where this one computes alone, or a cluster does.
    """
    count = workers or usable_cores()
    if scheduler is not None or count == 1:
        yield None
        return
    processes = Processes(workers=count, loads=LOADED)
    with processes.started():
        yield processes


@contextmanager
def only_imports() -> Iterator[None]:
    """Look for no garbage inside the block: imports make none, and all that they bring would be looked through."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

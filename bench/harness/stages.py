"""Work that goes on, and how a result was made: how far it is, when, how long, how much memory."""

from __future__ import annotations

import platform
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import perf_counter

from pydantic import BaseModel, ConfigDict

Progress = Callable[[float, int], None]


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


class Provenance(BaseModel):
    """Record of how a run was made; none of it decides a metric.

    Attributes:
        started_utc: ISO 8601.
        seconds: wall time.
        images: scored images.
        images_asked: of which the method was asked; the answers of the others were stored.
        workers: how many; 0 where the executor does not tell.
        peak_memory_mb: largest resident size of a process.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    started_utc: str
    seconds: float
    images: int
    images_asked: int
    workers: int
    peak_memory_mb: float


def provenance_since(
    start_s: float,
    *,
    images: int,
    images_asked: int | None = None,
    workers: int = 1,
    peak_memory_mb: float | None = None,
) -> Provenance:
    """The provenance of work that ends now.

    Args:
        start_s: when it began, by `time.perf_counter`, which never goes back.
        images: that were scored.
        images_asked: of which the method was asked; None for all.
        workers: processes.
        peak_memory_mb: of the largest process; None for this one.
    """
    seconds = round(perf_counter() - start_s, 3)
    return Provenance(
        started_utc=(datetime.now(UTC) - timedelta(seconds=seconds)).isoformat(timespec="seconds"),
        seconds=seconds,
        images=images,
        images_asked=images if images_asked is None else images_asked,
        workers=workers,
        peak_memory_mb=round(largest_resident_mb() if peak_memory_mb is None else peak_memory_mb, 1),
    )


def largest_resident_mb() -> float:
    """Largest resident size of this process so far, MB; NaN where the system does not tell."""
    status = Path("/proc/self/status")
    if status.exists():  # Linux, whose `ru_maxrss` is at least the size of the process that started this one
        told = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return float(told["VmHWM"].split()[0]) / 1e3
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / (1e6 if platform.system() == "Darwin" else 1e3)

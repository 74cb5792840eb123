"""Provenance of a result: time, memory, work; and the versions of libraries."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict, Field

from bench.recordings import Recording

METRIC_LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless", "shapely", "pandas", "pyarrow")
READER_LIBRARIES = (
    "kornia-rs",
    "laspy",
    "lazrs",
    "open3d",
    "open3d-cpu",
    "rosbags",
    "mcap",
    "lz4",
    "backports.zstd",
)


NOT_STORED = "no stored result"


class Work(BaseModel):
    """Amount of work that a run had to do.

    Attributes:
        workers: processes.
        units_computed: units of work that were scored.
        units_reused: units whose stored result was right already.
        changed: of the scored units, how many were stored with another content of what decides them, by its name (of
            code with those of its modules, as "code: bench/geometry/rigid.py"), and how many were not stored, as
            `NOT_STORED`.
        images_computed: images of the scored units.
        steps_found: images of which a step was found in the cache, by step.
        steps_computed: images of which a step was looked for in the cache and had to be computed, by step.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    workers: int
    units_computed: int
    units_reused: int
    images_computed: int
    steps_found: dict[str, int]
    steps_computed: dict[str, int]
    changed: dict[str, int] = Field(default_factory=dict)


class Provenance(BaseModel):
    """Record of how a run was made; none of it decides a metric.

    Attributes:
        started_utc: ISO 8601.
        seconds: wall time of the run.
        stage_seconds: time of each stage, summed over images; of runs by several protocols, that of their common pass.
        images: scored images.
        peak_memory_mb: largest resident size of a process.
        work: what had to be computed; None of an audit.
        unrepeatable: code that cannot be had again, one line a file; see `code_state`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    started_utc: str
    seconds: float
    stage_seconds: dict[str, float]
    images: int
    peak_memory_mb: float
    work: Work | None = None
    unrepeatable: tuple[str, ...] = ()


def provenance_since(
    start_s: float,
    *,
    stage_seconds: Mapping[str, float],
    images: int,
    work: Work | None = None,
    peak_memory_mb: float | None = None,
) -> Provenance:
    """The provenance of work that ends now.

    Args:
        start_s: when it began, by `time.perf_counter`, which never goes back.
        stage_seconds: time of each stage.
        images: that were scored.
        work: what had to be computed.
        peak_memory_mb: of the largest process; None for this one.
    """
    seconds = round(perf_counter() - start_s, 3)
    return Provenance(
        started_utc=(datetime.now(UTC) - timedelta(seconds=seconds)).isoformat(timespec="seconds"),
        seconds=seconds,
        stage_seconds={name: round(seconds, 3) for name, seconds in sorted(stage_seconds.items())},
        images=images,
        peak_memory_mb=round(largest_resident_mb() if peak_memory_mb is None else peak_memory_mb, 1),
        work=work,
    )


@cache
def library_versions() -> Mapping[str, str]:
    """Versions of the libraries that decide metrics: those that compute them, and those that decode what is read."""
    found = {name: version(name) for name in METRIC_LIBRARIES}
    for name in READER_LIBRARIES:  # which of them there are depends on the platform and the interpreter
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return MappingProxyType(found)


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


def recording_digest(recording: Recording) -> str:
    """SHA-256 over the relative paths and sizes of images and sweeps, over annotations and calibration as read,
    and over errors of what a method is told."""
    digest = hashlib.sha256(recording.name.encode())
    named = [(image.path, image.file) for images in recording.images.values() for image in images]
    for path, file in sorted([*named, *((sweep.path, sweep.file) for sweep in recording.sweeps)]):
        size = file.stat().st_size if file.exists() else -1
        digest.update(f"{path.relative_to(recording.root).as_posix()}:{size}\n".encode())
    for name, camera in sorted(recording.cameras.items()):
        digest.update(f"{name}:{camera.model}:{camera.vehicle_from_camera.matrix.tolist()}".encode())
    for track in recording.tracks:
        digest.update(f"{track.track_id}:{track.object_class}".encode())
        digest.update(b"".join(state.velocity_mps.tobytes() for state in track.states))
    digest.update(recording.trajectory.timestamps_ns.tobytes() + recording.trajectory.positions_m.tobytes())
    if recording.input_errors.named:
        digest.update(f"{sorted(recording.input_errors.named.items())}".encode())
    return digest.hexdigest()


def combined_digest(parts: Sequence[str]) -> str:
    """SHA-256 over digests, whatever their order."""
    return hashlib.sha256("".join(sorted(parts)).encode()).hexdigest()

"""What a worker of a cluster does with a task."""

from __future__ import annotations

import pickle
import platform
import threading
import zlib
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass
from typing import Any

from bench.harness.cluster.requirements import WorkerRequirements
from bench.threads import single_threaded

_one_at_a_time = threading.Lock()
_unpacked: list[tuple[str, Callable[[Any], Any]]] = []  # the last call's work; a method may keep things between images


@dataclass(frozen=True, slots=True, kw_only=True)
class Parcel:
    """What a worker is sent with each task.

    Attributes:
        run_id: of the call that it belongs to.
        requirements: what the worker must have.
        work: the function, pickled and compressed, so that nothing of it is opened where the requirements are not met.
    """

    run_id: str
    requirements: WorkerRequirements
    work: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Unfit:
    """A worker that cannot compute for the run.

    Attributes:
        reason: why, and what to do about it.
    """

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """Becomes the result of a function of this package when it is unpickled.

    A worker without this package could not read a task that is one of its functions, and Dask ends a worker that cannot
    read a task, which tells nobody why. Unpickling is a task that every worker can read, and that fails by itself.

    Attributes:
        function: of a module.
        arguments: by position.
    """

    function: Callable[..., object]
    arguments: tuple[object, ...]

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return self.function, self.arguments


def compute(parcel: Parcel, task: bytes) -> object:
    """Compute a task on a worker, which stays as it was."""
    with _one_at_a_time:
        if not (_unpacked and _unpacked[0][0] == parcel.run_id):
            _unpacked[:] = []
            reason = parcel.requirements.unmet()
            if reason is not None:
                return Unfit(reason=f"worker on {platform.node()}: {reason}")
            with chdir(parcel.requirements.folder):
                _unpacked.append((parcel.run_id, pickle.loads(zlib.decompress(parcel.work))))
        with chdir(parcel.requirements.folder), single_threaded():
            return _unpacked[0][1](pickle.loads(task))


def unmet(requirements: WorkerRequirements) -> str | None:
    """Why this worker cannot compute for a run; None where it can."""
    return requirements.unmet()

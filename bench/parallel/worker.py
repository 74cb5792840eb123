"""One process beside this one that computes task after task, with a pipe of its own."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.util import Finalize
from threading import Thread
from typing import Any

from bench.parallel.places import Lost
from bench.threads import use_one_thread

GRACE_S = 1.0  # until a process that was told to end is killed


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """What a task came to."""

    value: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Raised:
    """What a task raised."""

    error: BaseException


class Worker:
    """A spawned process with one thread per library; it computes one task at a time.

    Its pipe is its own, so that a process that is killed in the middle of an answer leaves half a message to nobody
    else. It ends by itself when this process ends, however that comes about. An interrupt from the keyboard reaches
    this process alone.

    Args:
        loads: module that it imports before it has a task; None for none.
    """

    def __init__(self, loads: str | None = None) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, loads), name="worker")
        self._process.start()
        theirs.close()
        self._work: Callable[..., Any] | None = None
        # Without it a process that ends while a worker still waits would wait for the worker.
        Finalize(self, self.pipe.close, exitpriority=1)

    @property
    def signs(self) -> tuple[Connection[Any, Any], int]:
        """What becomes ready, for `multiprocessing.connection.wait`, when it has an answer or has ended."""
        return self.pipe, self._process.sentinel

    def begin(self, work: Callable[..., Any], task: object) -> None:
        """Let it compute; `work` travels only when it is another than before."""
        message = pickle.dumps((None if work is self._work else work, task), protocol=pickle.HIGHEST_PROTOCOL)
        self._work = work
        with suppress(OSError):  # where it has ended, `answer` says so
            self.pipe.send_bytes(message)

    def answer(self) -> Computed | Raised | Lost:
        """What became of the task, once a sign is ready."""
        try:
            if self.pipe.poll():
                answer: Computed | Raised = pickle.loads(self.pipe.recv_bytes())
                return answer
        except (EOFError, OSError):
            pass
        self._process.join()
        return Lost(reason=_ending(self._process.exitcode))

    def tell_to_end(self) -> None:
        """Do not wait for it."""
        self._process.terminate()

    def end(self, *, grace_s: float = GRACE_S) -> None:
        """Wait until it has ended; kill it where it does not."""
        self._process.join(max(grace_s, 0.0))
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self.pipe.close()


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Put off an interrupt from the keyboard: a process that starts would print where it was interrupted."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(tasks: Connection, loads: str | None) -> None:
    """Compute tasks until nobody has any."""
    if sys.platform != "win32":
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    if loads is not None:
        import_module(loads)
    work: Callable[..., Any] | None = None
    while True:
        try:
            message = tasks.recv_bytes()
        except (EOFError, OSError):
            return
        try:
            other, task = pickle.loads(message)
            work = other or work
            assert work is not None, "the first message brings the work"
            answer = pickle.dumps(Computed(value=work(task)), protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:  # noqa: BLE001 - it is raised again where the task came from
            answer = _told(error)
        tasks.send_bytes(answer)


def _told(error: Exception) -> bytes:
    """An exception that can travel, with the place where it arose."""
    where = traceback.format_exc()
    error.add_note(f"in a worker process:\n{where}")
    try:
        told = pickle.dumps(Raised(error=error))
        pickle.loads(told)
    except Exception:  # noqa: BLE001 - whatever its class does when it is pickled
        told = pickle.dumps(Raised(error=RuntimeError(f"in a worker process:\n{where}")))
    return told


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _ending(code: int | None) -> str:
    """How a process ended, in words."""
    if code is None or code >= 0:
        return f"its process ended with status {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"its process was ended by {name}" + (", as when memory runs out" if name == "SIGKILL" else "")

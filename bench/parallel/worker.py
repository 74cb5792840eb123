"""One process beside this one that computes task after task, with a pipe of its own."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.util import Finalize
from threading import Thread
from typing import Any

from bench.parallel.places import Lost
from bench.parallel.starting import start
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
    """A process beside this one with one thread per library; it computes one task at a time.

    Its pipe is its own, so that a process that is killed in the middle of an answer leaves half a message to nobody
    else. It ends by itself when this process ends, however that comes about. An interrupt from the keyboard reaches
    this process alone.

    Args:
        loads: modules that it has imported before it has a task.
    """

    def __init__(self, loads: Sequence[str] = ()) -> None:
        self._process, self.pipe = start(_serve, loads=loads)
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
        del self._process  # it ends when this is gone, should it live on because its fork server was killed
        self.pipe.close()


def _serve(tasks: Connection, loads: Sequence[str], environment: dict[str, str]) -> None:
    """Compute tasks until nobody has any."""
    if sys.platform != "win32":
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    os.environ.clear()  # a forked process has that of the fork server
    os.environ.update(environment)
    Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    for module in loads:
        import_module(module)
    gc.freeze()  # or what is loaded is looked through again and again, and its pages are shared no more
    gc.enable()  # the fork server does without
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

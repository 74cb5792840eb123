"""How a process beside this one starts: forked from a server that has loaded already where that is safe, or spawned."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import forkserver, get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from bench.threads import THREAD_VARIABLES

SERVER = "bench.parallel.fork_server"
FORKS = sys.platform == "linux"  # libraries of other systems do not survive a fork

Serve = Callable[[Connection, Sequence[str], dict[str, str]], None]


def load_ahead(modules: Sequence[str]) -> bool:
    """Start the fork server, unless it runs; it imports while this process goes on.

    It is one for all and ends with this process. The first call decides what it has loaded; who needs more imports
    that too. Its libraries keep to one thread. One of Arrow's allocators adds a thread of its own, asleep, and holds
    still for a fork.

    Args:
        modules: names; what cannot be imported is left to the processes themselves, which say so.

    Returns:
        Whether processes can be forked; where they are spawned, nothing starts.
    """
    if not FORKS:
        return False
    forkserver.set_forkserver_preload([SERVER, *modules])
    try:
        with interrupts_later(), _environment(_of_the_server()):
            forkserver.ensure_running()
    except OSError:  # a system that forbids it
        return False
    return True


def start(serve: Serve, *, loads: Sequence[str]) -> tuple[BaseProcess, Connection]:
    """Start a process that calls `serve` with its end of a pipe, `loads`, and the environment of this process.

    It starts with interrupts put off; call it with `interrupts_later`.

    Args:
        serve: function of a module.
        loads: modules that it needs; where processes are forked, they have them from their start.

    Returns:
        process: the process.
        pipe: this end of the pipe.
    """
    if load_ahead(loads):
        with suppress(EOFError, OSError):  # the server has ended, as when a module that it loads crashes
            return _started("forkserver", serve, loads)
    return _started("spawn", serve, loads)


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Put off an interrupt from the keyboard: a process that starts would print where it was interrupted."""
    if sys.platform == "win32":
        yield
        return
    resource_tracker.ensure_running()  # every process that starts has it start, and its start lets interrupts through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _started(method: str, serve: Serve, loads: Sequence[str]) -> tuple[BaseProcess, Connection]:
    context: Any = get_context(method)
    ours, theirs = context.Pipe()
    try:
        process = context.Process(target=serve, args=(theirs, tuple(loads), dict(os.environ)), name="worker")
        process.start()
    except BaseException:
        ours.close()
        raise
    finally:
        theirs.close()
    return process, ours


def _of_the_server() -> dict[str, str]:
    """Its libraries keep to one thread, as no other survives a fork, and are found where this process finds them.

    Python would look into the working folder first, where any file may bear a library's name.
    """
    paths = (path or str(Path.cwd()) for path in sys.path)
    threads = dict.fromkeys(THREAD_VARIABLES, "1")
    return {**threads, "PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(paths)}


@contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

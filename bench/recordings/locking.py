"""One process at a time in a folder; the lock goes with the process, however it ends."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import DataError

if sys.platform != "win32":
    import fcntl


@contextmanager
def alone_in(folder: Path, *, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Hold a folder that exists. Without locks on Windows.

    Args:
        folder: to be held.
        shared: together with others that share it, but with nobody who does not.
        wait: until it is free, instead of refusing.

    Raises:
        DataError: somebody else holds it, and nobody waits.
    """
    if sys.platform == "win32":
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
        except BlockingIOError as error:
            got, do = "one at which another run works", "wait until it has ended, or give another folder with --out"
            raise DataError(folder, expected="a folder for this run alone", got=got, do=do) from error
        yield
    finally:
        os.close(handle)

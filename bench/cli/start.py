"""Checks before libraries are loaded, and the error when one of them does not get its memory."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum

from bench.errors import BenchError, UsageError

LEAST_ADDRESSES_BYTES = 3_000_000_000  # a run takes 1.5 GB; with 2 GB a library now and then aborts the process
HELP = "--help"
NO_MEMORY = ("failed to map segment", "cannot allocate memory", "can't start new thread", "bad_alloc")

VERBOSE, QUIET = ("-v", "--verbose"), ("-q", "--quiet")


class Verbosity(Enum):
    """Amount of output that the user wants to read."""

    QUIET = "quiet"
    USUAL = "usual"
    VERBOSE = "verbose"


_verbosity = Verbosity.USUAL


def verbosity() -> Verbosity:
    """Return the amount of output that the user wants to read."""
    return _verbosity


def take_verbosity(arguments: Sequence[str]) -> list[str]:
    """Take `-v` and `-q` out of a command line, before or behind the command, and hold to them from now on."""
    global _verbosity
    end = arguments.index("--") if "--" in arguments else len(arguments)
    asked = [word for word in arguments[:end] if word in {*VERBOSE, *QUIET}]
    _verbosity = Verbosity.USUAL if not asked else Verbosity.VERBOSE if asked[-1] in VERBOSE else Verbosity.QUIET
    return [word for word in arguments[:end] if word not in {*VERBOSE, *QUIET}] + list(arguments[end:])


def refuse_unfit(arguments: Sequence[str]) -> None:
    """Refuse a call that would end in a library's traceback.

    Args:
        arguments: of the command line.

    Raises:
        UsageError: an argument that is not UTF-8, or a limit below which libraries cannot be loaded.
    """
    for argument in arguments:
        if not _is_utf8(argument):
            raise UsageError(f"expected arguments in UTF-8, got {argument!r}; rename the file or folder")
    limit = _address_limit_bytes()
    if HELP not in arguments and limit is not None and limit < LEAST_ADDRESSES_BYTES:
        expected = f"a limit of at least {LEAST_ADDRESSES_BYTES // 1024} kB of addresses"
        raise UsageError(f"ulimit -v: expected {expected}, got {limit // 1024}; raise it, or limit the memory itself")


@contextmanager
def report_lack_of_memory() -> Iterator[None]:
    """Say in one line that a library inside the block did not get its memory or thread; they raise all kinds.

    Raises:
        UsageError: it did not.
    """
    try:
        yield
    except BenchError:
        raise
    except Exception as error:
        told = next((one for one in _chain(error) if _lacks_memory(one)), None)
        if told is None:
            raise
        got = " ".join(f"{type(told).__name__}: {told}".split())[:200]
        raise UsageError(
            f"expected memory and threads, got {got}; give this process more, or take fewer --workers"
        ) from error


def _lacks_memory(error: BaseException) -> bool:
    text = str(error).lower()
    number = getattr(error, "errno", None)
    return isinstance(error, MemoryError) or number == errno.ENOMEM or any(told in text for told in NO_MEMORY)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _is_utf8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _address_limit_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit

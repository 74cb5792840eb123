"""End of a command that its user, or the system, interrupts."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from types import FrameType

import typer

from bench.cli.console import say

INTERRUPTED = 130  # as shells tell of SIGINT
ENDED = 143  # and of SIGTERM


def resumable(folder: object) -> AbstractContextManager[None]:
    """End in one line when the block, which stores what is done in a folder, is interrupted."""
    return interruptible(f"what is done is in {folder}, and the same command goes on from there")


@contextmanager
def interruptible(left: str) -> Iterator[None]:
    """End in one line when the user, or the system that shuts down, ends the block.

    Args:
        left: what there is then, and how to go on.
    """
    before = signal.signal(signal.SIGTERM, _end)
    try:
        yield
    except KeyboardInterrupt as reason:
        asked = isinstance(reason, _Ended)
        how = "ended" if asked else "interrupted"
        say(f"{how}; {left}")
        raise typer.Exit(ENDED if asked else INTERRUPTED) from None
    finally:
        signal.signal(signal.SIGTERM, before)


class _Ended(KeyboardInterrupt):
    """SIGTERM came."""


def _end(_: int, __: FrameType | None) -> None:
    raise _Ended

"""Long work: how far it is, in a bar or in lines now and then, and how it ends when it is interrupted."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from time import monotonic
from types import FrameType

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bench.commands.console import Verbosity, harmless, say, verbosity

FIRST_LINE_S = 10.0  # without a terminal: a line of progress after so long, then each a tenth of the time so far later
INTERRUPTED, ENDED = 130, 143  # exit statuses, as shells report SIGINT and SIGTERM

Report = Callable[[float, int], None]


@contextmanager
def progress_bar(title: str, unit: str, progress: Report | None = None) -> Iterator[Report]:
    """A bar on the error stream; where that is no terminal, a line now and then of what takes long.

    Args:
        title: what goes on.
        unit: of what is counted.
        progress: of a program, which takes the place of the bar.

    Yields:
        Takes the amount done, fractions allowed, and the total; 0 while that is not known.
    """
    terminal = Console(stderr=True)
    if progress is not None:
        yield progress
    elif verbosity() < Verbosity.USUAL:
        yield lambda *_: None
    elif not terminal.is_terminal:
        yield _lines(title, unit)
    else:
        of_all, left = MofNCompleteColumn(), TimeRemainingColumn()
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), of_all, TextColumn(unit))
        with Progress(*columns, TimeElapsedColumn(), TextColumn("left"), left, console=terminal) as bar:
            task = bar.add_task(harmless(title), total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total or None)


def _lines(title: str, unit: str) -> Report:
    """Reports progress as "scoring: 120/580 images after 20 s"."""
    started, last_s = monotonic(), 0.0

    def report(done: float, total: int) -> None:
        nonlocal last_s
        elapsed_s = monotonic() - started
        if elapsed_s - last_s >= max(FIRST_LINE_S, elapsed_s / 10):
            last_s = elapsed_s
            say(f"{title}: {int(done)}/{total} {unit} after {elapsed_s:.0f} s", to_errors=True)

    return report


def resumable(folder: object) -> AbstractContextManager[None]:
    """End in one line when the block, which stores what is done in a folder, is interrupted."""
    return interruptible(f"what is done is in {folder}, and the same command goes on from there")


@contextmanager
def interruptible(left: str) -> Iterator[None]:
    """End in one line when the user, or the system that shuts down, ends the block.

    Args:
        left: what there is then, and how to go on.
    """
    if verbosity() is Verbosity.SILENT:  # a program has its own way to end
        yield
        return
    before = signal.signal(signal.SIGTERM, _end)
    try:
        yield
    except KeyboardInterrupt as reason:
        how, status = ("ended", ENDED) if isinstance(reason, _Ended) else ("interrupted", INTERRUPTED)
        say(f"{how}; {left}")
        raise typer.Exit(status) from None
    finally:
        signal.signal(signal.SIGTERM, before)


class _Ended(KeyboardInterrupt):
    """SIGTERM came."""


def _end(_: int, __: FrameType | None) -> None:
    raise _Ended

"""Long work: how far it is, in a bar or in lines now and then, and how it ends when it is interrupted."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import timedelta
from math import ceil
from time import monotonic
from types import FrameType

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from bench.commands.console import Verbosity, harmless, say, verbosity

FIRST_LINE_S = 10.0  # without a terminal: a line of progress after so long, then each a tenth of the time so far later
LEAST_DONE = 3  # of what is counted, or a quarter of it, before the time left is estimated
INTERRUPTED, ENDED = 130, 143  # exit statuses, as shells report SIGINT and SIGTERM

Report = Callable[[float, int], None]
Show = Callable[[float, int, float, float, float | None], None]


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
    started, before = monotonic(), None  # done already at the first report, as recordings that are found

    def report(done: float, total: int) -> None:
        nonlocal before
        before = done if before is None else before
        elapsed_s, new = monotonic() - started, done - before
        enough = total > 0 and new >= min(LEAST_DONE, total / 4)  # the first takes longest, as workers start
        left_s = elapsed_s * (total - done) / new if enough else None
        show(done, total, elapsed_s, new / elapsed_s if elapsed_s else 0.0, left_s)

    if progress is not None:
        yield progress
        return
    with _shown(title, unit) as show:
        yield report


def _shown(title: str, unit: str) -> AbstractContextManager[Show]:
    """Display of progress: takes what is done, the total, seconds, the rate per second, and seconds left."""
    terminal = Console(stderr=True)
    if verbosity() < Verbosity.USUAL:
        return nullcontext(lambda *_: None)
    return _bar(title, unit, terminal) if terminal.is_terminal else nullcontext(_lines(title, unit))


@contextmanager
def _bar(title: str, unit: str, terminal: Console) -> Iterator[Show]:
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[amount]}"),
        TimeElapsedColumn(),
        TextColumn("left {task.fields[left]}", style="progress.remaining"),
    )
    with Progress(*columns, console=terminal) as bar:
        task = bar.add_task(harmless(title), total=None, amount="", left="-:--:--")

        def show(done: float, total: int, _: float, rate: float, left_s: float | None) -> None:
            pace = f"{rate:.1f} {unit}/s" if rate >= 1.0 else f"{60.0 * rate:.1f} {unit}/min"
            amount = f"{int(done)}/{total or '?'} {unit} {pace if rate else ''}"
            left = "-:--:--" if left_s is None else str(timedelta(seconds=ceil(left_s)))
            bar.update(task, completed=done, total=total or None, amount=amount, left=left)

        yield show


def _lines(title: str, unit: str) -> Show:
    """Reports progress as "scoring: 120/580 images after 20 s, about 77 s left"."""
    last_s = 0.0

    def show(done: float, total: int, elapsed_s: float, _: float, left_s: float | None) -> None:
        nonlocal last_s
        if elapsed_s - last_s >= max(FIRST_LINE_S, elapsed_s / 10):
            last_s = elapsed_s
            left = "" if left_s is None else f", about {left_s:.0f} s left"
            say(f"{title}: {int(done)}/{total} {unit} after {elapsed_s:.0f} s{left}", to_errors=True)

    return show


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

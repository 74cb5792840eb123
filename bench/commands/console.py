"""The terminal: the only place that prints, how much of it the user wants to read, and how far long work is.

Much of what is printed comes from outside: names, titles, failures. Here it is made harmless, whoever prints it: each
text is one line of visible characters, which no terminal and no CI server takes for a command.
"""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from enum import IntEnum
from io import TextIOWrapper
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from types import FrameType
from typing import IO, TYPE_CHECKING

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bench.errors import OutputError
from bench.plain_text import counted, plain

if TYPE_CHECKING:
    from bench.reporting.document import Block

FAILURES = 2  # exit status where single images, units or recordings could not be used, as for usage and data errors
TABLE_COLUMNS = 110  # of tables that go into a file or a log
SHOWN_FAILURES = 10
SHOWN_FILES, MOST_FILES = 4, 6
FIRST_LINE_S = 10.0  # without a terminal: a line of progress after so long, then each a tenth of the time so far later
INTERRUPTED, ENDED = 130, 143  # exit statuses, as shells report SIGINT and SIGTERM

VERBOSE, QUIET = ("-v", "--verbose"), ("-q", "--quiet")

# GitHub reads "::error::" at the start of a line, and "##[error]" anywhere; Azure reads "##vso[...]".
_COMMAND = re.compile(r":(?=:[A-Za-z])|#(?=#[\w.-]*\[)")


Report = Callable[[float, int], None]  # takes the amount done, fractions allowed, and the total; 0 while not known


class Verbosity(IntEnum):
    """Amount of output that the user wants to read; a program that calls the functions reads what they return."""

    SILENT = 0
    QUIET = 1
    USUAL = 2
    VERBOSE = 3


_verbosity = Verbosity.SILENT


def verbosity() -> Verbosity:
    """Return the amount of output that the user wants to read."""
    return _verbosity


def take_verbosity(arguments: Sequence[str]) -> list[str]:
    """Take `-v` and `-q` out of a command line, before or behind the command, and hold to them from now on."""
    global _verbosity
    end = arguments.index("--") if "--" in arguments else len(arguments)
    chosen = [word for word in arguments[:end] if word in {*VERBOSE, *QUIET}]
    _verbosity = Verbosity.USUAL if not chosen else Verbosity.VERBOSE if chosen[-1] in VERBOSE else Verbosity.QUIET
    return [word for word in arguments[:end] if word not in {*VERBOSE, *QUIET}] + list(arguments[end:])


def be_silent() -> None:
    """Print no notes, details and bars from now on."""
    global _verbosity
    _verbosity = Verbosity.SILENT


def harmless(text: str) -> str:
    """One line that no terminal and no CI server takes for a command; strings in JSON keep their meaning."""
    return _COMMAND.sub(lambda found: f"\\u{ord(found[0]):04x}", plain(text))


def say(line: str, *, style: str = "", to_errors: bool = False) -> None:
    """Print a line.

    Args:
        line: may hold text from outside.
        style: of the whole line.
        to_errors: to the error stream.
    """
    _print(Text(harmless(line), style=style), to_errors=to_errors)


def note(line: str) -> None:
    """Print what is no result: cost, files, where something lies; nothing for those who want to read little."""
    if verbosity() >= Verbosity.USUAL:
        say(line)


def detail(line: str) -> None:
    """Print what only those want to read who look for a fault, to the error stream."""
    if verbosity() is Verbosity.VERBOSE:
        say(line, to_errors=True)


def print_blocks(blocks: Iterable[Block]) -> None:
    """Print the blocks of a report; notes are wrapped, other lines are whole for those who search a log."""
    from bench.reporting.document import to_terminal

    for part in to_terminal(blocks, clean=harmless):
        _print(part, wrap=not isinstance(part, Text) or part.style == "dim")


def write_out(document: str) -> None:
    """Print a text of several lines that the program makes, as JSON; strings in it stay what they are."""
    for line in document.splitlines():
        say(line)


def annotate(commands: Iterable[str]) -> None:
    """Print commands to GitHub, in which text from outside is escaped."""
    for command in commands:
        _print(Text(plain(command)))


def print_failures(failures: Sequence[str], *, all_in: str) -> None:
    """Print what failed, the first few of it.

    Args:
        failures: one line each.
        all_in: file that holds all of them.
    """
    shown = [f"failed: {failure}" for failure in failures[:SHOWN_FAILURES]]
    if len(failures) > SHOWN_FAILURES:
        shown.append(f"... and {counted(len(failures) - SHOWN_FAILURES, 'more failure')}, all in {all_in}")
    for line in shown:
        say(line, style="red")


def note_files(files: Iterable[Path]) -> None:
    """Print what was written: all paths of a few, or the first of them and how many more lie in which folder."""
    paths = list(files)
    shown = paths if len(paths) <= MOST_FILES else paths[:SHOWN_FILES]
    for file in shown:
        note(str(file))
    if rest := paths[len(shown) :]:
        note(f"and {counted(len(rest), 'more file')} in {os.path.commonpath([file.parent for file in rest]) or '.'}")


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
        with _lines(title, unit) as report:
            yield report
    else:
        of_all, left = MofNCompleteColumn(), TimeRemainingColumn()
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), of_all, TextColumn(unit))
        with Progress(*columns, TimeElapsedColumn(), TextColumn("left"), left, console=terminal) as bar:
            task = bar.add_task(harmless(title), total=None)
            yield lambda done, total: bar.update(task, completed=done, total=total or None)


@contextmanager
def _lines(title: str, unit: str) -> Iterator[Report]:
    """Print "scoring: 120/580 images after 20 s, about 77 s left" now and then, also where nothing new is reported."""
    started, last, ended = monotonic(), (0.0, 0), Event()

    def report(done: float, total: int) -> None:
        nonlocal last
        last = done, total

    def print_lines() -> None:
        pause_s = FIRST_LINE_S
        while not ended.wait(pause_s):
            (done, total), elapsed_s = last, monotonic() - started
            left = f", about {elapsed_s * (total - done) / done:.0f} s left" if 0 < done < total else ""
            say(f"{title}: {int(done)}/{total or '?'} {unit} after {elapsed_s:.0f} s{left}", to_errors=True)
            pause_s = max(FIRST_LINE_S, elapsed_s / 10)

    Thread(target=print_lines, daemon=True).start()
    try:
        yield report
    finally:
        ended.set()


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
    before = signal.signal(signal.SIGTERM, _terminate)
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


def _terminate(_: int, __: FrameType | None) -> None:
    raise _Ended


def _print(shown: Table | Text, *, to_errors: bool = False, wrap: bool = False) -> None:
    """Print.

    Raises:
        OutputError: the disk to which the output goes is full. Where nobody reads it any more, as behind `| head`, the
            rest is not printed, and the command goes on.
    """
    console = _console(to_errors=to_errors)
    try:
        console.print(shown, soft_wrap=not wrap, crop=False)
    except OSError as error:
        _end(console.file)
        if not to_errors:
            raise OutputError.of(error, "standard output") from error


def _console(*, to_errors: bool = False) -> Console:
    """A table keeps its width where there is no terminal, and letters that the output has no code for are shown."""
    stream = sys.stderr if to_errors else sys.stdout
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")
    probe = _Console(stderr=to_errors)
    return probe if probe.is_terminal else _Console(stderr=to_errors, width=TABLE_COLUMNS)


class _Console(Console):
    def on_broken_pipe(self) -> None:
        _end(self.file)


def _end(stream: IO[str]) -> None:
    """Let the rest of the output go nowhere; else the interpreter tries to write it once more at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)

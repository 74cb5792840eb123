"""The terminal: the only place that prints, and progress bars that vanish where nobody watches.

Much of what is printed comes from outside: names, titles, failures. Here it is made harmless, whoever prints it: each
text is one line of visible characters, which no terminal and no CI server takes for a command.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import takewhile
from time import monotonic
from typing import IO, TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from bench.cli.start import Verbosity, verbosity
from bench.errors import OutputError
from bench.plain_text import plain

if TYPE_CHECKING:
    from bench.reporting.document import Block

TABLE_COLUMNS = 110  # of tables that go into a file or a log
SHOWN_FAILURES = 10
SHOWN_FILES, MOST_FILES = 4, 6
FIRST_LINE_S = 10.0  # without a terminal: a line of progress after so long, then each a tenth of the time so far later
LEAST_DONE = 3  # of what is counted, or a quarter of it, before the time left is told
RATE_OVER_S = 300.0  # a unit of a slow method takes minutes

# GitHub reads "::error::" at the start of a line, and "##[error]" anywhere; Azure reads "##vso[...]".
_COMMAND = re.compile(r":(?=:[A-Za-z])|#(?=#[\w.-]*\[)")


def say(line: str, *, style: str = "", to_errors: bool = False) -> None:
    """Print a line.

    Args:
        line: may hold text from outside.
        style: of the whole line.
        to_errors: to the error stream.
    """
    _print(Text(_harmless(line), style=style), to_errors=to_errors)


def note(line: str) -> None:
    """Print what is no result: cost, files, where something lies; nothing for those who want to read little."""
    if verbosity() is not Verbosity.QUIET:
        say(line)


def detail(line: str) -> None:
    """Print what only those want to read who look for a fault, to the error stream."""
    if verbosity() is Verbosity.VERBOSE:
        say(line, to_errors=True)


def show(blocks: Iterable[Block]) -> None:
    """Print the blocks of a report; notes are wrapped, other lines are whole for those who search a log."""
    from bench.reporting.document import to_terminal

    for part in to_terminal(blocks, clean=_harmless):
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
        shown.append(f"... and {len(failures) - SHOWN_FAILURES} more failures, all in {all_in}")
    for line in shown:
        say(line, style="red")


def note_files(files: Sequence[str]) -> None:
    """Print what was written: all paths of a few, or the first of them and how many more lie in which folder."""
    shown = files if len(files) <= MOST_FILES else files[:SHOWN_FILES]
    for file in shown:
        note(file)
    if rest := [file.split("/")[:-1] for file in files[len(shown) :]]:
        common = takewhile(lambda names: len(set(names)) == 1, zip(*rest, strict=False))
        note(f"and {len(rest)} more files in {'/'.join(names[0] for names in common) or '.'}")


def stage_times(seconds: Mapping[str, float]) -> str:
    """Seconds by stage, as "decode 1.4, method 30.9"."""
    return ", ".join(f"{name} {spent:.1f}" for name, spent in seconds.items())


@contextmanager
def progress_bar(title: str, unit: str) -> Iterator[Callable[[float, int], None]]:
    """A bar on the error stream; where that is no terminal, a line now and then of what takes long.

    Args:
        title: what goes on.
        unit: of what is counted.

    Yields:
        Takes the amount done, fractions allowed, and the total; 0 while that is not known.
    """
    terminal = Console(stderr=True)
    if not terminal.is_terminal:
        yield _progress_lines(title, unit)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn(f"{{task.fields[whole]}} {unit}"),
        _RateColumn(unit),
        TimeElapsedColumn(),
        TextColumn("left"),
        _TimeLeftColumn(),
    )
    with Progress(
        *columns, console=terminal, disable=verbosity() is Verbosity.QUIET, speed_estimate_period=RATE_OVER_S
    ) as bar:
        task = bar.add_task(_harmless(title), total=None, whole="")

        def report(done: float, total: int) -> None:
            bar.update(task, completed=done, total=total or None, whole=f"{int(done)}/{total or '?'}")

        yield report


def _progress_lines(title: str, unit: str) -> Callable[[float, int], None]:
    """Reports progress as "scoring: 120/580 images after 20 s, about 77 s left"."""
    started = told = monotonic()
    before: float | None = None  # done already when it began, as recordings that are found

    def report(done: float, total: int) -> None:
        nonlocal told, before
        now = monotonic()
        before = done if before is None else before
        if verbosity() is Verbosity.QUIET or now - told < max(FIRST_LINE_S, (now - started) / 10):
            return
        told = now
        new = done - before
        left = f", about {(now - started) * (total - done) / new:.0f} s left" if _enough(new, total) else ""
        say(f"{title}: {int(done)}/{total} {unit} after {now - started:.0f} s{left}", to_errors=True)

    return report


def _enough(done: float, total: float | None) -> bool:
    """True if enough is done to estimate the rest: the first of a few takes longest, as workers start."""
    return total is not None and total > 0.0 and done >= min(LEAST_DONE, total / 4)


class _TimeLeftColumn(TimeRemainingColumn):
    def render(self, task: Task) -> Text:
        """The time left; dashes before enough is done."""
        if task.finished or _enough(task.completed, task.total):
            return super().render(task)
        return Text("-:--:--", style="progress.remaining")


class _RateColumn(ProgressColumn):
    """Column of the rate: per second, or per minute where that is little."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """The rate; nothing before it is known."""
        speed = task.finished_speed or task.speed
        if not speed:
            return Text("")
        shown = f"{speed:.1f} {self._unit}/s" if speed >= 1.0 else f"{60.0 * speed:.1f} {self._unit}/min"
        return Text(shown, style="progress.data.speed")


def _print(shown: Table | Text, *, to_errors: bool = False, wrap: bool = False) -> None:
    """Print.

    Raises:
        OutputError: the disk to which the output goes is full. Where nobody reads it any more, as behind `| head`, the
            rest is not printed, and the command goes on.
    """
    console = _console(to_errors=to_errors)
    try:
        console.print(shown, soft_wrap=not wrap)
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


def _harmless(text: str) -> str:
    """One line that no terminal and no CI server takes for a command; strings in JSON keep their meaning."""
    return _COMMAND.sub(lambda found: f"\\u{ord(found[0]):04x}", plain(text))

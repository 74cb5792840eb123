"""The terminal: one console, progress bars that vanish where nobody watches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

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
from rich.text import Text

TABLE_COLUMNS = 110  # of tables that go into a file or a log
SHOWN_FAILURES = 10
RATE_OVER_S = 300.0  # a unit of a slow method takes minutes


def console() -> Console:
    """The console for results; a table keeps its width where there is no terminal."""
    probe = Console()
    return probe if probe.is_terminal else Console(width=TABLE_COLUMNS)


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
        console().print(line, style="red", highlight=False, soft_wrap=True, markup=False)


@contextmanager
def progress_bar(title: str, unit: str) -> Iterator[Callable[[float, int], None]]:
    """A bar on the error stream; silent when that is not a terminal.

    Args:
        title: what goes on.
        unit: of what is counted.

    Yields:
        Takes the amount done, fractions allowed, and the total.
    """
    terminal = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn(f"{{task.fields[whole]}} {unit}"),
        _RateColumn(unit),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=terminal, disable=not terminal.is_terminal, speed_estimate_period=RATE_OVER_S
    ) as bar:
        task = bar.add_task(title, total=None, whole="")

        def report(done: float, total: int) -> None:
            bar.update(task, completed=done, total=total, whole=f"{int(done)}/{total}")

        yield report


class _RateColumn(ProgressColumn):
    """How much is done in a second, or a minute where that is little."""

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

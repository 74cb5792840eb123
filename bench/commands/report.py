"""`report`: the page of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.commands.command import Flag, Place
from bench.commands.console import Report, note_files, progress_bar, say
from bench.commands.run import NamedRun, run_folder


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPage:
    """The page of a run.

    Attributes:
        files: the page first, then its charts as files of their own.
        problems: why pictures are missing, one line each.
    """

    files: tuple[Path, ...]
    problems: tuple[str, ...]


def report(run: NamedRun, *, out: Place = None, pictures: Flag = True, progress: Report | None = None) -> RunPage:
    """Write an HTML page of a run that opens offline: metrics, charts, worst cases.

    Args:
        run: stored, or its folder.
        out: file to write; default: index.html in the protocol's folder.
        pictures: draw the worst images; needs the data set.
        progress: called with the pictures done and their number.

    Raises:
        DataError: a run is missing or damaged.

    Examples:
        fisheye-bench report reports/runs/demo-spherical
    """
    from bench.reporting.run_page import write_page

    place = None if out is None else Path(out)
    with progress_bar("drawing frames", "pictures", progress) as drawn:
        files, problems = write_page(run_folder(run), out=place, pictures=pictures, progress=drawn)
    return RunPage(files=files, problems=problems)


def show(page: RunPage) -> None:
    """Print the files, and why pictures are missing."""
    for problem in page.problems:
        say(f"pictures missing: {problem}", style="yellow")
    note_files(page.files)

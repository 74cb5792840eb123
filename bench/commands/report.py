"""`report`: the page of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.commands import options
from bench.commands.command import PATH, TEXT
from bench.commands.console import note_files, say
from bench.commands.progress import Report, progress_bar
from bench.errors import UnknownNameError

if TYPE_CHECKING:
    from bench.commands.runs import Run


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPage:
    """The page of a run.

    Attributes:
        files: the page first, then its charts as files of their own.
        problems: why pictures are missing, one line each.
    """

    files: tuple[Path, ...]
    problems: tuple[str, ...]


def report(
    run: options.StoredRun,
    *,
    category: Annotated[str | None, typer.Option(help="Only this kind of motion, for example preceding.")] = None,
    beside: Annotated[
        str | Path | Run | None,
        typer.Option(metavar="RUN", help="Another run of the same data and protocol; show both on the same images."),
        TEXT,
    ] = None,
    out: Annotated[
        str | Path | None,
        typer.Option(help="File to write; default: index.html or index-CATEGORY.html in the protocol's folder."),
        PATH,
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the worst images; needs the data set.")] = True,
    progress: Report | None = None,
) -> RunPage:
    """Write an HTML page of a run that opens offline: metrics, charts, worst cases.

    Args:
        run: stored, or its folder.
        category: None for all.
        beside: stored, or its folder.
        out: None for the default.
        pictures: False where the data set is not there.
        progress: called with the pictures done and their number.

    Raises:
        UnknownNameError: no such kind of motion.
        DataError: a run is missing or damaged.
        UsageError: `beside` does not compare.
    """
    from bench.commands.runs import run_folder
    from bench.reference import Category
    from bench.reporting.charts import write_figures
    from bench.reporting.run_page import write_page

    if category is not None and category not in set(Category):
        raise UnknownNameError("category", category, (known.value for known in Category))
    folder, kind = run_folder(run), None if category is None else Category(category)
    with progress_bar("drawing frames", "pictures", progress) as drawn:
        page = write_page(
            folder,
            category=kind,
            out=None if out is None else Path(out),
            other=None if beside is None else run_folder(beside),
            pictures=pictures,
            progress=drawn,
        )
    files = (page.file, *write_figures(folder, category=kind))
    return RunPage(files=files, problems=page.problems)


def show(page: RunPage) -> None:
    """Print the files, and why pictures are missing."""
    for problem in page.problems:
        say(f"pictures missing: {problem}", style="yellow")
    note_files(page.files)

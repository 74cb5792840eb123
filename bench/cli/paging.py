"""The page of a run."""

from __future__ import annotations

from pathlib import Path

from bench.cli.console import console, progress_bar
from bench.errors import UnknownNameError
from bench.reference import Category
from bench.reporting.page.build import write_page
from bench.reporting.page.figure_files import write_figures


def report(run: Path, *, category: str | None, out: Path | None, pictures: bool) -> None:
    """Write the page of a run and its charts for papers, and print the files."""
    if category is not None and category not in set(Category):
        raise UnknownNameError("category", category, (known.value for known in Category))
    kind = None if category is None else Category(category)
    with progress_bar("drawing the worst frames", "pictures") as progress:
        page = write_page(run, category=kind, out=out, pictures=pictures, progress=progress)
    screen = console()
    for problem in page.problems:
        screen.print(f"pictures missing: {problem}", style="yellow", highlight=False, soft_wrap=True, markup=False)
    for file in (page.file, *write_figures(run, category=kind)):
        screen.print(str(file), highlight=False, soft_wrap=True, markup=False)

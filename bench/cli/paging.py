"""The page of a run."""

from __future__ import annotations

from pathlib import Path

from bench.cli.console import progress_bar, say
from bench.cli.places import destination
from bench.errors import UnknownNameError
from bench.harness.remote_runs import RemoteRun
from bench.reference import Category
from bench.reporting.page.build import write_page
from bench.reporting.page.charts import write_figures


def report(run: str, *, category: str | None, out: Path | None, pictures: bool) -> None:
    """Write the page of a run and its charts for papers, and print the files."""
    if category is not None and category not in set(Category):
        raise UnknownNameError("category", category, (known.value for known in Category))
    kind = None if category is None else Category(category)
    where = destination(run, Path(run))
    if isinstance(where.mirror, RemoteRun):
        where.mirror.download_results()
    with progress_bar("drawing the worst frames", "pictures") as progress:
        page = write_page(where.folder, category=kind, out=out, pictures=pictures, progress=progress)
    for problem in page.problems:
        say(f"pictures missing: {problem}", style="yellow")
    files = (page.file, *write_figures(where.folder, category=kind))
    where.mirror.upload_results()
    for file in files:
        say(where.told(file))

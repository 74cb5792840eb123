"""`report`: the page of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note_files, say
from bench.cli.options import StoredRun
from bench.cli.progress import progress_bar


def report(
    run: StoredRun,
    category: Annotated[str | None, typer.Option(help="Only this kind of motion, for example preceding.")] = None,
    beside: Annotated[
        str | None,
        typer.Option(metavar="RUN", help="Another run of the same data and protocol: both on the same images."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The file; default: index.html or index-CATEGORY.html beside its results.")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="Draw the worst frames, from the data set.")] = True,
) -> None:
    """Write one page to read, from disk and without a network: metrics, charts, the worst cases."""
    from bench.api.report import report
    from bench.api.runs import run_folder

    folder = run_folder(run)
    with progress_bar("drawing frames", "pictures") as progress:
        page = report(folder, category=category, beside=beside, out=out, pictures=pictures, progress=progress)
    for problem in page.problems:
        say(f"pictures missing: {problem}", style="yellow")
    note_files(page.files)

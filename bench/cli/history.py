"""`history`: one method's headline metrics over commits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import note_files, say_unlisted, show


def history(
    runs: Annotated[list[Path], typer.Argument(help="Runs, or folders that hold runs at any depth.")],
    out: Annotated[
        Path | None, typer.Option(help="Also write the charts, history.html, .md, .csv and .tex into this folder.")
    ] = None,
) -> None:
    """Show a method's headline metrics over commits, and what changed from each to the next.

    Run it in the repository of the method, which knows the times of its commits.
    """
    from bench.api.history import history
    from bench.reporting.history import history_tables

    read = history(*runs, out=out)
    show(history_tables(read.found))
    say_unlisted(read.found.damaged, read.found.packed)
    note_files(read.files)
    if read.found.damaged:
        raise typer.Exit(options.FAILURES)

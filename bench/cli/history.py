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
    from bench.reporting.history import history_tables, read_history, write_history

    found = read_history(runs, checkout=Path.cwd())
    show(history_tables(found))
    say_unlisted(found.damaged, found.packed)
    if out is not None:
        note_files(write_history(found, out))
    if found.damaged:
        raise typer.Exit(options.FAILURES)

"""`bundle`: a run in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli import options
from bench.cli.console import say


def bundle(
    run: options.StoredRun, out: Annotated[Path, typer.Option(metavar="FILE", help="The file, for example my.run.zip.")]
) -> None:
    """Pack what decides a run's metrics into one file, for others to list and to verify."""
    from bench.api.runs import run_folder
    from bench.exchange.bundle import write_bundle

    write_bundle(run_folder(run), out)
    say(str(out))

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
    from bench.api.bundle import write_bundle

    say(str(write_bundle(run, out)))

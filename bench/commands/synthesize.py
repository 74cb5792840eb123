"""`synthesize`: recordings of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.commands.console import note
from bench.plain_text import counted


def synthesize(
    scenario: Annotated[Path, typer.Argument(help="A scenario file.")],
    out: Annotated[Path, typer.Option(help="Folder of the recordings.")],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of worker processes; default: one per core.")
    ] = None,
) -> None:
    """Render a scenario into recordings; up-to-date recordings stay."""
    from bench.commands.data import rendering
    from bench.synthesis import synthesize as render

    with rendering(scenario, out) as report:
        folders = render(scenario, out, workers=workers, progress=report)
    note(f"{counted(len(folders), 'recording')} in {out}")

"""`synthesize`: recordings of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note
from bench.cli.options import Workers


def synthesize(
    scenario: Annotated[Path, typer.Argument(help="A scenario file.")],
    out: Annotated[Path, typer.Option(help="Folder of the recordings.")],
    workers: Workers = None,
) -> None:
    """Render a scenario into recordings; what is there and up to date stays."""
    from bench.cli.request import rendering
    from bench.synthesis import synthesize as render

    with rendering(scenario, out) as report:
        folders = render(scenario, out, workers=workers, progress=report)
    note(f"{len(folders)} recordings in {out}")

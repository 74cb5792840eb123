"""`synthesize`: recordings of a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.commands.console import note
from bench.commands.options import rendering
from bench.plain_text import counted


def synthesize(
    scenario: Annotated[Path, typer.Argument()],
    out: Annotated[Path, typer.Option()],
    workers: Annotated[int | None, typer.Option(min=1)] = None,
) -> None:
    """Render a scenario into recordings; those that are up to date are kept.

    Args:
        scenario: a scenario file.
        out: folder of the recordings.
        workers: number of worker processes; default: one per core.

    Examples:
        fisheye-bench synthesize datasets/tiny.scenario.yaml --out my-drives
    """
    from bench.synthesis import synthesize as render

    with rendering(scenario, out) as report:
        folders = render(scenario, out, workers=workers, progress=report)
    note(f"{counted(len(folders), 'recording')} in {out}")

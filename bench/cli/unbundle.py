"""`unbundle`: a run from one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note, say


def unbundle(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Written by `bundle`.")],
    out: Annotated[Path, typer.Option(help="Folder of the run, new or empty.")],
) -> None:
    """Unpack a run that somebody sent, checked; then `verify` it, and `leaderboard` lists it."""
    from bench.api.bundle import unpack_bundle

    manifest = unpack_bundle(file, out).manifest
    say(str(out))
    note(f"{manifest.title}; nothing of it is verified yet")

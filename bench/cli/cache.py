"""`cache`: what is cached of flow, likelihood and reference, and how to make it smaller."""

from __future__ import annotations

from typing import Annotated

import typer

from bench.cli.console import say
from bench.cli.options import Cache
from bench.errors import DataError


def cache(
    folder: Cache = None,
    limit_gb: Annotated[
        float | None,
        typer.Option(min=0, help="Remove the longest unused entries until the cache holds at most so many GB."),
    ] = None,
    clear: Annotated[bool, typer.Option("--clear", help="Remove everything.")] = False,
) -> None:
    """Say what the cache of flow, likelihood and reference holds, and make it smaller."""
    from bench.harness.cache import CacheFolder, default_folder

    limit_bytes = 0 if clear else None if limit_gb is None else int(limit_gb * 1e9)
    chosen = CacheFolder(folder=folder or default_folder())
    if not chosen.folder.is_dir():
        if folder is not None:
            raise DataError(folder, expected="the folder of a cache", got="no such folder")
        say(f"{chosen.folder}: no cache yet")
        return
    chosen.prepare()
    use = chosen.use() if limit_bytes is None else chosen.evict(limit_bytes)
    say(
        f"{chosen.folder}: {use.files} entries, {use.size_bytes / 1e6:.1f} MB; runs keep it below "
        f"{chosen.limit_bytes / 1e9:.0f} GB"
    )

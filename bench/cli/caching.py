"""`cache`: how large it is, and smaller."""

from __future__ import annotations

from pathlib import Path

from bench.cli.console import say
from bench.errors import DataError
from bench.harness.cache import CacheFolder, default_folder


def cache(folder: Path | None, *, limit_bytes: int | None) -> None:
    """Print what the cache holds, after making it as small as asked.

    Raises:
        DataError: the folder holds something else.
    """
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

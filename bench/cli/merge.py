"""`merge`: what took its place, for scripts that still call it."""

from __future__ import annotations

from bench.errors import UsageError


def merge() -> None:
    """Say what took the place of `merge`."""
    raise UsageError(
        "merge: a part is an unfinished run; give the command of the parts again without --shard, in a folder whose "
        "units/ holds those of all parts"
    )

"""What a name stands for: a part of this package, or one that an installed package adds by an entry point."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from bench.errors import UsageError


def known_places(group: str, own: Mapping[str, str]) -> dict[str, str]:
    """Name -> "module:attribute" of what there is; a name of the package's own cannot be taken by another.

    Args:
        group: of entry points, where installed packages add theirs.
        own: the package's.
    """
    added = {point.name: point.value for point in entry_points(group=group)}
    return added | dict(own)


def imported(place: str, *, wanted: str) -> Any:
    """What lies at "module:attribute".

    Args:
        place: where.
        wanted: for whom and what, for the message.

    Raises:
        UsageError: nothing to import there.
    """
    module, _, attribute = place.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise UsageError(f"{wanted} that can be imported; {error}") from error

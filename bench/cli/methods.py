"""`methods`: what can be scored."""

from __future__ import annotations

from rich.table import Table

from bench.cli.console import show
from bench.errors import UsageError


def methods() -> None:
    """List the methods that can be scored."""
    from bench.harness import scorable_methods
    from bench.methods import describe_method

    table = Table("name", "what it is", box=None)
    for name, place in scorable_methods().items():
        try:
            about = describe_method(place)
        except UsageError as error:  # of another package; the list of the others is still wanted
            about = str(error)
        table.add_row(name, about if place.startswith("bench.") else f"{about} ({place})")
    show(table)

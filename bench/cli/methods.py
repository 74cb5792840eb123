"""`methods`: what can be scored."""

from __future__ import annotations

from bench.cli.console import show
from bench.errors import UsageError


def methods() -> None:
    """List the methods that can be scored."""
    from bench.harness import scorable_methods
    from bench.methods import describe_method
    from bench.reporting.document import Table

    rows = []
    for name, place in scorable_methods().items():
        try:
            about = describe_method(place)
        except UsageError as error:  # of another package; the list of the others is still wanted
            about = str(error)
        rows.append([name, about if place.startswith("bench.") else f"{about} ({place})"])
    show([Table(columns=["name", "what it is"], rows=rows, words=2)])

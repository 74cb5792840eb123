"""What there is."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from bench.cli.console import show
from bench.errors import UsageError
from bench.harness import scorable_methods
from bench.methods import describe_method
from bench.recordings import list_cards


def datasets(folder: Path) -> None:
    """Print the cards of a folder."""
    table = Table("name", "adapter", "licence", "what it is", box=None, title_justify="left")
    for card in list_cards(folder):
        table.add_row(card.name, card.content.adapter, card.content.licence, card.content.title)
    show(table)


def methods() -> None:
    """Print the methods, what each is, and where those come from that are not the package's own."""
    table = Table("name", "what it is", box=None)
    for name, place in scorable_methods().items():
        try:
            about = describe_method(place)
        except UsageError as error:  # of another package; the list of the others is still wanted
            about = str(error)
        table.add_row(name, about if place.startswith("bench.") else f"{about} ({place})")
    show(table)

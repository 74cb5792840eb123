"""What there is."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from bench.cli.console import console
from bench.methods import known_methods
from bench.recordings import list_cards


def datasets(folder: Path) -> None:
    """Print the cards of a folder."""
    table = Table("name", "adapter", "licence", "what it is", box=None, title_justify="left")
    for card in list_cards(folder):
        table.add_row(card.name, card.content.adapter, card.content.licence, card.content.title)
    console().print(table)


def methods() -> None:
    """Print the methods and where they come from."""
    table = Table("name", "class", box=None)
    for name, place in sorted(known_methods().items()):
        table.add_row(name, place)
    console().print(table)

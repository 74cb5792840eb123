"""`datasets`: the data sets that a command finds by name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from bench.cli.console import note, show


def datasets(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of cards; default: all folders where names are looked up.")
    ] = None,
) -> None:
    """List the data sets that a command finds by name, or the cards of a folder."""
    from bench.recordings import list_cards
    from bench.recordings.cards import OWN_DATA, card_folders, data_folder

    table = Table("name", "adapter", "licence", "what it is", box=None, title_justify="left")
    named: set[str] = set()  # a name hides the same one in a later folder
    folders = {place: list_cards(place) for place in (card_folders() if folder is None else (folder,))}
    for card in (card for cards in folders.values() for card in cards if card.file.stem not in named):
        named.add(card.file.stem)
        table.add_row(card.file.stem, card.content.adapter, card.content.licence, card.content.title)
    show(table)
    for place, cards in folders.items():
        note(f"{place}: {len(cards)} cards")
    if folder is None and (data := data_folder()) is not None:
        note(f"{data}: what the cards of the package render ({OWN_DATA} names another folder)")

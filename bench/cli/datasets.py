"""`datasets`: the data sets that a command finds by name."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.console import note, show


def datasets(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of cards; default: all folders where names are looked up.")
    ] = None,
) -> None:
    """List the data sets that a command finds by name, or the cards of a folder."""
    from bench.recordings import list_cards
    from bench.recordings.cards import OWN_DATA, card_folders, data_folder
    from bench.reporting.document import Table

    rows = []
    named: set[str] = set()  # a name hides the same one in a later folder
    folders = {place: list_cards(place) for place in (card_folders() if folder is None else (folder,))}
    for card in (card for cards in folders.values() for card in cards if card.file.stem not in named):
        named.add(card.file.stem)
        rows.append([card.file.stem, card.content.adapter, card.content.licence, card.content.title])
    show([Table(columns=["name", "adapter", "licence", "what it is"], rows=rows, words=4)])
    for place, cards in folders.items():
        note(f"{place}: {len(cards)} cards")
    if folder is None and (data := data_folder()) is not None:
        note(f"{data}: what the cards of the package render ({OWN_DATA} names another folder)")

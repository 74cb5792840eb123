"""Lists: data sets, methods, and what the cache holds."""

from __future__ import annotations

from pathlib import Path

from bench.cli.console import note, say, show
from bench.errors import DataError, UsageError
from bench.harness import scorable_methods
from bench.harness.cache import CacheFolder, default_folder
from bench.methods import describe_method
from bench.recordings import list_cards
from bench.recordings.cards import OWN_DATA, card_folders, data_folder
from bench.reporting.document import Table


def datasets(folder: Path | None) -> None:
    """Print the cards of a folder, or of all folders where names are looked up; a name hides the same one behind it."""
    rows = []
    named: set[str] = set()
    folders = {place: list_cards(place) for place in (card_folders() if folder is None else (folder,))}
    for card in (card for cards in folders.values() for card in cards if card.file.stem not in named):
        named.add(card.file.stem)
        rows.append([card.file.stem, card.content.adapter, card.content.licence, card.content.title])
    show([Table(columns=["name", "adapter", "licence", "what it is"], rows=rows, words=4)])
    for place, cards in folders.items():
        note(f"{place}: {len(cards)} cards")
    if folder is None and (data := data_folder()) is not None:
        note(f"{data}: what the cards of the package render ({OWN_DATA} names another folder)")


def methods() -> None:
    """Print the methods, what each is, and where those come from that are not the package's own."""
    rows = []
    for name, place in scorable_methods().items():
        try:
            about = describe_method(place)
        except UsageError as error:  # of another package; the list of the others is still wanted
            about = str(error)
        rows.append([name, about if place.startswith("bench.") else f"{about} ({place})"])
    show([Table(columns=["name", "what it is"], rows=rows, words=2)])


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

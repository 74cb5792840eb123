"""Digests of files by their content."""

from __future__ import annotations

import hashlib
from pathlib import Path

from bench.errors import DataError
from bench.recordings.records import StoredPart

MISSING = "missing"


class FileDigests:
    """SHA-256 of files' contents, each read once for as long as this object lives, which is one unit of work.

    Neither size nor time of change stands for the content: clocks go back, and files are replaced by others as long.
    """

    def __init__(self) -> None:
        self._known: dict[Path, str] = {}

    def of(self, path: Path, stored: StoredPart | None = None) -> str:
        """The digest, hexadecimal; `MISSING` or the reason where the file cannot be read.

        Args:
            path: of the file, or the name of a part of one.
            stored: the part that goes by that name, whose content then counts.
        """
        if path not in self._known:
            self._known[path] = _digest(path) if stored is None else _part_digest(stored)
        return self._known[path]


def _part_digest(stored: StoredPart) -> str:
    try:
        return hashlib.sha256(stored.content()).hexdigest()
    except DataError as error:
        return f"unreadable: {error}"


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return MISSING
    except OSError as error:
        return f"unreadable: {error.strerror}"

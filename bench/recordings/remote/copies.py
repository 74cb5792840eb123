"""Which local copies are open, which go when room is needed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from bench.errors import DataError
from bench.recordings.atomic import alone_in

REMOVED = ".removed-"

_open: dict[Path, ExitStack] = {}  # by this process, the one opened last at the end


def open_here(copy: Path) -> None:
    """Keep a copy from being removed by anybody, until this process ends or needs the room itself."""
    copy = copy.resolve()
    held = _open.pop(copy, None)
    if held is None:
        held = ExitStack()
        held.enter_context(alone_in(copy, shared=True))
    _open[copy] = held


def let_go(copy: Path) -> None:
    """Have a copy open no longer."""
    held = _open.pop(copy.resolve(), None)
    if held is not None:
        held.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class CopiesUse:
    """What the copies take.

    Attributes:
        copies: their number, those among them that are not whole.
        size_bytes: of all.
    """

    copies: int
    size_bytes: int


@dataclass(frozen=True, slots=True)
class Copies:
    """All copies in a folder; see `bench.recordings.remote.fetching` for how they lie.

    Attributes:
        folder: of them.
    """

    folder: Path

    def use(self) -> CopiesUse:
        """What they take."""
        sizes = [_size_bytes(copy) for copy in self._all()]
        return CopiesUse(copies=len(sizes), size_bytes=sum(sizes))

    def make_room(self, limit_bytes: int) -> CopiesUse:
        """Remove those used longest ago until the rest is no larger than a limit.

        Copies that other processes have open stay. Those of this process go last, but for the one opened last.
        """
        sizes = {copy.resolve(): _size_bytes(copy) for copy in self._all()}
        total, own = sum(sizes.values()), list(_open)
        others = sorted((copy for copy in sizes if copy not in _open), key=_last_used)
        for copy in (*others, *(copy for copy in own[:-1] if copy in sizes)):
            if total <= limit_bytes:
                break
            if _removed(copy):
                total -= sizes.pop(copy)
        return CopiesUse(copies=len(sizes), size_bytes=total)

    def drop_others(self, place: Path, *, but: Path) -> None:
        """Remove copies of the same thing that nobody has open; the caller holds `place`."""
        for copy in _copies_in(place):
            if copy != but and copy.resolve() not in _open:
                _taken_away(copy)

    def _all(self) -> list[Path]:
        return [copy for place in self.folder.glob("[!.]*") if place.is_dir() for copy in _copies_in(place)]


def _copies_in(place: Path) -> Iterator[Path]:
    return (path for path in sorted(place.iterdir()) if path.is_dir() and not path.name.startswith("."))


def _removed(copy: Path) -> bool:
    """Remove a copy unless somebody fetches or has it open."""
    let_go(copy)
    try:
        with alone_in(copy.parent, wait=False):
            return _taken_away(copy)
    except (DataError, FileNotFoundError):
        return False


def _taken_away(copy: Path) -> bool:
    gone = copy.with_name(f"{REMOVED}{uuid4().hex}")
    try:
        with alone_in(copy, wait=False):
            copy.with_suffix(".json").unlink(missing_ok=True)
            copy.rename(gone)
    except (DataError, FileNotFoundError):
        return False
    shutil.rmtree(gone, ignore_errors=True)
    return True


def _size_bytes(copy: Path) -> int:
    try:
        return int(json.loads(copy.with_suffix(".json").read_text())["size_bytes"])
    except (OSError, ValueError, KeyError, TypeError):
        return sum(file.stat().st_size for file in copy.rglob("*") if file.is_file())


def _last_used(copy: Path) -> int:
    try:
        return copy.stat().st_mtime_ns
    except OSError:
        return 0

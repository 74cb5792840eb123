"""A stamp in a folder of recordings: what was read and made when everything was last there.

It lets a second call see in a moment that there is nothing to do, without drawing the scenario. Whatever does not fit,
be it a byte of the scenario, of the generator or of a recording's mark, sends the call the long way. A stamp needs no
removal when recordings change: their marks do then, and it fits no more.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path

from bench.recordings import write_text

STAMP = ".synthesis.json"
MARK = "synthesis.json"  # in the folder of each recording: what it was made from


def write_stamp(out: Path, *, scenario: bytes, version: int, names: Iterable[str]) -> None:
    """Say that every recording of a scenario is there; a folder that cannot be written to goes without.

    Args:
        out: folder of the recordings.
        scenario: the scenario's file as it was read.
        version: of the generator.
        names: of the recordings, in the scenario's order.
    """
    with suppress(OSError):
        marks = {name: _mark_text(out / name) for name in names}
        content = {"made_from": _made_from(scenario, version), "marks": marks}
        write_text(out / STAMP, json.dumps(content, indent=1) + "\n")


def stamped(out: Path, *, scenario: bytes, version: int) -> list[Path] | None:
    """Folders of the recordings if everything is there and nothing else is; None if that takes a closer look.

    Args:
        out: folder of the recordings.
        scenario: the scenario's file.
        version: of the generator.
    """
    try:
        content = json.loads((out / STAMP).read_text(encoding="utf-8"))
        if content["made_from"] != _made_from(scenario, version):
            return None
        marks: dict[str, str] = content["marks"]
        folders = {path.name for path in out.iterdir() if path.is_dir()}
        whole = folders == marks.keys() and all(mark == _mark_text(out / name) for name, mark in marks.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return [out / name for name in marks] if whole else None


def _mark_text(folder: Path) -> str:
    return (folder / MARK).read_text(encoding="utf-8")


def _made_from(scenario: bytes, version: int) -> str:
    """Digest of everything that decides what the recordings are."""
    digest = hashlib.sha256(f"{version} {_source_digest()} ".encode())
    digest.update(scenario)
    return digest.hexdigest()


@cache
def _source_digest() -> str:
    """Digest of this room's own source: a change to how a series is drawn also sends the call the long way."""
    room = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(room.rglob("*.py")):
        digest.update(f"{path.relative_to(room).as_posix()} ".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()

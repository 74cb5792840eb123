"""Label files on disk: what a person made or changed is replaced only on request, and then a copy of it stays.

Beside the files lies a record of their digests as they were written. A file that is there in another state, or without
a record, is somebody's work.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from os.path import lexists
from pathlib import Path

from bench.atomic import write_bytes, write_text
from bench.errors import OutputError

RECORD = ".written-labels"  # name -> SHA-256 of what was written


def store_labels(folder: Path, files: Mapping[str, bytes], *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write label files, all or none.

    Args:
        folder: of the files; made where it is not there.
        files: name -> content.
        overwrite: replace also what a person made or changed, and keep a copy of it, `<name>.1` and on.

    Returns:
        The copies.

    Raises:
        OutputError: a file that a person made or changed is in the way, or one that cannot be written.
    """
    record = _record(folder)
    foreign = [name for name, content in files.items() if _is_foreign(folder / name, content, record.get(name))]
    if foreign and not overwrite:
        got = "labels that a person made or changed"
        hint = "give another folder; or --overwrite, which keeps a copy of them"
        raise OutputError(folder / foreign[0], got=got, hint=hint)
    copies = []
    for name in foreign:
        copy = next(path for i in count(1) if not lexists(path := folder / f"{name}.{i}"))
        write_bytes(copy, (folder / name).read_bytes())
        copies.append(copy)
    for name, content in files.items():
        write_bytes(folder / name, content)
    written = record | {name: _digest(content) for name, content in files.items()}
    write_text(folder / RECORD, json.dumps(written, indent=1, sort_keys=True) + "\n")
    return tuple(copies)


def _is_foreign(file: Path, content: bytes, written: str | None) -> bool:
    if not file.is_file():  # a folder is refused when it is written
        return False
    return _digest(file.read_bytes()) not in {written, _digest(content)}


def _record(folder: Path) -> dict[str, str]:
    with suppress(OSError, ValueError):  # without a readable record everything is somebody's work
        record = json.loads((folder / RECORD).read_bytes())
        return record if isinstance(record, dict) else {}
    return {}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()

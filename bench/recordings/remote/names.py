"""Names of objects that become files below a local folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePosixPath, PureWindowsPath

from bench.errors import DataError
from bench.recordings.remote.urls import RemoteUrl

LONGEST_PART_BYTES = 255  # of file systems


def refuse_unsafe(url: RemoteUrl, names: Iterable[str]) -> None:
    """Refuse names that are no files below the folder, each of them another one.

    Args:
        url: of the folder, for the message.
        names: relative to it.

    Raises:
        DataError: an absolute name, "..", an empty part, or a name that is both a file and a folder.
    """
    known = set(names)
    for name in known:
        if not _plain(name):
            raise DataError(url.text, expected="names of objects that can be files below a folder", got=repr(name))
    for name in known:
        for parent in PurePosixPath(name).parents:
            if str(parent) in known:
                raise DataError(url.text, expected="a file or a folder of a name", got=f"both of {str(parent)!r}")


def _plain(name: str) -> bool:
    parts = name.split("/")
    return (
        name.isprintable()
        and "\\" not in name
        and not PureWindowsPath(name).drive
        and not any(part in ("", ".", "..") or len(part.encode()) > LONGEST_PART_BYTES for part in parts)
    )

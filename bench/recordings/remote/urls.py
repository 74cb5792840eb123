"""Addresses of folders on object storage, the names of objects in them, and where local copies lie."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

from bench.errors import DataError, UsageError

LOCAL = ("file", "local")
PATTERN = re.compile(r"([a-z][a-z0-9+.-]+)://(.*)", re.IGNORECASE | re.DOTALL)
FORBIDDEN = frozenset("?*[]{}#\\")  # a query, or a pattern to fsspec
LONGEST_PART_BYTES = 255  # of a name on a file system


@dataclass(frozen=True, slots=True)
class RemoteUrl:
    """A folder on object storage.

    Attributes:
        text: the address, without credentials and without a slash at its end.
    """

    text: str

    @property
    def protocol(self) -> str:
        """What stands before `://`."""
        return self.text.partition("://")[0].lower()

    @property
    def name(self) -> str:
        """The last part of the path, which is the bucket where there is no other."""
        return self.text.rpartition("/")[2]

    def __str__(self) -> str:
        return self.text


def parse_location(text: str) -> Path | RemoteUrl:
    """A folder by path or address; `file://` addresses are paths.

    Raises:
        UsageError: an address that carries credentials or a query, or whose path is not plain. The message does not
            repeat what may be secret.
    """
    found, shown = PATTERN.fullmatch(text), without_secrets(text).partition("?")[0]
    if found is None:
        if "://" in text:
            raise UsageError(f"expected a path or PROTOCOL://FOLDER, got {shown!r}")
        return Path(text)
    protocol, rest = found[1].lower(), found[2].rstrip("/")
    if protocol in LOCAL:
        if not rest.startswith("/"):
            raise UsageError(f"expected {protocol}:///absolute/path, got {text!r}")
        return Path(rest)
    if ":" in rest.partition("/")[0].rpartition("@")[0]:
        do = "put it into the configuration of fsspec"
        raise UsageError(f"expected an address without a password, got {shown!r} with one; {do}")
    parts = rest.split("/")
    if not FORBIDDEN.isdisjoint(rest) or not rest.isprintable() or any(part in ("", ".", "..") for part in parts):
        raise UsageError(f"expected an address of plain names, without a query or pattern, got {shown!r}")
    return RemoteUrl(f"{protocol}://{rest}")


def without_secrets(text: str) -> str:
    """A text with the credentials and queries of all addresses in it left out."""
    return re.sub(r"(\w://[^\s'\"?]*)\?[^\s'\"]*", r"\1", re.sub(r"(\w://)[^/\s'\"]*@", r"\1", text))


def refuse_unsafe(url: RemoteUrl, names: Iterable[str]) -> None:
    """Refuse names that are not different files below a folder.

    Args:
        url: of the folder, for the message.
        names: relative to it.

    Raises:
        DataError: an absolute name, "..", an empty part, or a name that is both a file and a folder.
    """
    counted = Counter(iter(names))
    for name in counted:
        if not _plain(name):
            raise DataError(url.text, expected="names of objects that can be files below a folder", got=repr(name))
    counted += Counter({str(parent) for name in counted for parent in PurePosixPath(name).parents})
    for name, count in counted.items():
        if count > 1:
            raise DataError(url.text, expected="a file or a folder of a name", got=f"both of {name!r}")


def _plain(name: str) -> bool:
    parts = name.split("/")
    return (
        name.isprintable()
        and "\\" not in name
        and not PureWindowsPath(name).drive
        and not any(part in ("", ".", "..") or len(part.encode()) > LONGEST_PART_BYTES for part in parts)
    )


def local_folder(url: RemoteUrl, purpose: str, names: Sequence[str] = ()) -> Path:
    """Where the local copy of a remote folder lies: below `FISHEYE_BENCH_REMOTE`, else below `reports/remote`.

    Args:
        url: of the remote folder.
        purpose: copies for different purposes do not share files.
        names: what of the folder is copied.

    Returns:
        A folder with the name of the remote one, in a parent of its own.
    """
    tag = hashlib.sha256(json.dumps([url.text, *names]).encode()).hexdigest()[:16]
    remote = Path(os.environ.get("FISHEYE_BENCH_REMOTE") or "reports/remote").expanduser()
    return remote / purpose / tag / url.name

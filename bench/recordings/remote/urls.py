"""Addresses of folders on object storage."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from bench.errors import UsageError

LOCAL = ("file", "local")
PATTERN = re.compile(r"([a-z][a-z0-9+.-]+)://(.*)", re.IGNORECASE | re.DOTALL)
FORBIDDEN = frozenset("?*[]{}#\\")  # a query, or a pattern to fsspec


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


def parse_place(text: str) -> Path | RemoteUrl:
    """A folder by path or address; `file://` addresses are paths.

    Raises:
        UsageError: an address that carries credentials or a query, or whose path is not plain. The message does not
            repeat what may be secret.
    """
    found = PATTERN.fullmatch(text)
    if found is None:
        if "://" in text:
            raise UsageError(f"expected a path or PROTOCOL://FOLDER, got {_unsecret(text)!r}")
        return Path(text)
    protocol, rest = found[1].lower(), found[2].rstrip("/")
    if protocol in LOCAL:
        if not rest.startswith("/"):
            raise UsageError(f"expected {protocol}:///absolute/path, got {text!r}")
        return Path(rest)
    told = _unsecret(text)
    if ":" in rest.partition("/")[0].rpartition("@")[0]:
        raise UsageError(
            f"expected an address without a password, got {told!r} with one; put it into the configuration of fsspec"
        )
    parts = rest.split("/")
    if not FORBIDDEN.isdisjoint(rest) or not rest.isprintable() or any(part in ("", ".", "..") for part in parts):
        raise UsageError(f"expected an address of plain names, without a query or pattern, got {told!r}")
    return RemoteUrl(f"{protocol}://{rest}")


def remote_folder() -> Path:
    """Where copies of remote data and runs lie on this machine: `FISHEYE_BENCH_REMOTE`, else beside the runs."""
    return Path(os.environ.get("FISHEYE_BENCH_REMOTE") or "reports/remote").expanduser()


def without_secrets(text: str) -> str:
    """A text with the credentials and queries of all addresses in it left out."""
    return re.sub(r"(\w://[^\s'\"?]*)\?[^\s'\"]*", r"\1", re.sub(r"(\w://)[^/\s'\"]*@", r"\1", text))


def _unsecret(text: str) -> str:
    return without_secrets(text).partition("?")[0]

"""One folder on object storage: list, download, upload, remove. The only file that speaks to fsspec."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from bench.errors import BenchError, DataError
from bench.recordings.remote.urls import RemoteUrl, without_secrets

CHECKSUMS = ("ETag", "etag", "checksum", "md5Hash", "content_md5", "crc32c", "generation")
TIMES = ("LastModified", "last_modified", "mtime", "modified", "updated", "created")
AT_ONCE = 32  # transfers side by side

# An endpoint that is not there is told within half a minute; the user's own configuration of fsspec goes before.
S3_CONFIGURATION = {
    "connect_timeout": 4,
    "read_timeout": 20,
    "retries": {"mode": "standard", "total_max_attempts": 4},
}
S3_ATTEMPTS = 2  # of s3fs, each with those of the layer below


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredObject:
    """What the storage tells of an object.

    Attributes:
        size_bytes: of the content.
        version: changes with the content: a checksum, or the time of change where the storage has none.
    """

    size_bytes: int
    version: str


class Storage:
    """A remote folder.

    Args:
        url: its address.
    """

    def __init__(self, url: RemoteUrl) -> None:
        self.url = url

    def objects(self, below: str = "") -> dict[str, StoredObject]:
        """All objects below the folder by relative name; none where nothing is there.

        Args:
            below: only of this folder or object in it.

        Raises:
            DataError: the storage cannot be reached or refuses.
        """
        fs, root = self._connected
        with self._explained("a folder that can be listed"):
            fs.invalidate_cache()
            try:
                found = fs.find(self._path(below), detail=True)
            except FileNotFoundError:
                return {}
        return {
            self._name(path, root): StoredObject(size_bytes=int(entry["size"] or 0), version=_version(entry))
            for path, entry in found.items()
            if entry.get("type") != "directory" and not path.endswith("/")
        }

    def entries(self, below: str = "") -> dict[str, bool]:
        """Names in the folder, or in one in it, each with whether it is a folder.

        Raises:
            DataError: there is no such folder, or the storage cannot be reached or refuses.
        """
        fs, _ = self._connected
        with self._explained("a folder with data"):
            fs.invalidate_cache()
            found = fs.ls(self._path(below), detail=True)
        names = {
            entry["name"].rstrip("/").rpartition("/")[2]: entry["type"] == "directory"
            for entry in found
            if entry["name"].rstrip("/") != self._path(below).rstrip("/")
        }
        return dict(sorted(names.items()))

    def download(self, files: Mapping[str, Path]) -> None:
        """Fetch objects into files whose folders exist.

        Args:
            files: by name.

        Raises:
            DataError: an object is missing, or the storage cannot be reached or refuses, or the disk is full.
        """
        fs, _ = self._connected
        with self._explained("objects that can be read"):
            paths, places = [self._path(name) for name in files], [str(file) for file in files.values()]
            if paths:
                fs.get(paths, places, **self._side_by_side)

    def upload(self, files: Mapping[str, Path]) -> None:
        """Store files as objects, in any order.

        Args:
            files: by the names that they get.

        Raises:
            DataError: the bucket is missing, or the storage cannot be reached or refuses.
        """
        fs, _ = self._connected
        with self._explained("a folder that can be written"):
            paths, places = [self._path(name) for name in files], [str(file) for file in files.values()]
            if paths:
                fs.put(places, paths, **self._side_by_side)

    def remove(self, names: Iterable[str]) -> None:
        """Remove objects; those that are not there are passed over.

        Raises:
            DataError: the storage cannot be reached or refuses.
        """
        fs, _ = self._connected
        paths = [self._path(name) for name in names]
        with self._explained("objects that can be removed"):
            if paths:
                _remove(fs, paths)

    @cached_property
    def _connected(self) -> tuple[Any, str]:
        with self._explained("a protocol that fsspec speaks"):
            return _connected(self.url, os.getpid(), tuple(sorted(os.environ.items())))

    @property
    def _side_by_side(self) -> dict[str, int]:
        return {"batch_size": AT_ONCE} if getattr(self._connected[0], "async_impl", False) else {}

    def _path(self, name: str) -> str:
        root = self._connected[1]
        return f"{root}/{name}" if name else root

    def _name(self, path: str, root: str) -> str:
        if not path.startswith(f"{root}/"):
            raise DataError(self.url.text, expected="names below the folder", got=repr(path))
        return path[len(root) + 1 :]

    @contextmanager
    def _explained(self, expected: str) -> Iterator[None]:
        """Tell what the storage's library raises, whose exceptions have no common class, in the user's words."""
        try:
            yield
        except BenchError:
            raise
        except ImportError as error:
            raise self._without_library(error) from error
        except Exception as error:
            got, do = _told(error)
            raise DataError(self.url.text, expected=expected, got=got, do=do) from error

    def _without_library(self, error: ImportError) -> DataError:
        do = "pip install 'fisheye-bench[remote]', or the library of fsspec for that protocol"
        return DataError(self.url.text, expected="an installed library for it", got=str(error), do=do)


@lru_cache(maxsize=4)
def _connected(url: RemoteUrl, _process: int, _environment: tuple[tuple[str, str], ...]) -> tuple[Any, str]:
    """The file system of an address and the folder in it.

    It is kept, since a connection takes longer than a listing, but not for another process, where it would not work, or
    another environment, which may lead elsewhere.
    """
    import fsspec
    from fsspec.core import url_to_fs

    options: dict[str, Any] = {"skip_instance_cache": True}
    if url.protocol in ("s3", "s3a"):
        own = fsspec.config.conf.get(url.protocol, {}).get("config_kwargs", {})
        options["config_kwargs"] = S3_CONFIGURATION | own
    fs, root = url_to_fs(url.text, **options)
    if "config_kwargs" in options:
        fs.retries = S3_ATTEMPTS
    return fs, root.rstrip("/")


def _remove(fs: Any, paths: Sequence[str]) -> None:
    try:
        fs.rm(list(paths))
    except FileNotFoundError:  # one of them; the others are still to go
        for path in paths:
            try:
                fs.rm(path)
            except FileNotFoundError:
                continue


def _version(entry: Mapping[str, Any]) -> str:
    for kind in (CHECKSUMS, TIMES):
        told = [f"{key}={entry[key]}" for key in kind if entry.get(key) is not None]
        if told:
            return " ".join(told)
    return ""


def _told(error: BaseException) -> tuple[str, str]:
    """What came, and what to do about it."""
    reason = without_secrets(" ".join(str(error).split())) or "no reason told"
    told, kinds = f"{type(error).__name__}: {reason}", {kind.__name__ for kind in type(error).__mro__}
    number = getattr(error, "errno", None)
    if number in (errno.ENOSPC, errno.EDQUOT):
        return told, "make room, or name another folder with FISHEYE_BENCH_REMOTE"
    if kinds & {"NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError"}:
        return told, "set credentials, in the environment or in the configuration of fsspec"
    if isinstance(error, PermissionError):
        return told, "use credentials that may do this"
    if isinstance(error, FileNotFoundError):
        return told, "check bucket and folder; buckets are not made"
    if kinds & {"ConnectionError", "TimeoutError", "HTTPClientError"}:
        return told, "check endpoint (for S3: AWS_ENDPOINT_URL) and network"
    if kinds & {"BotoCoreError"}:
        return told, "check region, endpoint and credentials"
    return told, ""

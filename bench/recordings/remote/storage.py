"""One folder on object storage, and the local copy of it that follows what the storage lists."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench.errors import BenchError, DataError, OutputError
from bench.recordings.atomic import alone_in, make_folder, write_text
from bench.recordings.object_storage import RemoteUrl, refuse_unsafe, without_secrets

# What storages list of an object that changes with its content: checksums and times.
VERSION_KEYS = ("ETag", "etag", "checksum", "LastModified", "last_modified", "mtime", "modified", "updated", "created")

# A missing endpoint is reported within half a minute; the user's own configuration of fsspec takes precedence.
S3_CONFIGURATION = {"connect_timeout": 4, "read_timeout": 20, "retries": {"mode": "standard", "total_max_attempts": 4}}
S3_ATTEMPTS = 2  # of s3fs, each with those of the layer below
S3_TRANSFERS = 32  # at the same time; s3fs holds a large file's chunks in memory

BATCH_FILES = 512  # downloaded files between two writes of the index
INDEX, LANDING = "index.json", ".landing-"

NOT_UPLOADED = "not uploaded"  # as a version
Index = dict[str, list[str | int]]  # by name: version, local size and modification time


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredObject:
    """What the storage lists of an object.

    Attributes:
        size_bytes: of the content; None where the storage does not list it.
        version: changes with the content: checksums and times; empty where the storage lists neither.
    """

    size_bytes: int | None
    version: str


class Storage:
    """A remote folder.

    Args:
        url: its address.
    """

    def __init__(self, url: RemoteUrl) -> None:
        self.url = url

    def objects(self, *below: str, missing_ok: bool = False) -> dict[str, StoredObject]:
        """All objects below the folder.

        Args:
            below: only these objects of it, and those of these folders in it.
            missing_ok: return nothing where nothing is there.

        Returns:
            By name relative to the folder of this address, sorted; all names can be files below a local folder.

        Raises:
            DataError: nothing is there, a name cannot be a file's, or the storage cannot be reached or refuses.
        """
        fs, root = self._connected
        listed: dict[str, Any] = {}
        with self._explained("a folder that can be listed"):
            fs.invalidate_cache()
            for part in below or ("",):
                with suppress(FileNotFoundError):
                    listed |= fs.find(self._path(part), detail=True)
        found = {}
        for path, entry in listed.items():
            if entry["type"] != "directory" and not path.endswith("/"):
                version = " ".join(f"{key}={entry[key]}" for key in VERSION_KEYS if entry.get(key) is not None)
                found[path.removeprefix(f"{root}/")] = StoredObject(size_bytes=entry["size"], version=version)
        if not found and not missing_ok:
            do = "check bucket, folder and credentials"
            raise DataError(self.url.text, expected="a folder with data", got="nothing there", do=do)
        refuse_unsafe(self.url, found)
        return dict(sorted(found.items()))

    def entries(self, below: str = "") -> list[str]:
        """Names of the files and folders directly in the folder, or in one in it.

        Returns:
            Relative to the folder of this address, sorted; those of folders end with a slash.

        Raises:
            DataError: there is no such folder, a name cannot be a file's, or the storage cannot be reached or refuses.
        """
        fs, root = self._connected
        with self._explained("a folder with data"):
            fs.invalidate_cache()
            listed = fs.ls(self._path(below.rstrip("/")), detail=True)
        folders = {entry["name"].rstrip("/").removeprefix(f"{root}/"): entry["type"] == "directory" for entry in listed}
        names = {name: is_folder for name, is_folder in folders.items() if name not in (root, below.rstrip("/"))}
        refuse_unsafe(self.url, names)
        return sorted(f"{name}/" if is_folder else name for name, is_folder in names.items())

    def download(self, files: Mapping[str, Path]) -> None:
        """Download objects.

        Args:
            files: where to, by name.

        Raises:
            DataError: an object is missing, the storage cannot be reached or refuses, or the disk is full.
        """
        with self._explained("objects that can be read"):
            self._connected[0].get([self._path(name) for name in files], [str(file) for file in files.values()])

    def upload(self, files: Mapping[str, Path]) -> None:
        """Store files as objects, in any order.

        Args:
            files: by the names that they get.

        Raises:
            DataError: the bucket is missing, or the storage cannot be reached or refuses.
        """
        with self._explained("a folder that can be written"):
            self._connected[0].put([str(file) for file in files.values()], [self._path(name) for name in files])

    def remove(self, names: Iterable[str]) -> None:
        """Remove objects that may be there.

        Raises:
            DataError: the storage cannot be reached or refuses.
        """
        with self._explained("objects that can be removed"):
            for name in names:
                with suppress(FileNotFoundError):
                    self._connected[0].rm_file(self._path(name))

    @cached_property
    def _connected(self) -> tuple[Any, str]:
        """The file system of the address, which fsspec shares within a process, and the folder in it."""
        with self._explained("a protocol that fsspec speaks"):
            import fsspec

            options = {}
            if self.url.protocol in ("s3", "s3a"):
                own = fsspec.config.conf.get(self.url.protocol, {}).get("config_kwargs", {})
                options = {"config_kwargs": S3_CONFIGURATION | own}
            fs, root = fsspec.url_to_fs(self.url.text, **options)
            if options:
                fs.retries, fs.batch_size = S3_ATTEMPTS, S3_TRANSFERS
            return fs, root.rstrip("/")

    def _path(self, name: str) -> str:
        return f"{self._connected[1]}/{name}".rstrip("/")

    @contextmanager
    def _explained(self, expected: str) -> Iterator[None]:
        """Report what the storage's library raises, whose exceptions have no common class, in the user's words."""
        try:
            yield
        except BenchError:
            raise
        except Exception as error:
            reason = without_secrets(" ".join(str(error).split())) or "no reason given"
            got = f"{type(error).__name__}: {reason}"
            raise DataError(self.url.text, expected=expected, got=got, do=_remedy(error)) from error


class LocalCopy:
    """Files of a remote folder on this machine.

    Beside the folder, `index.json` holds for each file the version that the storage listed when it was downloaded or
    uploaded (empty if unknown), and the local size and modification time. A file for which all of it is still true is
    not transferred again.

    Args:
        storage: the remote folder.
        folder: of the files; in a parent of its own.
    """

    def __init__(self, storage: Storage, folder: Path) -> None:
        self.storage, self.folder, self._index_file = storage, folder, folder.parent / INDEX
        self._index: Index = {}

    def download(self, listed: Mapping[str, StoredObject], *, others: tuple[str, ...] = ()) -> int:
        """Make local files what the storage lists.

        Args:
            listed: the objects that are wanted; their names are checked.
            others: how names of other local files begin that stay; all others are removed.

        Returns:
            How many objects were downloaded.

        Raises:
            DataError: the storage cannot be reached or refuses, an object is shorter than listed, or the local folder
                cannot be written.
        """
        with self._local_faults():
            make_folder(self.folder)
            with alone_in(self.folder.parent):
                self._index = self._stored_index() | self._index
                self._remove_others(listed, others)
                missing = [name for name, stored in listed.items() if self._lacks(name, stored.version)]
                for start in range(0, len(missing), BATCH_FILES):
                    self._download({name: listed[name] for name in missing[start : start + BATCH_FILES]})
                return len(missing)

    def upload(self, names: Iterable[str], *, again: bool = False) -> None:
        """Store local files that differ from what was downloaded or uploaded before.

        Args:
            names: of the files.
            again: also those that do not differ.

        Raises:
            DataError: the storage cannot be reached or refuses.
        """
        states = {name: self._state(name) for name in (names if again else self.changed(names))}
        self.storage.upload({name: self.folder / name for name in states})
        self._index |= {name: ["", *state] for name, state in states.items()}

    def changed(self, names: Iterable[str]) -> list[str]:
        """Those of some local files that differ from what was downloaded or uploaded before."""
        return [name for name in names if self._index.get(name, [""])[1:] != self._state(name)]

    def skip_upload(self, names: Iterable[str]) -> None:
        """Do not upload local files until they change."""
        self._index |= {name: [NOT_UPLOADED, *self._state(name)] for name in self.changed(names)}

    def write_index(self, listed: Mapping[str, StoredObject]) -> None:
        """Store what is known of the files, for later processes.

        Args:
            listed: by the storage, after uploads.
        """
        for name, entry in self._index.items():
            if name in listed and not entry[0]:
                entry[0] = listed[name].version
        with self._local_faults():
            write_text(self._index_file, json.dumps(self._index))

    def _stored_index(self) -> Index:
        with suppress(OSError, ValueError, AttributeError):  # missing or damaged: everything is downloaded again
            stored = json.loads(self._index_file.read_bytes()).items()
            return {name: entry for name, entry in stored if isinstance(entry, list) and len(entry) == 3}
        return {}

    def _remove_others(self, listed: Mapping[str, StoredObject], others: tuple[str, ...]) -> None:
        for left in self.folder.parent.glob(f"{LANDING}*"):  # of a process that was killed
            shutil.rmtree(left, ignore_errors=True)
        for path in sorted(self.folder.rglob("*"), reverse=True):
            is_folder, name = path.is_dir() and not path.is_symlink(), path.relative_to(self.folder).as_posix()
            if is_folder and not f"{name}/".startswith(others):
                with suppress(OSError):  # something is in it
                    path.rmdir()
            elif not is_folder and name not in listed and not name.startswith(others):
                path.unlink()

    def _download(self, wanted: Mapping[str, StoredObject]) -> None:
        with TemporaryDirectory(dir=self.folder.parent, prefix=LANDING) as landing:
            landed = {name: Path(landing) / str(number) for number, name in enumerate(wanted)}
            self.storage.download(landed)
            for name, file in landed.items():
                expected, size = wanted[name].size_bytes, file.stat().st_size if file.is_file() else 0
                if expected not in (None, size):
                    listed = f"{expected} bytes, as listed"
                    raise DataError(self.storage.url.text, field=name, expected=listed, got=str(size), do="run again")
                make_folder((self.folder / name).parent)
                file.replace(self.folder / name)
                self._index[name] = [wanted[name].version, *self._state(name)]
        self.write_index({})

    def _lacks(self, name: str, version: str) -> bool:
        return not version or self._index.get(name) != [version, *self._state(name)]

    def _state(self, name: str) -> list[int]:
        """What changes when a local file is written; empty where there is none."""
        with suppress(OSError):
            state = (self.folder / name).stat()
            return [state.st_size, state.st_mtime_ns]
        return []

    @contextmanager
    def _local_faults(self) -> Iterator[None]:
        try:
            yield
        except (OSError, OutputError) as error:
            do = "free some disk space, or name another folder with FISHEYE_BENCH_REMOTE"
            got = error.got if isinstance(error, OutputError) else error.strerror or str(error)
            expected = f"a local folder with space for {self.storage.url}"
            raise DataError(self.folder, expected=expected, got=got, do=do) from error


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


def _remedy(error: Exception) -> str:
    kinds = {kind.__name__ for kind in type(error).__mro__}
    if isinstance(error, ImportError):
        return "pip install 'fisheye-bench[remote]', or the library of fsspec for that protocol"
    if getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT):
        return "free some disk space, or name another folder with FISHEYE_BENCH_REMOTE"
    if kinds & {"NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError"}:
        return "set credentials, in the environment or in the configuration of fsspec"
    if isinstance(error, PermissionError):
        return "use credentials that may do this"
    if isinstance(error, FileNotFoundError):
        return "check bucket and folder; buckets are not made"
    if kinds & {"ConnectionError", "TimeoutError", "HTTPClientError"}:
        return "check endpoint (for S3: AWS_ENDPOINT_URL) and network"
    return "check region, endpoint and credentials" if "BotoCoreError" in kinds else ""

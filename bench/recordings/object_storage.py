"""Data on object storage, through fsspec: `root: s3://bucket/prefix` in a card.

Adapters read files, so a recording is copied into a local folder when and where it is opened. What the storage lists
(sizes, checksums or times) tells which objects changed since. Endpoints and credentials are fsspec's own configuration
(its files and the environment); addresses never carry any.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from bench.atomic import folder_lock, make_folder, write_text
from bench.errors import BenchError, DataError, OutputError, UsageError
from bench.recordings.error_handlers import STRICT, ErrorHandler
from bench.recordings.handles import RecordingHandle
from bench.records.recording import Recording

# Adapters whose recordings are entries of the top folder, and whether they also read other entries of it. Of all other
# adapters' data sets the whole is copied at once.
BY_RECORDING = {"native": False, "rosbag": True}

LOCAL = ("file", "local")
ADDRESS = re.compile(r"([a-z][a-z0-9+.-]+)://(.*)", re.IGNORECASE | re.DOTALL)
FORBIDDEN = frozenset("?*[]{}#\\")  # a query, or a pattern to fsspec
LONGEST_PART_BYTES = 255  # of a name on a file system

# What storages list of an object that changes with its content: checksums and times.
VERSION_KEYS = ("ETag", "etag", "checksum", "LastModified", "last_modified", "mtime", "modified", "updated", "created")
BATCH_FILES = 512  # downloaded between two writes of the index
INDEX, LANDING = "index.json", ".landing-"

# A missing endpoint is reported within half a minute; the user's own configuration of fsspec takes precedence.
S3_CONFIGURATION = {"connect_timeout": 4, "read_timeout": 20, "retries": {"mode": "standard", "total_max_attempts": 4}}
S3_ATTEMPTS = 2  # of s3fs, each with those of the layer below
S3_TRANSFERS = 32  # at the same time; s3fs holds a large file's chunks in memory
FREE_SPACE = "free some disk space, or name another folder with FISHEYE_BENCH_REMOTE"
REMEDIES = {  # by names of exceptions, for these libraries need not be installed
    "ImportError": "pip install 'fisheye-bench[remote]', or the library of fsspec for that protocol",
    "NoCredentialsError PartialCredentialsError CredentialRetrievalError": (
        "set credentials, in the environment or in the configuration of fsspec"
    ),
    "PermissionError": "use credentials that may do this",
    "FileNotFoundError": "check bucket and folder; buckets are not made",
    "ConnectionError TimeoutError HTTPClientError": "check endpoint (for S3: AWS_ENDPOINT_URL) and network",
    "BotoCoreError": "check region, endpoint and credentials",
}

Handles = tuple[RecordingHandle, ...]
ListRecordings = Callable[[Path], Handles]
Index = dict[str, list[str | int]]  # by name: version, and size and modification time of the local file


@dataclass(frozen=True, slots=True)
class RemoteUrl:
    """A folder on object storage.

    Attributes:
        text: the address, without credentials and without a slash at its end.
    """

    text: str

    @property
    def protocol(self) -> str:
        """The part before `://`."""
        return self.text.partition("://")[0].lower()

    @property
    def name(self) -> str:
        """The last part of the path, which is the bucket where there is no other."""
        return self.text.rpartition("/")[2]

    def __str__(self) -> str:
        return self.text


class StoredObject(NamedTuple):
    """An object as the storage lists it: size, None where that is not known, and checksums and times, "" without."""

    size_bytes: int | None
    version: str


def parse_location(text: str) -> Path | RemoteUrl:
    """A folder by path or address; `file://` addresses are paths.

    Raises:
        UsageError: an address that carries credentials or a query, or whose path is not plain. The message does not
            repeat what may be secret.
    """
    found, shown = ADDRESS.fullmatch(text), without_secrets(text).partition("?")[0]
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
        raise UsageError(f"expected an address without a password, got {shown!r}; put it into fsspec's configuration")
    parts = rest.split("/")
    if not FORBIDDEN.isdisjoint(rest) or not rest.isprintable() or any(part in ("", ".", "..") for part in parts):
        raise UsageError(f"expected an address of plain names, without a query or pattern, got {shown!r}")
    return RemoteUrl(f"{protocol}://{rest}")


def without_secrets(text: str) -> str:
    """A text with the credentials and queries of all addresses in it left out."""
    return re.sub(r"(\w://[^\s'\"?]*)\?[^\s'\"]*", r"\1", re.sub(r"(\w://)[^/\s'\"]*@", r"\1", text))


def refuse_unsafe(url: RemoteUrl, names: Iterable[str]) -> None:
    """Refuse names of objects that are not different files below a folder.

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
    unfit = any(part in ("", ".", "..") or len(part.encode()) > LONGEST_PART_BYTES for part in name.split("/"))
    return name.isprintable() and "\\" not in name and not PureWindowsPath(name).drive and not unfit


def remote_recordings(url: RemoteUrl, adapter_name: str, list_recordings: ListRecordings) -> Handles:
    """The recordings of a remote data set; each is copied when it is opened, where the adapter allows.

    Args:
        url: of the data set's folder.
        adapter_name: of `BY_RECORDING`, or any other.
        list_recordings: lists the recordings in a local folder, as the adapter with the card's options does; it
            travels to other processes.

    Raises:
        DataError: the data is not there or cannot be read, or the options are wrong.
    """
    parts: dict[str, tuple[str, ...]] = {}
    if adapter_name in BY_RECORDING:
        entries, handles = _list_by_names(url, list_recordings)
        paths = [PurePosixPath(entry) for entry in entries]
        own = {one.name: [path.name for path in paths if one.name in (path.name, path.stem)] for one in handles}
        taken = set(chain.from_iterable(own.values()))
        shared = [path.name for path in paths if path.name not in taken] if BY_RECORDING[adapter_name] else []
        parts = {name: (*names, *shared) for name, names in own.items() if names}
    else:
        handles = list_recordings(local_copy(url))
    openers = [partial(open_remote, url, list_recordings, one.name, parts.get(one.name, ())) for one in handles]
    return tuple(replace(one, opener=opener) for one, opener in zip(handles, openers, strict=True))


def open_remote(
    url: RemoteUrl, list_recordings: ListRecordings, name: str, parts: Sequence[str], *, on_error: ErrorHandler = STRICT
) -> Recording:
    """Copy a recording and open the copy.

    Args:
        url: of the data set's folder.
        list_recordings: lists the recordings in a local folder.
        name: of the recording.
        parts: files and folders of the data set that belong to it; none for all.
        on_error: takes errors in lenient reading; whatever cannot be copied ends that too.

    Raises:
        DataError: it cannot be copied, or is not what the format asks for.
    """
    for handle in list_recordings(local_copy(url, parts)):
        if handle.name == name:
            return handle.opener(on_error=on_error) if handle.lenient else handle.opener()
    hint = "run again: it was there when the data set was listed"
    raise DataError(url.text, expected=f"the recording {name!r}", got="a folder without it", hint=hint)


def _list_by_names(url: RemoteUrl, list_recordings: ListRecordings) -> tuple[list[str], Handles]:
    """Entries of the data set's folder, and its recordings by the names of files alone."""
    entries = list_entries(url)
    with ThreadPoolExecutor() as pool:
        inside = list(pool.map(partial(list_entries, url), [entry for entry in entries if entry.endswith("/")]))
    with TemporaryDirectory(prefix="fisheye-bench-") as scratch:
        root = Path(scratch) / url.name
        root.mkdir()
        for entry in chain(entries, *inside):
            (root / entry).mkdir() if entry.endswith("/") else (root / entry).touch()
        return entries, list_recordings(root)


def list_entries(url: RemoteUrl, below: str = "") -> list[str]:
    """Names of the files and folders directly in a remote folder, or in one in it; those of folders end with a slash.

    Raises:
        DataError: there is no such folder, a name cannot be a file's, or the storage cannot be reached or refuses.
    """
    with _explained(url, "a folder with data"):
        fs, root = _connect(url)
        fs.invalidate_cache()
        listed = fs.ls(f"{root}/{below}".rstrip("/"), detail=True)
    folders = {entry["name"].rstrip("/").removeprefix(f"{root}/"): entry["type"] == "directory" for entry in listed}
    names = {name: is_folder for name, is_folder in folders.items() if name not in (root, below.rstrip("/"))}
    refuse_unsafe(url, names)
    return sorted(f"{name}/" if is_folder else name for name, is_folder in names.items())


def list_objects(url: RemoteUrl, parts: Sequence[str] = ()) -> dict[str, StoredObject]:
    """All objects below a remote folder, or those of some entries of it, by name relative to it.

    Raises:
        DataError: nothing is there, a name cannot be a file's, or the storage cannot be reached or refuses.
    """
    listed: dict[str, Any] = {}
    with _explained(url, "a folder that can be listed"):
        fs, root = _connect(url)
        fs.invalidate_cache()
        for part in parts or ("",):
            with suppress(FileNotFoundError):
                listed |= fs.find(f"{root}/{part}".rstrip("/"), detail=True)
    found = {}
    for path, entry in listed.items():
        if entry["type"] != "directory" and not path.endswith("/"):
            version = " ".join(f"{key}={entry[key]}" for key in VERSION_KEYS if entry.get(key) is not None)
            found[path.removeprefix(f"{root}/")] = StoredObject(entry["size"], version)
    if not found:
        raise DataError(
            url.text, expected="a folder with data", got="nothing there", hint="check bucket and credentials"
        )
    refuse_unsafe(url, found)
    return dict(sorted(found.items()))


def download(url: RemoteUrl, files: Mapping[str, Path]) -> None:
    """Copy objects to files, by name relative to the remote folder.

    Raises:
        DataError: an object is missing, the storage cannot be reached or refuses, or the disk is full.
    """
    with _explained(url, "objects that can be read"):
        fs, root = _connect(url)
        fs.get([f"{root}/{name}" for name in files], [str(file) for file in files.values()])


def local_copy(url: RemoteUrl, parts: Sequence[str] = ()) -> Path:
    """Bring the local copy of a remote folder up to date; a process at a time does.

    A file counts as copied when it is whole in its place and noted in the index beside the folder, with the version
    that the storage listed; so an interrupted copy goes on, and an object that changed is copied again.

    Args:
        url: of the folder.
        parts: files and folders in it that are wanted; none for all.

    Returns:
        A folder with the name of the remote one, below `FISHEYE_BENCH_REMOTE`, else below `reports/remote`.

    Raises:
        DataError: as `list_objects` and `download`; an object is shorter than listed or changes while it is copied, or
            there is no space.
    """
    listed = list_objects(url, parts)
    tag = hashlib.sha256(json.dumps([url.text, *parts]).encode()).hexdigest()[:16]
    copies = Path(os.environ.get("FISHEYE_BENCH_REMOTE") or "reports/remote").expanduser()
    folder = copies / "data" / tag / url.name
    index_file = folder.parent / INDEX
    with _space_for(url, folder):
        make_folder(folder)
        with folder_lock(folder.parent):
            index = _read_index(index_file)
            _remove_others(folder, listed)
            missing = [n for n, one in listed.items() if not one.version or index.get(n) != _noted(one, folder / n)]
            for start in range(0, len(missing), BATCH_FILES):
                index |= _copy(url, folder, {name: listed[name] for name in missing[start : start + BATCH_FILES]})
                write_text(index_file, json.dumps(index))
    if missing and list_objects(url, parts) != listed:
        expected, got = "objects that stay the same while they are downloaded", "others at the end than at the start"
        raise DataError(url.text, expected=expected, got=got, hint="files changed during the copy; run again")
    return folder


def _copy(url: RemoteUrl, folder: Path, wanted: Mapping[str, StoredObject]) -> Index:
    """Copy objects into a folder, each by one rename once it is whole; their entries of the index."""
    with TemporaryDirectory(dir=folder.parent, prefix=LANDING) as landing:
        landed = {name: Path(landing) / str(number) for number, name in enumerate(wanted)}
        download(url, landed)
        for name, file in landed.items():
            expected, size = wanted[name].size_bytes, file.stat().st_size if file.is_file() else 0
            if expected not in (None, size):
                listed = f"{expected} bytes, as listed"
                raise DataError(url.text, field=name, expected=listed, got=str(size), hint="run again")
            make_folder((folder / name).parent)
            file.replace(folder / name)
    return {name: _noted(stored, folder / name) for name, stored in wanted.items()}


def _noted(stored: StoredObject, file: Path) -> list[str | int]:
    with suppress(OSError):
        return [stored.version, file.stat().st_size, file.stat().st_mtime_ns]
    return []


def _read_index(file: Path) -> Index:
    with suppress(OSError, ValueError):  # missing or damaged: everything is copied again
        index = json.loads(file.read_bytes())
        return index if isinstance(index, dict) else {}
    return {}


def _remove_others(folder: Path, listed: Mapping[str, StoredObject]) -> None:
    for left in folder.parent.glob(f"{LANDING}*"):  # of a process that was killed
        shutil.rmtree(left, ignore_errors=True)
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            with suppress(OSError):  # something is in it
                path.rmdir()
        elif path.relative_to(folder).as_posix() not in listed:
            path.unlink()


def _connect(url: RemoteUrl) -> tuple[Any, str]:
    """The file system of an address, which fsspec shares within a process, and the folder in it."""
    import fsspec

    options = {}
    if url.protocol in ("s3", "s3a"):
        own = fsspec.config.conf.get(url.protocol, {}).get("config_kwargs", {})
        options = {"config_kwargs": S3_CONFIGURATION | own}
    fs, root = fsspec.url_to_fs(url.text, **options)
    if options:
        fs.retries, fs.batch_size = S3_ATTEMPTS, S3_TRANSFERS
    return fs, root.rstrip("/")


@contextmanager
def _explained(url: RemoteUrl, expected: str) -> Iterator[None]:
    """Report in the user's words what the storage's library raises; its exceptions have no common class."""
    try:
        yield
    except BenchError:
        raise
    except Exception as error:
        reason = without_secrets(" ".join(str(error).split())) or "no reason given"
        got = f"{type(error).__name__}: {reason}"
        raise DataError(url.text, expected=expected, got=got, hint=_remedy(error)) from error


@contextmanager
def _space_for(url: RemoteUrl, folder: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, OutputError) as error:
        got = error.got if isinstance(error, OutputError) else error.strerror or str(error)
        raise DataError(folder, expected=f"a local folder with space for {url}", got=got, hint=FREE_SPACE) from error


def _remedy(error: Exception) -> str:
    if getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT):
        return FREE_SPACE
    kinds = {kind.__name__ for kind in type(error).__mro__}
    return next((remedy for names, remedy in REMEDIES.items() if kinds.intersection(names.split())), "")

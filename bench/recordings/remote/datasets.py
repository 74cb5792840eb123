"""The recordings of a data set on object storage: each is downloaded when it is opened, where it is opened."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from bench.errors import DataError
from bench.recordings.error_handlers import STRICT, ErrorHandler
from bench.recordings.handles import RecordingHandle
from bench.recordings.remote.storage import LocalCopy, Storage
from bench.recordings.remote.urls import RemoteUrl, local_folder
from bench.records.recording import Recording

# Adapters whose recordings are entries of the top folder, and whether they also read other entries of it. Of all other
# adapters' data sets the whole is downloaded at once.
BY_RECORDING = {"native": False, "rosbag": True}

Handles = tuple[RecordingHandle, ...]
Parts = dict[str, tuple[str, ...]]
ListRecordings = Callable[[Path], Handles]


def download_folder(url: RemoteUrl, parts: Sequence[str] = ()) -> Path:
    """Bring the local copy of a remote folder up to date.

    Args:
        url: of the folder.
        parts: files and folders in it that are wanted; none for all.

    Returns:
        A folder with the name of the remote one.

    Raises:
        DataError: nothing is there, it cannot be read, its objects have names that are no files', it changes while it
            is downloaded, or there is no space for it.
    """
    storage = Storage(url)
    copy = LocalCopy(storage, local_folder(url, "data", parts))
    listed = storage.objects(*parts)
    if copy.download(listed) and storage.objects(*parts) != listed:
        expected, got = "objects that stay the same while they are downloaded", "others at the end than at the start"
        raise DataError(url.text, expected=expected, got=got, do="run again when nobody writes there")
    return copy.folder


def remote_recordings(url: RemoteUrl, adapter_name: str, list_recordings: ListRecordings) -> Handles:
    """The recordings of a remote data set; nothing of them is downloaded yet if the adapter allows.

    Args:
        url: of the data set's folder.
        adapter_name: of `BY_RECORDING`, or any other.
        list_recordings: lists the recordings in a local folder, as the adapter with the card's options does; it
            travels to other processes.

    Raises:
        DataError: the data is not there or cannot be read, or the options are wrong.
    """
    if adapter_name in BY_RECORDING:
        handles, parts = _handles_and_parts(url, adapter_name, list_recordings)
    else:
        handles, parts = list_recordings(download_folder(url)), {}
    openers = [partial(open_remote, url, list_recordings, one.name, parts.get(one.name, ())) for one in handles]
    return tuple(replace(one, opener=opener) for one, opener in zip(handles, openers, strict=True))


def open_remote(
    url: RemoteUrl, list_recordings: ListRecordings, name: str, parts: Sequence[str], *, on_error: ErrorHandler = STRICT
) -> Recording:
    """Download a recording and open the copy.

    Args:
        url: of the data set's folder.
        list_recordings: lists the recordings in a local folder.
        name: of the recording.
        parts: files and folders of the data set that belong to it; none for all.
        on_error: takes errors in lenient reading; whatever cannot be downloaded ends that too.

    Raises:
        DataError: it cannot be downloaded, or is not what the format asks for.
    """
    for handle in list_recordings(download_folder(url, parts)):
        if handle.name == name:
            return handle.opener(on_error=on_error) if handle.lenient else handle.opener()
    do = "run again: it was there when the data set was listed"
    raise DataError(url.text, expected=f"the recording {name!r}", got="a folder without it", do=do)


def _handles_and_parts(url: RemoteUrl, adapter_name: str, list_recordings: ListRecordings) -> tuple[Handles, Parts]:
    """Recordings by the names of files alone, and which entries of the data set's folder belong to each."""
    storage = Storage(url)
    entries = storage.entries()
    with ThreadPoolExecutor() as pool:
        inside = list(pool.map(storage.entries, [entry for entry in entries if entry.endswith("/")]))
    with TemporaryDirectory(prefix="fisheye-bench-") as scratch:
        root = Path(scratch) / url.name
        root.mkdir()
        for entry in chain(entries, *inside):
            (root / entry).mkdir() if entry.endswith("/") else (root / entry).touch()
        handles = list_recordings(root)
    paths = [PurePosixPath(entry) for entry in entries]
    own = {handle.name: [path.name for path in paths if handle.name in (path.name, path.stem)] for handle in handles}
    taken = set(chain.from_iterable(own.values()))
    shared = [path.name for path in paths if path.name not in taken] if BY_RECORDING[adapter_name] else []
    return handles, {name: (*names, *shared) for name, names in own.items() if names}

"""The recordings of a data set on object storage: each is fetched when it is opened, where it is opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

from bench.errors import DataError
from bench.recordings.error_handlers import STRICT, ErrorHandler
from bench.recordings.handles import RecordingHandle
from bench.recordings.records import Recording
from bench.recordings.remote.fetching import WHOLE, FetchedData, Part
from bench.recordings.remote.names import refuse_unsafe
from bench.recordings.remote.storage import Storage
from bench.recordings.remote.urls import RemoteUrl

# Adapters whose recordings are entries of the top folder, and whether they also read other entries of it. Of all other
# adapters' data sets the whole is fetched at once.
BY_RECORDING = {"native": False, "rosbag": True}
LISTINGS_AT_ONCE = 8

Adapter = Callable[..., tuple[RecordingHandle, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteDataset:
    """A data set as a card tells of it, but remote.

    Attributes:
        url: of its folder.
        adapter: that reads it.
        options: of the adapter.
        card: for messages.
        annotations: local folder of annotations apart from the data.
    """

    url: RemoteUrl
    adapter: Adapter
    options: Mapping[str, Any]
    card: Path
    annotations: Path | None

    def listed_in(self, root: Path) -> tuple[RecordingHandle, ...]:
        """What the adapter finds in a local folder."""
        return self.adapter(root, options=self.options, card=self.card, annotations=self.annotations)


def remote_recordings(dataset: RemoteDataset, adapter_name: str) -> tuple[RecordingHandle, ...]:
    """The recordings of a remote data set; nothing of them is fetched yet if the adapter allows.

    Args:
        dataset: where, and what reads it.
        adapter_name: of `BY_RECORDING`, or any other.

    Raises:
        DataError: the data is not there or cannot be read, or the options are wrong.
    """
    if adapter_name not in BY_RECORDING:
        return tuple(_remote(dataset, handle, WHOLE) for handle in dataset.listed_in(FetchedData().fetch(dataset.url)))
    entries = _two_levels(Storage(dataset.url))
    with TemporaryDirectory(prefix="fisheye-bench-") as scratch:
        root = Path(scratch) / dataset.url.name
        _lay_out(root, entries)
        listed = dataset.listed_in(root)
    own = {one.name: [entry for entry in entries if one.name in (entry, PurePosixPath(entry).stem)] for one in listed}
    taken = {entry for mine in own.values() for entry in mine}
    shared = [entry for entry in entries if entry not in taken] if BY_RECORDING[adapter_name] else []
    return tuple(
        _remote(dataset, one, Part(names=(*own[one.name], *shared)) if own[one.name] else WHOLE) for one in listed
    )


def open_remote(dataset: RemoteDataset, name: str, part: Part, *, on_error: ErrorHandler = STRICT) -> Recording:
    """Fetch a recording and open the copy.

    Raises:
        DataError: it cannot be fetched, or is not what the format asks for; whatever cannot be fetched also ends
            lenient reading.
    """
    handle = _fetched(dataset, name, part)
    return handle.opener(on_error=on_error) if handle.lenient else handle.opener()


def _remote(dataset: RemoteDataset, handle: RecordingHandle, part: Part) -> RecordingHandle:
    """A handle like another one, but of the remote data set."""
    opener = partial(open_remote, dataset, handle.name, part)
    return RecordingHandle(name=handle.name, opener=opener, lenient=handle.lenient)


def _fetched(dataset: RemoteDataset, name: str, part: Part) -> RecordingHandle:
    listed = dataset.listed_in(FetchedData().fetch(dataset.url, part))
    for handle in listed:
        if handle.name == name:
            return handle
    do = "run again: it was there when the data set was listed"
    raise DataError(dataset.url.text, expected=f"the recording {name!r}", got="a folder without it", do=do)


def _two_levels(storage: Storage) -> dict[str, dict[str, bool] | None]:
    """Names in the folder; of folders also the names in them, each with whether it is a folder; None for a file."""
    top = storage.entries()
    folders = [name for name, is_folder in top.items() if is_folder]
    with ThreadPoolExecutor(LISTINGS_AT_ONCE) as pool:
        inside = dict(zip(folders, pool.map(storage.entries, folders), strict=True))
    files = [name for name, is_folder in top.items() if not is_folder]
    refuse_unsafe(storage.url, [*files, *(f"{folder}/{name}" for folder, names in inside.items() for name in names)])
    return {name: inside.get(name) for name in top}


def _lay_out(root: Path, entries: Mapping[str, Mapping[str, bool] | None]) -> None:
    """Empty files and folders by which an adapter knows its recordings."""
    root.mkdir()
    for name, inside in entries.items():
        if inside is None:
            (root / name).touch()
            continue
        (root / name).mkdir()
        for below, is_folder in inside.items():
            (root / name / below).mkdir() if is_folder else (root / name / below).touch()

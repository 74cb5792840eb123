"""Local copies of remote folders, or of parts of them.

```
<folder>/data/<address and part>/<version>/<name of the remote folder>/...     a whole copy
<folder>/data/<address and part>/<version>.json                                what it is of, and how large
<folder>/data/<address and part>/partial-<version>/...                         one that is not whole yet
```

A version is a digest of what the storage lists. A copy gets its name when every file of it is there, and does not
change after that; files that a new version shares with the one before are linked, not fetched. Processes that fetch the
same wait for each other; a copy that a process has open is not removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from uuid import uuid4

from bench.errors import DataError, UsageError
from bench.recordings.atomic import replacing, write_text
from bench.recordings.locking import alone_in
from bench.recordings.remote.copies import Copies, let_go, open_here
from bench.recordings.remote.names import refuse_unsafe
from bench.recordings.remote.storage import Storage, StoredObject
from bench.recordings.remote.urls import RemoteUrl, remote_folder

DEFAULT_LIMIT_GB = 50.0
BATCH_FILES, BATCH_BYTES = 64, 256_000_000  # of one download; each file gets its name when it is whole
PARTIAL = "partial-"

Listing = Mapping[str, StoredObject]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What of a remote folder is wanted.

    Attributes:
        names: files and folders directly in it; none for all that is in it.
        without: folders directly in it that are not wanted.
    """

    names: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


WHOLE = Part()


def limit_from_environment() -> int:
    """Limit of all copies, bytes: `FISHEYE_BENCH_REMOTE_GB`, else 50 GB.

    Raises:
        UsageError: not a positive number.
    """
    told = os.environ.get("FISHEYE_BENCH_REMOTE_GB")
    try:
        limit_gb = float(told) if told else DEFAULT_LIMIT_GB
        if not 0 < limit_gb < 1e9:
            raise ValueError
    except ValueError as error:
        raise UsageError(f"FISHEYE_BENCH_REMOTE_GB: wanted a positive number, came {told!r}") from error
    return int(limit_gb * 1e9)


@dataclass(frozen=True, slots=True, kw_only=True)
class FetchedData:
    """The copies on this machine.

    Attributes:
        folder: where they lie.
        limit_bytes: of all of them; those used longest ago go first. Copies that are open do not go, so that it may
            grow beyond by them.
    """

    folder: Path = field(default_factory=lambda: remote_folder() / "data")
    limit_bytes: int = field(default_factory=limit_from_environment)

    def fetch(self, url: RemoteUrl, part: Part = WHOLE) -> Path:
        """A copy of what is there now, open in this process from now on.

        Args:
            url: of the remote folder.
            part: of it.

        Returns:
            A folder with the name of the remote one. It is complete and does not change.

        Raises:
            DataError: nothing is there, it cannot be read, its objects have names that are no files', it changes while
                it is fetched, or there is no room for it.
        """
        storage, place = Storage(url), self.folder / _digest(url.text, part.names, part.without)
        _make_folder(place)
        try:
            with alone_in(place):
                listed = _listing(storage, part)
                copy = place / _version(listed)
                if not _is_whole(copy / url.name, listed):
                    self._fill(storage, part, listed, copy)
                open_here(copy)
                os.utime(copy)
                Copies(self.folder).drop_others(place, but=copy)
        except OSError as error:
            do = "make room, or name another folder with FISHEYE_BENCH_REMOTE"
            came = error.strerror or str(error)
            raise DataError(error.filename or place, wanted=f"room for a copy of {url}", came=came, do=do) from error
        return copy / url.name

    def _fill(self, storage: Storage, part: Part, listed: Listing, copy: Path) -> None:
        """Fetch what is missing; then, if the storage still lists the same, give the copy its name."""
        partial = copy.with_name(f"{PARTIAL}{copy.name}")
        if copy.exists():  # somebody removed files of it
            let_go(copy)
            shutil.rmtree(partial, ignore_errors=True)
            copy.rename(partial)
        root = partial / storage.url.name
        _make_folder(root)
        _link_from_others(copy, listed, storage.url.name)
        missing = {name: told for name, told in listed.items() if not _has(root, name, told)}
        self._make_room(sum(told.size_bytes for told in missing.values()), storage.url)
        _download(storage, missing, root)
        if _listing(storage, part) != listed:
            raise DataError(
                storage.url.text,
                wanted="objects that stay the same while they are fetched",
                came="others at the end than at the beginning",
                do="run again when nobody writes there",
            )
        written = {"url": storage.url.text, "names": part.names, "objects": _told(listed)}
        size = sum(told.size_bytes for told in listed.values())
        write_text(copy.with_suffix(".json"), json.dumps({"size_bytes": size, **written}))
        partial.rename(copy)

    def _make_room(self, wanted_bytes: int, url: RemoteUrl) -> None:
        needed = f"{wanted_bytes / 1e6:.1f} MB for {url}"
        if wanted_bytes > self.limit_bytes:
            do = f"a limit above it: FISHEYE_BENCH_REMOTE_GB, which is {self.limit_bytes / 1e9:g}"
            raise DataError(self.folder, wanted=f"room for {needed}", came="less by its limit", do=do)
        copies = Copies(self.folder)
        copies.make_room(self.limit_bytes - wanted_bytes)
        free_bytes = shutil.disk_usage(self.folder).free
        if free_bytes < wanted_bytes:
            copies.make_room(copies.use().size_bytes - (wanted_bytes - free_bytes))
            free_bytes = shutil.disk_usage(self.folder).free
        if free_bytes < wanted_bytes:
            do = "make room, or name another folder with FISHEYE_BENCH_REMOTE"
            raise DataError(self.folder, wanted=f"room for {needed}", came=f"{free_bytes / 1e6:.1f} MB", do=do)


def _listing(storage: Storage, part: Part) -> Listing:
    found: dict[str, StoredObject] = {}
    for name in part.names or ("",):
        found |= storage.objects(name)
    found = {name: told for name, told in found.items() if name.partition("/")[0] not in part.without}
    if not found:
        do = "check bucket, folder and credentials"
        raise DataError(storage.url.text, wanted="a folder with data", came="nothing there", do=do)
    refuse_unsafe(storage.url, found)
    return dict(sorted(found.items()))


def _download(storage: Storage, missing: Listing, root: Path) -> None:
    """Fetch files in batches; each takes its place when it is whole."""
    landing = root.parent / "landing"
    for batch in _batches(missing):
        shutil.rmtree(landing, ignore_errors=True)
        _make_folder(landing)
        landed = {name: landing / str(number) for number, name in enumerate(batch)}
        storage.download(landed)
        for name, file in landed.items():
            size = file.stat().st_size if file.is_file() else 0
            if size != missing[name].size_bytes:
                wanted = f"{missing[name].size_bytes} bytes, as listed"
                raise DataError(storage.url.text, field=name, wanted=wanted, came=str(size), do="run again")
            _make_folder((root / name).parent)
            file.replace(root / name)
    shutil.rmtree(landing, ignore_errors=True)


def _batches(missing: Listing) -> list[list[str]]:
    batches: list[list[str]] = [[]]
    size = 0
    for name, told in missing.items():
        if batches[-1] and (len(batches[-1]) == BATCH_FILES or size + told.size_bytes > BATCH_BYTES):
            batches.append([])
            size = 0
        batches[-1].append(name)
        size += told.size_bytes
    return batches if batches[0] else []


def _link_from_others(copy: Path, listed: Listing, name: str) -> None:
    """Take files from other versions of the same, where the storage tells the same of them."""
    root = copy.with_name(f"{PARTIAL}{copy.name}") / name
    for told in copy.parent.glob("*.json"):
        other = told.with_suffix("") / name
        try:
            known = json.loads(told.read_text())["objects"]
        except (OSError, ValueError, KeyError):
            continue
        for file, (size, version) in known.items():
            stored = listed.get(file)
            same = stored == StoredObject(size_bytes=size, version=version) and bool(version)
            if stored is not None and same and _has(other, file, stored) and not (root / file).exists():
                _make_folder((root / file).parent)
                try:
                    os.link(other / file, root / file)
                except OSError:  # a file system without links
                    with replacing(root / file) as temporary:
                        shutil.copyfile(other / file, temporary)


def _is_whole(root: Path, listed: Listing) -> bool:
    return root.is_dir() and all(_has(root, name, told) for name, told in listed.items())


def _has(root: Path, name: str, told: StoredObject) -> bool:
    try:
        return (root / name).stat().st_size == told.size_bytes
    except OSError:
        return False


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        do = "name another one with FISHEYE_BENCH_REMOTE"
        came = error.strerror or str(error)
        raise DataError(folder, wanted="a folder for copies of remote data", came=came, do=do) from error


def _told(listed: Listing) -> dict[str, tuple[int, str]]:
    return {name: (told.size_bytes, told.version) for name, told in listed.items()}


def _version(listed: Listing) -> str:
    """Names what is listed; each time anew where the storage does not tell when content changes."""
    known = all(told.version for told in listed.values())
    return _digest(_told(listed), None if known else uuid4().hex)


def _digest(*values: object) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]

"""Local copies of remote folders, or of parts of them.

```
<folder>/data/<address and part>/<version>/<name of the remote folder>/...     a whole copy
<folder>/data/<address and part>/<version>.json                                its objects, with digests of the files
<folder>/data/<address and part>/partial-<version>/...                         one that is not whole yet
```

A version is a digest of what the storage lists: sizes with checksums, or with times of change where it tells no
checksums, and then an object that was replaced by one as long within the resolution of those times is not noticed. A
copy gets its name when every file of it is there, and does not change after that: a file whose SHA-256 is not the one
that was taken when it came is fetched again. Files that a new version shares with the one before are linked, not
fetched. Processes that fetch the same wait for each other; a copy that a process has open is not removed.
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

from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import DataError, OutputError, UsageError
from bench.recordings.atomic import alone_in, replacing, write_text
from bench.recordings.remote.copies import Copies, let_go, open_here
from bench.recordings.remote.names import refuse_unsafe
from bench.recordings.remote.storage import Storage, StoredObject
from bench.recordings.remote.urls import RemoteUrl, remote_folder

DEFAULT_LIMIT_GB = 50.0
BATCH_FILES, BATCH_BYTES = 64, 256_000_000  # of one download; each file gets its name when it is whole
PARTIAL = "partial-"
FETCHED = "fetched.jsonl"  # in a partial copy: names and digests of the files that are there, a line each

Digests = dict[str, str]  # SHA-256 by name
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


class CopyIndex(BaseModel):
    """`<version>.json`, written before a copy gets its name.

    Attributes:
        size_bytes: of all files.
        url: of the remote folder.
        names: the part of it.
        objects: by name: size, version that the storage told, SHA-256 of the file that came.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    size_bytes: int
    url: str
    names: tuple[str, ...]
    objects: dict[str, tuple[int, str, str]]

    @property
    def digests(self) -> Digests:
        """SHA-256 of the files."""
        return {name: digest for name, (_, _, digest) in self.objects.items()}


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
        raise UsageError(f"FISHEYE_BENCH_REMOTE_GB: expected a positive number, got {told!r}") from error
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
                if not _is_whole(copy, url.name, listed):
                    self._fill(storage, part, listed, copy)
                open_here(copy)
                os.utime(copy)
                Copies(self.folder).drop_others(place, but=copy)
        except (OSError, OutputError) as error:
            do = "make room, or name another folder with FISHEYE_BENCH_REMOTE"
            got = error.got if isinstance(error, OutputError) else error.strerror or str(error)
            raise DataError(place, expected=f"room for a copy of {url}", got=got, do=do) from error
        return copy / url.name

    def _fill(self, storage: Storage, part: Part, listed: Listing, copy: Path) -> None:
        """Fetch what is missing; then, if the storage still lists the same, give the copy its name."""
        partial = copy.with_name(f"{PARTIAL}{copy.name}")
        if copy.exists():  # files of it were removed or changed
            let_go(copy)
            shutil.rmtree(partial, ignore_errors=True)
            copy.rename(partial)
            _note(partial, _index(copy).digests)
        root = partial / storage.url.name
        _make_folder(root)
        _note(partial, _link_from_others(copy, listed, storage.url.name))
        digests = _noted(partial)
        missing = {name: told for name, told in listed.items() if not _has(root, name, digests)}
        self._make_room(sum(told.size_bytes for told in missing.values()), storage.url)
        digests |= _download(storage, missing, root)
        if _listing(storage, part) != listed:
            raise DataError(
                storage.url.text,
                expected="objects that stay the same while they are fetched",
                got="others at the end than at the beginning",
                do="run again when nobody writes there",
            )
        index = CopyIndex(
            size_bytes=sum(told.size_bytes for told in listed.values()),
            url=storage.url.text,
            names=part.names,
            objects={name: (told.size_bytes, told.version, digests[name]) for name, told in listed.items()},
        )
        write_text(copy.with_suffix(".json"), index.model_dump_json())
        partial.rename(copy)

    def _make_room(self, wanted_bytes: int, url: RemoteUrl) -> None:
        needed = f"{wanted_bytes / 1e6:.1f} MB for {url}"
        if wanted_bytes > self.limit_bytes:
            do = f"a limit above it: FISHEYE_BENCH_REMOTE_GB, which is {self.limit_bytes / 1e9:g}"
            raise DataError(self.folder, expected=f"room for {needed}", got="less by its limit", do=do)
        copies = Copies(self.folder)
        copies.make_room(self.limit_bytes - wanted_bytes)
        free_bytes = shutil.disk_usage(self.folder).free
        if free_bytes < wanted_bytes:
            copies.make_room(copies.use().size_bytes - (wanted_bytes - free_bytes))
            free_bytes = shutil.disk_usage(self.folder).free
        if free_bytes < wanted_bytes:
            do = "make room, or name another folder with FISHEYE_BENCH_REMOTE"
            raise DataError(self.folder, expected=f"room for {needed}", got=f"{free_bytes / 1e6:.1f} MB", do=do)


def _listing(storage: Storage, part: Part) -> Listing:
    found: dict[str, StoredObject] = {}
    for name in part.names or ("",):
        found |= storage.objects(name)
    found = {name: told for name, told in found.items() if name.partition("/")[0] not in part.without}
    if not found:
        do = "check bucket, folder and credentials"
        raise DataError(storage.url.text, expected="a folder with data", got="nothing there", do=do)
    refuse_unsafe(storage.url, found)
    return dict(sorted(found.items()))


def _download(storage: Storage, missing: Listing, root: Path) -> Digests:
    """Fetch files in batches; each takes its place when it is whole. Their digests."""
    landing = root.parent / "landing"
    digests: Digests = {}
    for batch in _batches(missing):
        shutil.rmtree(landing, ignore_errors=True)
        _make_folder(landing)
        landed = {name: landing / str(number) for number, name in enumerate(batch)}
        storage.download(landed)
        for name, file in landed.items():
            size = file.stat().st_size if file.is_file() else 0
            if size != missing[name].size_bytes:
                expected = f"{missing[name].size_bytes} bytes, as listed"
                raise DataError(storage.url.text, field=name, expected=expected, got=str(size), do="run again")
            _make_folder((root / name).parent)
            file.replace(root / name)
        got = {name: _digest_of(root / name) for name in batch}
        _note(root.parent, got)
        digests |= got
    shutil.rmtree(landing, ignore_errors=True)
    return digests


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


def _link_from_others(copy: Path, listed: Listing, name: str) -> Digests:
    """Take files from other versions of the same, where the storage tells the same of them. Their digests."""
    root = copy.with_name(f"{PARTIAL}{copy.name}") / name
    linked: Digests = {}
    for told in copy.parent.glob("*.json"):
        other, index = told.with_suffix("") / name, _index(told.with_suffix(""))
        for file, (size, version, digest) in index.objects.items():
            same = listed.get(file) == StoredObject(size_bytes=size, version=version) and bool(version)
            if same and not (root / file).exists() and _has(other, file, {file: digest}):
                _make_folder((root / file).parent)
                try:
                    os.link(other / file, root / file)
                except OSError:  # a file system without links
                    with replacing(root / file) as temporary:
                        shutil.copyfile(other / file, temporary)
                linked[file] = digest
    return linked


def _index(copy: Path) -> CopyIndex:
    """What a copy is of; nothing where that is missing or damaged."""
    try:
        return CopyIndex.model_validate_json(copy.with_suffix(".json").read_bytes())
    except (OSError, ValidationError):
        return CopyIndex(size_bytes=0, url="", names=(), objects={})


def _note(partial: Path, digests: Digests) -> None:
    if digests:
        with (partial / FETCHED).open("a", encoding="utf-8") as file:
            file.writelines(json.dumps([name, digest]) + "\n" for name, digest in digests.items())


def _noted(partial: Path) -> Digests:
    """Digests of the files of a partial copy; a line that was interrupted counts for nothing."""
    noted: Digests = {}
    try:
        lines = (partial / FETCHED).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return noted
    for line in lines:
        try:
            name, digest = json.loads(line)
        except (ValueError, TypeError):
            continue
        noted[str(name)] = str(digest)
    return noted


def _is_whole(copy: Path, name: str, listed: Listing) -> bool:
    digests = _index(copy).digests
    return copy.is_dir() and all(_has(copy / name, file, digests) for file in listed)


def _has(root: Path, name: str, digests: Digests) -> bool:
    """Whether a file is there, and is the one that came."""
    try:
        return name in digests and _digest_of(root / name) == digests[name]
    except OSError:
        return False


_read: dict[Path, tuple[tuple[int, ...], str]] = {}  # state of files when this process read them, and their digests


def _digest_of(file: Path) -> str:
    """SHA-256 of a file; read again only when the file system says that something was done to it."""
    told = file.stat()
    state = told.st_dev, told.st_ino, told.st_size, told.st_mtime_ns, told.st_ctime_ns
    if file not in _read or _read[file][0] != state:
        with file.open("rb") as content:
            _read[file] = state, hashlib.file_digest(content, "sha256").hexdigest()
    return _read[file][1]


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        do = "name another one with FISHEYE_BENCH_REMOTE"
        got = error.strerror or str(error)
        raise DataError(folder, expected="a folder for copies of remote data", got=got, do=do) from error


def _version(listed: Listing) -> str:
    """Names what is listed; each time anew where the storage does not tell when content changes."""
    known = all(told.version for told in listed.values())
    objects = {name: (told.size_bytes, told.version) for name, told in listed.items()}
    return _digest(objects, None if known else uuid4().hex)


def _digest(*values: object) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]

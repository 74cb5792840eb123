"""Arrays by digest in a folder of limited size; the least recently used are evicted first."""

from __future__ import annotations

import os
import re
import zipfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.atomic import replacing
from bench.errors import DataError, OutputError, UsageError

DEFAULT_LIMIT_BYTES = 4_000_000_000
EVICT_AFTER_BYTES = 64_000_000  # a process that has added so much evicts entries
MARK = "fisheye-bench.cache"
STEP_NAME = re.compile(r"[a-z][a-z0-9_-]{0,63}")

Arrays = dict[str, NDArray[np.generic]]


def default_folder() -> Path:
    """Return the usual folder of cached steps: `FISHEYE_BENCH_CACHE`, else beside the runs."""
    return Path(os.environ.get("FISHEYE_BENCH_CACHE") or "reports/cache").expanduser()


@dataclass(frozen=True, slots=True, kw_only=True)
class CacheUse:
    """Number and size of the files of a cache folder.

    Attributes:
        files: entries.
        size_bytes: of all of them.
    """

    files: int
    size_bytes: int


@dataclass(kw_only=True)
class CacheFolder:
    """A cache. Each process has its own object; what it counts is its own.

    Attributes:
        folder: of the entries.
        limit_bytes: size that `evict` brings the folder below; while processes work it grows beyond by at most
            64 MB for each.
        found: entries that were found, by the name of the step.
        missed: entries that were not, by the name of the step.
    """

    folder: Path
    limit_bytes: int = DEFAULT_LIMIT_BYTES
    found: Counter[str] = field(default_factory=Counter)
    missed: Counter[str] = field(default_factory=Counter)
    _added_bytes: int = 0

    def get(self, step: str, digest: str) -> Arrays | None:
        """An entry; None where there is none, or a damaged one."""
        file = self._file(step, digest)
        try:
            with file.open("rb") as content, np.load(content, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            os.utime(file)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            self.missed[step] += 1
            return None
        self.found[step] += 1
        return arrays

    def put(self, step: str, digest: str, arrays: Arrays) -> None:
        """Store an entry. On a disk that is full or read-only nothing is stored, which costs time only."""
        try:
            with replacing(self._file(step, digest)) as temporary:
                np.savez(temporary, **arrays)  # type: ignore[arg-type]
                self._added_bytes += temporary.stat().st_size
        except (OSError, OutputError):
            return
        if self._added_bytes > EVICT_AFTER_BYTES:
            self._added_bytes = 0
            self.evict()

    def evict(self, limit_bytes: int | None = None) -> CacheUse:
        """Remove the least recently used entries until the folder is below a size; return what is left.

        Args:
            limit_bytes: the size; None for the cache's own limit.
        """
        entries = self._entries()
        left, size_bytes = len(entries), sum(size for _, size, _ in entries)
        limit = self.limit_bytes if limit_bytes is None else limit_bytes
        for _, size, file in sorted(entries):
            if size_bytes <= limit:
                break
            file.unlink(missing_ok=True)
            left, size_bytes = left - 1, size_bytes - size
        return CacheUse(files=left, size_bytes=size_bytes)

    def use(self) -> CacheUse:
        """Count the folder's entries and their bytes."""
        sizes = [size for _, size, _ in self._entries()]
        return CacheUse(files=len(sizes), size_bytes=sum(sizes))

    def prepare(self) -> None:
        """Make the folder and mark it as a cache.

        Raises:
            DataError: it holds other files than a cache's.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            mark = self.folder / MARK
            # Looked for twice: another process may mark the folder, and fill it, in between.
            if not mark.exists() and any(self.folder.iterdir()) and not mark.exists():
                hint = "name another folder with --cache or FISHEYE_BENCH_CACHE"
                raise DataError(self.folder, expected="an empty folder or a cache", got="other files", hint=hint)
            mark.touch()
        except OSError as error:
            hint = "name another folder with --cache, or cache nothing with --no-cache"
            got = error.strerror or str(error)
            raise DataError(self.folder, expected="a folder for the cache", got=got, hint=hint) from error

    def _file(self, step: str, digest: str) -> Path:
        """The file of an entry; the name of its step comes from a method.

        Raises:
            UsageError: a name that could leave the folder, or that some file system does not take.
        """
        if not STEP_NAME.fullmatch(step):
            expected = "up to 64 lower-case letters, digits, hyphens and underscores, a letter first"
            raise UsageError(f"name of a cached step: expected {expected}; got {step!r}")
        return self.folder / step / digest[:2] / f"{digest[2:40]}.npz"

    def _entries(self) -> list[tuple[int, int, Path]]:
        """Time of the last use, size and path of every entry, half-written ones among them."""
        found = []
        for file in self.folder.glob("*/*/*.npz"):
            try:
                state = file.stat()
            except FileNotFoundError:  # another process evicted it
                continue
            found.append((state.st_mtime_ns, state.st_size, file))
        return found

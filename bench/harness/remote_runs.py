"""Runs on object storage: worked on in a local folder, each unit stored there as soon as it is done.

The storage is what counts when a run begins: units that are there are brought, whoever computed them. A unit's status
is stored last and holds the digests of its other files, so that an interrupted upload is not taken for a unit. On one
machine a second run at the same address is refused, as in a local folder. Object storage has no locks: two machines
must not run different things at one address, but they may run parts of one thing.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.errors import DataError
from bench.harness import shards, unit_files
from bench.harness.merge import RESULTS
from bench.harness.mirror import RunMirror
from bench.harness.unit_files import STATUS, SUFFIXES, unit_stem
from bench.harness.units import Unit
from bench.recordings import write_text
from bench.recordings.locking import alone_in
from bench.recordings.remote import FetchedData, Part, RemoteUrl, Storage, StoredObject, refuse_unsafe, remote_folder

MARK = "fisheye-bench.run"  # written first: shows within seconds whether the address can be written
SUMMARY, PROTOCOL = RESULTS[0], "protocol.json"
RESULTS_ONLY = Part(without=(unit_files.FOLDER,))


def fetched_run(url: RemoteUrl) -> Path:
    """A copy of a run's results, without its units, to read only.

    Raises:
        DataError: nothing is there, or it cannot be read.
    """
    return FetchedData().fetch(url, RESULTS_ONLY)


@dataclass(kw_only=True)
class RemoteRun(RunMirror):
    """A run at an address.

    Attributes:
        url: where it is kept.
    """

    url: RemoteUrl
    _listed: dict[str, StoredObject] = field(default_factory=dict)
    _same: set[str] = field(default_factory=set)  # stems of units that are here and there
    _known: dict[str, tuple[int, int, int]] = field(default_factory=dict)  # local files that need no upload

    @property
    def folder(self) -> Path:
        """The local folder in which it is worked on."""
        tag = hashlib.sha256(self.url.text.encode()).hexdigest()[:8]
        return remote_folder() / "runs" / f"{self.url.name}-{tag}"

    def begin(self, *, parts: int) -> None:
        """List what is there, show that it can be written, remove results of an older run.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._look(write=True)
        self._forget_results()
        old = [name for name in RESULTS if name in self._listed]
        for name in self._listed:
            folder, _, file = name.rpartition("/")
            if folder == shards.FOLDER and not (parts > 1 and file.endswith(f"-of-{parts:04d}.json")):
                old.append(name)
        self._remove(old)
        self._known = dict(self._states())

    def bring(self, units: Iterable[Unit]) -> None:
        """Bring units, all that differ from those here."""
        self._bring({unit_stem(unit) for unit in units})

    def bring_all(self, *, write: bool) -> None:
        """Bring all units and the reports of all parts, for a merge.

        Args:
            write: the merged run goes here; results of an older one are removed.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._look(write=write)
        with alone_in(self.folder, wait=False):
            self._forget_results()
            shutil.rmtree(self.folder / shards.FOLDER, ignore_errors=True)
            within = f"{unit_files.FOLDER}/"
            found = (name.removeprefix(within) for name in self._listed if name.startswith(within))
            self._bring({name.removesuffix(STATUS) for name in found if name.endswith(STATUS) and "/" not in name})
            beside = (f"{shards.FOLDER}/", PROTOCOL)
            self._download(name for name in self._listed if name.startswith(beside))
            self._known = dict(self._states())
        if write:
            self._remove(RESULTS)

    def bring_results(self) -> None:
        """Bring all but the units, for what writes into a finished run.

        Raises:
            DataError: nothing is there, or it cannot be read.
        """
        copy = fetched_run(self.url)
        self._make(self.folder / unit_files.FOLDER)
        with alone_in(self.folder, wait=False):
            self._forget_results()
            shutil.copytree(copy, self.folder, dirs_exist_ok=True)
            self._known = dict(self._states())

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove units of others."""
        wanted = {f"{unit_files.FOLDER}/{unit_stem(unit)}{suffix}" for unit in units for suffix in SUFFIXES}
        within = f"{unit_files.FOLDER}/"
        self._remove([name for name in self._listed if name.startswith(within) and name not in wanted])

    def keep(self, unit: Unit, *, anew: bool) -> None:
        """Store a unit, its status last, unless the same is there."""
        stem = unit_stem(unit)
        if stem in self._same and not anew:
            return
        files = {_name(stem, suffix): self.folder / _name(stem, suffix) for suffix in SUFFIXES}
        status = _name(stem, STATUS)
        self._remove([status, *(name for name, file in files.items() if not file.exists())])
        self._upload({name: file for name, file in files.items() if name != status and file.exists()})
        self._upload({status: files[status]})
        self._same.add(stem)

    def keep_rest(self) -> None:
        """Store what was written beside the units, the summary last."""
        now = dict(self._states())
        changed = {name: self.folder / name for name, state in now.items() if self._known.get(name) != state}
        self._upload({name: file for name, file in changed.items() if name != SUMMARY})
        self._upload({name: file for name, file in changed.items() if name == SUMMARY})
        self._known = now

    def _look(self, *, write: bool) -> None:
        storage = self._storage
        self._listed = storage.objects()
        units = any(name.startswith(f"{unit_files.FOLDER}/") for name in self._listed)
        if self._listed and MARK not in self._listed and not units:
            came, do = f"other objects, for example {min(self._listed)!r}", "give another address"
            raise DataError(self.url.text, wanted="an empty folder or an older run", came=came, do=do)
        refuse_unsafe(self.url, self._listed)
        self._make(self.folder / unit_files.FOLDER)
        if write:
            mark = self.folder / f".{MARK}"
            write_text(mark, "A run of fisheye-bench. It is complete when summary.json is there.\n")
            self._upload({MARK: mark})

    def _bring(self, stems: set[str]) -> None:
        there = {stem for stem in stems if _name(stem, STATUS) in self._listed}
        with self._landing() as landing:
            self._storage.download({_name(stem, STATUS): landing / f"{stem}{STATUS}" for stem in there})
            different = {stem for stem in there if not self._is_same(stem, (landing / f"{stem}{STATUS}").read_bytes())}
        self._download(
            name for stem in different for suffix in SUFFIXES if (name := _name(stem, suffix)) in self._listed
        )
        self._same |= {stem for stem in there if self._sizes_agree(stem)}

    def _is_same(self, stem: str, status: bytes) -> bool:
        try:
            return self._sizes_agree(stem) and (self.folder / _name(stem, STATUS)).read_bytes() == status
        except OSError:
            return False

    def _sizes_agree(self, stem: str) -> bool:
        for suffix in SUFFIXES:
            name = _name(stem, suffix)
            file, told = self.folder / name, self._listed.get(name)
            if (file.stat().st_size if file.exists() else None) != (None if told is None else told.size_bytes):
                return False
        return True

    def _download(self, names: Iterable[str]) -> None:
        """Objects into files; a unit's status takes its place after its other files."""
        wanted = sorted(names, key=lambda name: (name.endswith(STATUS), name))
        with self._landing() as landing:
            landed = {name: landing / str(number) for number, name in enumerate(wanted)}
            self._storage.download(landed)
            for name, file in landed.items():
                self._make((self.folder / name).parent)
                file.replace(self.folder / name)

    @contextmanager
    def _landing(self) -> Iterator[Path]:
        """A folder for files that are not whole yet."""
        with TemporaryDirectory(dir=self.folder, prefix=".landing-") as folder:
            yield Path(folder)

    def _upload(self, files: Mapping[str, Path]) -> None:
        try:
            self._storage.upload(files)
        except DataError as error:
            do = f"what is done lies in {self.folder}; the same command goes on from there"
            do = f"{error.do}; {do}" if error.do else do
            raise DataError(error.file, wanted=error.wanted, came=error.came, do=do) from error

    def _remove(self, names: Iterable[str]) -> None:
        known = [name for name in names if name in self._listed]
        self._storage.remove(known)
        for name in known:
            del self._listed[name]

    def _forget_results(self) -> None:
        """Remove from the local folder what may be of another run; parts of this one may be at work in it."""
        for path in self.folder.glob("[!.]*"):
            if path.name not in (unit_files.FOLDER, shards.FOLDER, PROTOCOL):
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def _states(self) -> Iterator[tuple[str, tuple[int, int, int]]]:
        """Local files beside the units, each with what changes when it is written."""
        for file in sorted(self.folder.rglob("*")):
            name = file.relative_to(self.folder).as_posix()
            if file.is_file() and not name.startswith((f"{unit_files.FOLDER}/", ".")):
                state = file.stat()
                yield name, (state.st_ino, state.st_size, state.st_mtime_ns)

    def _make(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            do, came = "name another one with FISHEYE_BENCH_REMOTE", error.strerror or str(error)
            raise DataError(folder, wanted="a local folder for the run", came=came, do=do) from error

    @property
    def _storage(self) -> Storage:
        return Storage(self.url)


def _name(stem: str, suffix: str) -> str:
    return f"{unit_files.FOLDER}/{stem}{suffix}"

"""Runs on object storage: worked on in a local folder, each unit stored there as soon as it is done.

The storage is what counts when a run begins: units that are there are brought, whoever computed them, unless the local
file is known to be the same: by the version that the storage tells, and by its own digest. Results of an older run stay
until those of the new one are uploaded, the summary last. On one machine a second run at the same address is refused,
as in a local folder. Object storage has no locks: two machines must not run different things at one address, but they
may run parts of one thing.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.errors import DataError
from bench.harness import shards
from bench.harness.mirror import RunMirror
from bench.harness.run_folder import EXPERIMENT
from bench.harness.unit import Unit
from bench.harness.unit_files import FOLDER, SUFFIX, unit_name
from bench.recordings import write_text
from bench.recordings.atomic import alone_in
from bench.recordings.remote import FetchedData, Part, RemoteUrl, Storage, StoredObject, refuse_unsafe, remote_folder

MARK = "fisheye-bench.run"  # written first: shows within seconds whether the address can be written
SUMMARY = "summary.json"
UNITS, SHARDS = f"{FOLDER}/", f"{shards.FOLDER}/"
INDEX = ".remote.json"  # local: version at the storage and digest of the local file, by name
RESULTS_ONLY = Part(without=(FOLDER,))


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
    _parts: int = 1
    _listed: dict[str, StoredObject] = field(default_factory=dict)
    _same: set[str] = field(default_factory=set)  # units that are here and there
    _known: dict[str, tuple[int, int, int]] = field(default_factory=dict)  # local files that need no upload

    @property
    def folder(self) -> Path:
        """The local folder in which it is worked on."""
        tag = hashlib.sha256(self.url.text.encode()).hexdigest()[:8]
        return remote_folder() / "runs" / f"{self.url.name}-{tag}"

    def begin(self, *, parts: int) -> None:
        """List what is there, show that it can be written, bring what tells which experiment it is.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._parts = parts
        self._look(write=True)
        self._forget_results()
        for name in (SUMMARY, EXPERIMENT):
            (self.folder / name).unlink(missing_ok=True)
        self._download(name for name in (SUMMARY, EXPERIMENT) if name in self._listed)
        self._known = dict(self._states())

    def bring(self, units: Iterable[Unit]) -> None:
        """Store what experiment it is, remove reports of other parts, bring units that differ from those here."""
        stale = [name for name in self._listed if name.startswith(SHARDS)]
        if self._parts > 1:
            stale = [name for name in stale if not name.endswith(f"-of-{self._parts:04d}.json")]
        self._remove(stale)
        self._upload({f"{UNITS}{file.name}": file for file in sorted((self.folder / FOLDER).glob("*.json"))})
        self._bring({f"{UNITS}{unit_name(unit)}" for unit in units})

    def bring_all(self, *, write: bool) -> None:
        """Bring all units and the reports of all parts, for a merge.

        Args:
            write: the merged run goes here.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._look(write=write)
        with alone_in(self.folder, wait=False):
            self._forget_results()
            shutil.rmtree(self.folder / shards.FOLDER, ignore_errors=True)
            self._bring({name for name in self._listed if name.startswith(UNITS) and name.endswith(SUFFIX)})
            self._download(
                name
                for name in self._listed
                if name.startswith(SHARDS) or name == SUMMARY or (name.startswith(UNITS) and name.endswith(".json"))
            )
            self._known = dict(self._states())

    def bring_results(self) -> None:
        """Bring all but the units, for what writes into a finished run.

        Raises:
            DataError: nothing is there, or it cannot be read.
        """
        copy = fetched_run(self.url)
        self._listed = self._storage.objects()
        self._make(self.folder / FOLDER)
        with alone_in(self.folder, wait=False):
            self._forget_results()
            shutil.copytree(copy, self.folder, dirs_exist_ok=True)
            self._known = dict(self._states())

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove units of others."""
        expected = {f"{UNITS}{unit_name(unit)}" for unit in units}
        found = [name for name in self._listed if name.startswith(UNITS) and name.endswith(SUFFIX)]
        self._remove([name for name in found if name not in expected])

    def keep(self, unit: Unit, *, anew: bool) -> None:
        """Store a unit, unless the same is there."""
        name = f"{UNITS}{unit_name(unit)}"
        if name not in self._same or anew:
            self._upload({name: self.folder / name})
            self._same.add(name)

    def keep_rest(self) -> None:
        """Store what was written beside the units: the summary last, and what is of older results goes."""
        now = dict(self._states())
        changed = {name: self.folder / name for name, state in now.items() if self._known.get(name) != state}
        if SUMMARY in changed:
            self._remove([SUMMARY])  # from here on, and until the new one is there, the results are not whole
        self._upload({name: file for name, file in changed.items() if name != SUMMARY})
        if SUMMARY in now:
            kept = (UNITS, SHARDS)
            self._remove([n for n in self._listed if not n.startswith(kept) and n not in (*now, MARK)])
        self._upload({name: file for name, file in changed.items() if name == SUMMARY})
        self._known = now
        self._write_index()

    def _look(self, *, write: bool) -> None:
        storage = self._storage
        self._listed = storage.objects()
        units = any(name.startswith(UNITS) for name in self._listed)
        if self._listed and MARK not in self._listed and not units:
            got, do = f"other objects, for example {min(self._listed)!r}", "give another address"
            raise DataError(self.url.text, expected="an empty folder or an older run", got=got, do=do)
        refuse_unsafe(self.url, self._listed)
        self._make(self.folder / FOLDER)
        if write:
            mark = self.folder / f".{MARK}"
            write_text(mark, "A run of fisheye-bench. It is complete when summary.json is there.\n")
            self._upload({MARK: mark})

    def _bring(self, names: set[str]) -> None:
        index = self._index()
        there = {name for name in names if name in self._listed}
        self._same |= {name for name in there if index.get(name) == [self._listed[name].version, self._digest(name)]}
        self._download(there - self._same)
        self._same |= there
        self._write_index()

    def _index(self) -> dict[str, list[str]]:
        """What was the same here and there when it was last written; empty where it is missing or damaged."""
        try:
            stored = json.loads((self.folder / INDEX).read_bytes())
        except (OSError, ValueError):
            return {}
        return stored if isinstance(stored, dict) else {}

    def _write_index(self) -> None:
        listed = self._storage.objects(FOLDER)
        same = {name: [listed[name].version, self._digest(name)] for name in sorted(self._same) if name in listed}
        write_text(self.folder / INDEX, json.dumps(same, indent=1) + "\n")

    def _digest(self, name: str) -> str:
        try:
            return hashlib.sha256((self.folder / name).read_bytes()).hexdigest()
        except OSError:
            return ""

    def _download(self, names: Iterable[str]) -> None:
        """Objects into files."""
        expected = sorted(names)
        with self._landing() as landing:
            landed = {name: landing / str(number) for number, name in enumerate(expected)}
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
            raise DataError(error.file, expected=error.expected, got=error.got, do=do) from error

    def _remove(self, names: Iterable[str]) -> None:
        known = [name for name in names if name in self._listed]
        self._storage.remove(known)
        for name in known:
            del self._listed[name]

    def _forget_results(self) -> None:
        """Remove from the local folder what may be of another run; parts of this one may be at work in it."""
        for path in self.folder.glob("[!.]*"):
            if path.name not in (FOLDER, shards.FOLDER):
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def _states(self) -> Iterator[tuple[str, tuple[int, int, int]]]:
        """Local files but for the units, each with what changes when it is written."""
        for file in sorted(self.folder.rglob("*")):
            name = file.relative_to(self.folder).as_posix()
            if file.is_file() and not name.startswith(".") and not name.endswith(SUFFIX):
                state = file.stat()
                yield name, (state.st_ino, state.st_size, state.st_mtime_ns)

    def _make(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            do, got = "name another one with FISHEYE_BENCH_REMOTE", error.strerror or str(error)
            raise DataError(folder, expected="a local folder for the run", got=got, do=do) from error

    @property
    def _storage(self) -> Storage:
        return Storage(self.url)

"""Runs on object storage: computed in a local folder, each unit stored at the address as soon as it is done.

The storage counts when a run begins: units that are there are downloaded, whoever computed them, unless the local file
is known to be the same. Results of an older run stay until those of the new one are uploaded, the summary last. On one
machine a second run at the same address is refused, as in a local folder. Object storage has no locks: two machines
must not run different things at one address, but they may run parts of one thing.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bench.errors import DataError
from bench.harness import shards
from bench.harness.run_folder import EXPERIMENT
from bench.harness.unit import Unit
from bench.harness.unit_files import FOLDER, SUFFIX, unit_name
from bench.recordings.atomic import alone_in, make_folder, write_text
from bench.recordings.object_storage import RemoteUrl
from bench.recordings.remote import LocalCopy, Storage, StoredObject, local_folder

MARK = "fisheye-bench.run"  # written first: shows within seconds whether the address can be written
SUMMARY = "summary.json"
UNITS, SHARDS = f"{FOLDER}/", f"{shards.FOLDER}/"
EVERYTHING = ("",)


class RunMirror:
    """What a run reports of its progress, to be stored elsewhere too; this mirror stores nothing."""

    def begin(self, *, parts: int) -> None:
        """A run, or a part of one, begins; download what tells which experiment is there already.

        Args:
            parts: of the run; reports of other parts of as many stay, but for a run in one piece.
        """

    def download_units(self, units: Iterable[Unit]) -> None:
        """The run may write: download stored units into its folder, before it looks for them there."""

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove stored units of others."""

    def upload_unit(self, unit: Unit) -> None:
        """A unit is in the run's folder: store it, unless the same is stored."""

    def upload_results(self) -> None:
        """Everything else that was written since `begin` is complete: store it."""


NOWHERE = RunMirror()


def downloaded_run(url: RemoteUrl) -> Path:
    """A local copy of a run's results, without its units, to read only.

    Raises:
        DataError: nothing is there, or it cannot be read.
    """
    copy = LocalCopy(Storage(url), local_folder(url, "results"))
    copy.download(_without_units(copy.storage.objects()))
    return copy.folder


class RemoteRun(RunMirror):
    """A run at an address.

    Args:
        url: where it is stored.

    Attributes:
        folder: the local folder in which it is computed.
    """

    def __init__(self, url: RemoteUrl) -> None:
        self._copy = LocalCopy(Storage(url), local_folder(url, "runs"))
        self._listed: dict[str, StoredObject] = {}
        self._parts = 1
        self.url, self.folder = url, self._copy.folder

    def begin(self, *, parts: int) -> None:
        """List what is there, check that it can be written, download what tells which experiment it is.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._parts = parts
        self._list(write=True)
        (self.folder / EXPERIMENT).unlink(missing_ok=True)
        self._download([SUMMARY, EXPERIMENT], others=(UNITS, SHARDS))
        self._copy.skip_upload(self._result_files())  # parts of this run may be computed in the same folder

    def download_units(self, units: Iterable[Unit]) -> None:
        """Store what experiment it is, remove reports of other parts, download units that differ from those here."""
        of_this_cut = f"-of-{self._parts:04d}.json"
        reports = [name for name in self._listed if name.startswith(SHARDS)]
        self._remove(name for name in reports if self._parts == 1 or not name.endswith(of_this_cut))
        self._upload(f"{UNITS}{file.name}" for file in sorted((self.folder / FOLDER).glob("*.json")))
        self._download((f"{UNITS}{unit_name(unit)}" for unit in units), others=EVERYTHING)

    def download_parts(self, *, write: bool) -> None:
        """Download all units and the reports of all parts, for a merge.

        Args:
            write: the merged run goes here.

        Raises:
            DataError: the storage cannot be reached or written, or holds something that is no run.
        """
        self._list(write=write)
        with alone_in(self.folder, wait=False):
            self._download((n for n in self._listed if n == SUMMARY or n.startswith((UNITS, SHARDS))), others=(UNITS,))

    def download_results(self) -> None:
        """Download all but the units, for what writes into a finished run.

        Raises:
            DataError: nothing is there, or it cannot be read.
        """
        self._list(write=False)
        with alone_in(self.folder, wait=False):
            self._download(_without_units(self._listed), others=(UNITS,))

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove stored units of others."""
        expected = {f"{UNITS}{unit_name(unit)}" for unit in units}
        self._remove(n for n in self._listed if n.startswith(UNITS) and n.endswith(SUFFIX) and n not in expected)

    def upload_unit(self, unit: Unit) -> None:
        """Store a unit, unless the same is there."""
        name = f"{UNITS}{unit_name(unit)}"
        self._upload([name], again=name not in self._listed)

    def upload_results(self) -> None:
        """Store what was written beside the units: the summary last, and what is of older results is removed."""
        files = self._result_files()
        new = [name for name in self._copy.changed(files) if name == SUMMARY]
        self._remove(new)  # from here on, and until the new one is there, the results are not whole
        self._upload(name for name in files if name != SUMMARY)
        if new:
            former = _without_units(self._listed).keys() - {*files, MARK}
            self._remove(name for name in former if not name.startswith(SHARDS))
            self._upload(new)
        self._copy.write_index(self._copy.storage.objects(missing_ok=True))

    def _list(self, *, write: bool) -> None:
        self._listed = self._copy.storage.objects(missing_ok=write)
        if self._listed and MARK not in self._listed and not any(name.startswith(UNITS) for name in self._listed):
            got, do = f"other objects, for example {min(self._listed)!r}", "give another address"
            raise DataError(self.url.text, expected="an empty folder or an older run", got=got, do=do)
        make_folder(self.folder / FOLDER)
        if write:
            mark = self.folder.parent / MARK
            write_text(mark, "A run of fisheye-bench. It is complete when summary.json is there.\n")
            self._copy.storage.upload({MARK: mark})

    def _result_files(self) -> list[str]:
        """Local files but for the units."""
        files = [file.relative_to(self.folder).as_posix() for file in sorted(self.folder.rglob("*")) if file.is_file()]
        return [name for name in files if not name.startswith(".") and not name.endswith(SUFFIX)]

    def _download(self, names: Iterable[str], *, others: tuple[str, ...]) -> None:
        self._copy.download({name: self._listed[name] for name in names if name in self._listed}, others=others)

    def _upload(self, names: Iterable[str], *, again: bool = False) -> None:
        try:
            self._copy.upload(names, again=again)
        except DataError as error:
            do = f"{error.do}; what is done is in {self.folder}; the same command goes on from there".removeprefix("; ")
            raise DataError(error.file, expected=error.expected, got=error.got, do=do) from error

    def _remove(self, names: Iterable[str]) -> None:
        known = [name for name in names if name in self._listed]
        self._copy.storage.remove(known)
        for name in known:
            del self._listed[name]


def _without_units(listed: dict[str, StoredObject]) -> dict[str, StoredObject]:
    return {name: stored for name, stored in listed.items() if not name.startswith(UNITS)}

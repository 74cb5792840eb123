"""The folder of a run: the results of one experiment, and the work from which they are made.

```
<run>/summary.json, tables, pictures, ...    results: they appear together, by one rename of the whole folder
<run>/units/*.unit                           work: results of units; what an interrupted run goes on from
<run>/units/experiment.json, protocol.json   of which experiment the units are
<run>/shards/*.json                          work: reports of the parts of a run
```
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from fnmatch import fnmatch
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from bench.errors import DataError
from bench.evaluation import Protocol
from bench.harness.shards import RunStamp
from bench.harness.unit_files import FOLDER
from bench.methods import Scorable
from bench.recordings import write_text
from bench.recordings.atomic import folder_lock

EXPERIMENT, PROTOCOL = f"{FOLDER}/experiment.json", "protocol.json"
WORK = (FOLDER, "shards")
RESULTS = (
    *("summary.json", PROTOCOL, "predictions.json", "cost.json", "*.parquet", "*.npz"),
    *("table.*", "range_map.*", "pictures", "index.html", "index-*.html", "figures", "figures-*"),
)


class Experiment(BaseModel):
    """What all files in the folder of a run share; code and data may change from one run to the next.

    Attributes:
        dataset: name of the data set.
        split: of it; None for all.
        method: name of the method.
        settings: of the method, but for the fingerprint of predictions, which are data.
        protocol: name of the rules.
        protocol_digest: of the rules.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    dataset: str
    split: str | None
    method: str
    settings: Mapping[str, object]
    protocol: str
    protocol_digest: str

    @classmethod
    def of(cls, *, dataset: str, split: str | None, method: Scorable, protocol: Protocol) -> Experiment:
        """The experiment that a run is."""
        made = cls._made(dataset, split, method.name, method.settings(), protocol.name, protocol.digest)
        return cls.model_validate_json(made.model_dump_json())  # as it reads from a file: lists, not tuples

    @classmethod
    def of_parts(cls, stamp: RunStamp, protocol: Protocol) -> Experiment:
        """The experiment that the parts of a run are of."""
        method = stamp.method
        return cls._made(stamp.dataset, stamp.split, method.name, method.settings, protocol.name, protocol.digest)

    @classmethod
    def found_in(cls, run: Path) -> list[Experiment]:
        """Those of the results and of the work in a folder, for as far as they can be read."""
        found = []
        for name in ("summary.json", EXPERIMENT):
            try:
                text = (run / name).read_text("utf-8")
                if name == EXPERIMENT:
                    found.append(cls.model_validate_json(text))
                else:
                    found.append(_Summary.model_validate_json(text).experiment)
            except (OSError, ValueError):
                continue
        return found

    @classmethod
    def _made(
        cls, dataset: str, split: str | None, method: str, settings: Mapping[str, object], protocol: str, digest: str
    ) -> Experiment:
        kept = {name: value for name, value in settings.items() if name != "fingerprint"}
        return cls(
            dataset=dataset, split=split, method=method, settings=kept, protocol=protocol, protocol_digest=digest
        )

    def difference(self, other: Experiment) -> str:
        """What another experiment has that this one has not, in words; empty where they are the same."""
        told = [f"{name} {getattr(other, name)!r}" for name in ("dataset", "method") if self._differs(other, name)]
        if self._differs(other, "split"):
            told.append("no split" if other.split is None else f"split {other.split!r}")
        if other.protocol_digest != self.protocol_digest:
            told.append(f"protocol {other.protocol!r} ({other.protocol_digest[:12]})")
        if other.method == self.method and other.settings != self.settings:
            names = sorted(
                name
                for name in {*other.settings, *self.settings}
                if other.settings.get(name) != self.settings.get(name)
            )
            told += [f"{name} {other.settings.get(name)!r}" for name in names]
        return ", ".join(told)

    def _differs(self, other: Experiment, name: str) -> bool:
        return bool(getattr(other, name) != getattr(self, name))


class _Method(BaseModel):
    name: str
    settings: Mapping[str, object]


class _Protocol(BaseModel):
    name: str
    digest: str


class _Summary(BaseModel):
    """Of `summary.json`, what tells experiments apart; the metrics may be those of an older version."""

    dataset: str
    split: str | None
    method: _Method
    protocol: _Protocol

    @property
    def experiment(self) -> Experiment:
        return Experiment._made(
            self.dataset, self.split, self.method.name, self.method.settings, self.protocol.name, self.protocol.digest
        )


@contextmanager
def held_run_folder(run: Path, *, shared: bool = False) -> Iterator[None]:
    """Hold the folder of a run, made where it is not there; what a killed process left half done is set right.

    Args:
        run: folder.
        shared: together with others that work at parts of the same run.

    Raises:
        DataError: it holds something that is no run, cannot be made, or is in use.
    """
    try:
        if run.exists() and any(run.iterdir()) and not (run / FOLDER).is_dir() and not _beside(run, "new").exists():
            do = "give another folder with --out, or remove what is in it"
            raise DataError(run, expected="an empty folder or an older run", got="a folder with other files", do=do)
        (run / FOLDER).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        got, do = error.strerror or str(error), "give another folder with --out"
        raise DataError(run, expected="a folder for the run", got=got, do=do) from error
    with folder_lock(run, shared=shared, wait=False):
        if not shared:
            _recover(run)
        yield


def claim(run: Path, experiment: Experiment, protocol: Protocol, *, overwrite: bool) -> None:
    """Note which experiment is going on in a folder; its results stay as they are until others take their place.

    Raises:
        DataError: the folder holds another experiment, and `overwrite` is not set.
    """
    for other in Experiment.found_in(run):
        if difference := experiment.difference(other):
            if not overwrite:
                do = "give another folder with --out, or replace what is there with --overwrite"
                expected = "an empty folder or a run of the same experiment"
                raise DataError(run, expected=expected, got=f"a run with {difference}", do=do)
            break
    write_text(run / EXPERIMENT, experiment.model_dump_json(indent=1) + "\n")
    write_text(run / FOLDER / PROTOCOL, protocol.model_dump_json(indent=1, exclude_unset=True) + "\n")


@contextmanager
def new_results(run: Path) -> Iterator[Path]:
    """A folder for new results, which takes the place of the run's when the block ends well.

    What is there stays untouched until then, and when the block raises. Work and files that no command of this package
    writes move along.

    Args:
        run: folder of the run, held by the caller.

    Raises:
        DataError: the folder beside it cannot be made, or not take its place.
    """
    place, new, old = _place(run), _beside(run, "new"), _beside(run, "old")
    try:
        new.mkdir()
    except OSError as error:
        do = "give another folder with --out"
        raise DataError(new, expected="a folder for new results", got=error.strerror or str(error), do=do) from error
    try:
        yield new
    except BaseException:
        shutil.rmtree(new, ignore_errors=True)
        raise
    try:
        for entry in sorted(place.iterdir()):
            if not _is_result(entry) and not (new / entry.name).exists():
                entry.rename(new / entry.name)
        place.rename(old)
        new.rename(place)
    except OSError as error:
        do = f"the new results are in {new}; the same command brings them to their place"
        got = error.strerror or str(error)
        raise DataError(place, expected="a folder that can be renamed", got=got, do=do) from error
    shutil.rmtree(old, ignore_errors=True)


def run_name(folder: Path) -> str:
    """Name of the run in a folder; of new results that are not at their place yet, of the run that they will be."""
    name = folder.resolve().name
    return name[1 : -len(".new")] if name.startswith(".") and name.endswith(".new") else name


def _recover(run: Path) -> None:
    """Finish, or undo, what a killed process left between the steps of `new_results`."""
    place, new, old = _place(run), _beside(run, "new"), _beside(run, "old")
    for entry in sorted(new.iterdir()) if new.exists() else ():
        if old.exists() or not _is_result(entry):  # killed between the renames, when the new results were whole
            with suppress(OSError):
                (place / entry.name).rmdir()  # an empty one, made by `held_run_folder`
            if not (place / entry.name).exists():
                entry.rename(place / entry.name)
    for rest in (new, old):
        shutil.rmtree(rest, ignore_errors=True)
    (place / FOLDER).mkdir(exist_ok=True)


def _is_result(entry: Path) -> bool:
    return entry.name not in WORK and any(fnmatch(entry.name, pattern) for pattern in RESULTS)


def _place(run: Path) -> Path:
    """The folder itself, by a name that can be renamed; as it was named where that is one."""
    return run if run.name not in {"", ".."} and not run.is_symlink() else run.resolve()


def _beside(run: Path, what: str) -> Path:
    place = _place(run)
    return place.with_name(f".{place.name}.{what}")

"""The folder of a run: its results, and the work from which they are made.

```
<run>/manifest.json                          of what run all this is; there as soon as one begins
<run>/summary.json, tables, pictures, ...    results: they take the place of older ones when all of them are there
<run>/units/                                 work: results of units; what is there is done
<run>/files.json                             the names of the files above but for units
<run>/.results.<32 digits>/                  new results that are not whole yet
```

Nothing else is ever changed or removed: a folder that holds anything more, links among it, is no run's folder.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict

from bench.atomic import folder_lock, is_temporary, temporary_name
from bench.errors import DataError, OutputError
from bench.harness.manifest import MANIFEST, Manifest, differences, read_manifest, write_manifest
from bench.harness.unit_files import FOLDER, STORED_NAME
from bench.plain_text import listed
from bench.recordings.checked_json import read_checked, write_checked

FILES = "files.json"
HINT = "give another folder with --out, or move what is in it"
LISTED = 3


def _inside(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or str(path) != name:
        raise ValueError("expected a relative path without '..'")
    return name


Name = Annotated[str, AfterValidator(_inside)]


class OwnFiles(BaseModel):
    """`files.json`.

    Attributes:
        files: names of results at their place, relative to the folder, and of the manifest.
        incoming: folder of whole new results that take the place of `files`; None most of the time.
        incoming_files: what there is in it, moved already or not.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    files: tuple[Name, ...] = ()
    incoming: Name | None = None
    incoming_files: tuple[Name, ...] = ()


@contextmanager
def held_run_folder(run: Path, *, shared: bool = False) -> Iterator[None]:
    """Hold the folder of a run, made where it is not there; what a killed process left half done is set right.

    Args:
        run: folder.
        shared: together with others that work at parts of the same run.

    Raises:
        DataError: it holds what this program did not write, cannot be made, or is in use.
    """
    try:
        run.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        got, hint = error.strerror or str(error), "give another folder with --out"
        raise DataError(run, expected="a folder for the run", got=got, hint=hint) from error
    with folder_lock(run, shared=shared, wait=False):
        if foreign := sorted(_foreign(run, _own_files(run))):
            got = f"one with {listed(foreign, LISTED)}, which this program did not write"
            raise DataError(run, expected="an empty folder or that of a run", got=got, hint=HINT)
        if not shared:
            _recover(run)
        (run / FOLDER).mkdir(exist_ok=True)
        yield


def begin_run(run: Path, manifest: Manifest, *, overwrite: bool) -> None:
    """Note of what run the folder is; results that are there stay as they are until others take their place.

    Raises:
        DataError: the folder holds another run, or a damaged manifest, and `overwrite` is not set.
    """
    if not overwrite:
        _refuse_other(run, manifest)
    if not (run / "summary.json").is_file():
        add_own_files(run, [run / MANIFEST])
        write_manifest(run, manifest)


def _refuse_other(run: Path, manifest: Manifest) -> None:
    hint = "give another folder with --out, or replace what is there with --overwrite"
    try:
        there = read_manifest(run)
    except DataError as error:
        raise DataError(error.file, field=error.field, expected=error.expected, got=error.got, hint=hint) from error
    others = [] if there is None else [str(d) for d in differences(there, manifest) if d.of_the_request]
    if others:
        got = f"another one: {'; '.join(others)}"
        raise DataError(run, expected="an empty folder or the run that is asked for", got=got, hint=hint)


def add_own_files(run: Path, files: Iterable[Path]) -> None:
    """Note that files of a run's folder are this program's own; others among `files` stay out of it."""
    own = _own_files(run)
    names = {file.relative_to(run).as_posix() for file in files if file.is_relative_to(run)}
    if not names <= {*own.files}:
        write_checked(run / FILES, own.model_copy(update={"files": tuple(sorted({*own.files, *names}))}))


@contextmanager
def new_results(run: Path) -> Iterator[Path]:
    """A folder for new results, which take the place of the run's when the block ends well.

    What is there stays untouched until then, and when the block raises.

    Args:
        run: folder of the run, held by the caller.

    Raises:
        DataError: the new folder cannot be made, or somebody put something in the way of the results.
        OutputError: the disk is full.
    """
    new = run / temporary_name("results")
    try:
        new.mkdir()
    except OSError as error:
        got, hint = error.strerror or str(error), "give another folder with --out"
        raise DataError(new, expected="a folder for new results", got=got, hint=hint) from error
    try:
        yield new
        names = tuple(sorted(file.relative_to(new).as_posix() for file in new.rglob("*") if file.is_file()))
        own = _own_files(run).model_copy(update={"incoming": new.name, "incoming_files": names})
        if in_way := sorted(name for name in _foreign(run, own) if any(_overlap(name, mine) for mine in names)):
            got = f"{listed(in_way, LISTED)}, which came during the run"
            hint = "move it, and give the same command again; units are not computed again"
            raise DataError(run, expected="nothing in the way of the results", got=got, hint=hint)
    except BaseException:
        shutil.rmtree(new, ignore_errors=True)
        raise
    try:
        write_checked(run / FILES, own)  # from here on these are the results; a process that is killed leaves the rest
    except OutputError:
        shutil.rmtree(new, ignore_errors=True)
        raise
    _bring_in(run, own)


def run_name(folder: Path) -> str:
    """Name of the run in a folder; of new results that are not at their place yet, of the run that they will be."""
    place = folder.resolve()
    return place.parent.name if is_temporary(place.name) else place.name


def _own_files(run: Path) -> OwnFiles:
    """Read `files.json`; of a folder without one nothing but units is this program's own."""
    file = run / FILES
    if not os.path.lexists(file):
        return OwnFiles()
    try:
        return read_checked(OwnFiles, file, expected="the list of a run's files")
    except DataError as error:
        raise DataError(file, expected=error.expected, got=error.got, hint=HINT) from error


def _foreign(run: Path, own: OwnFiles) -> Iterator[str]:
    """Names of what this program did not write; nothing below a link is looked at."""
    arrived = () if own.incoming is None else (n for n in own.incoming_files if not (run / own.incoming / n).exists())
    mine = {FILES, *own.files, *arrived}
    folders_of_mine = {str(folder) for name in mine for folder in PurePosixPath(name).parents} | {FOLDER}
    for place, folders, files in os.walk(run):
        here = PurePosixPath(Path(place).relative_to(run).as_posix())
        for name in folders:
            inside = str(here / name)
            if (Path(place) / name).is_symlink() or not (inside in folders_of_mine or _is_work(inside)):
                yield inside
        folders[:] = [name for name in folders if not (Path(place) / name).is_symlink()]
        for name in files:
            file, inside = Path(place) / name, str(here / name)
            if not (inside in mine or _is_work(inside)) or not _is_regular(file):
                yield inside


def _is_regular(file: Path) -> bool:
    """True for a file that is no link; also for one that is gone meanwhile, as half written ones of other parts are."""
    try:
        return stat.S_ISREG(file.lstat().st_mode)
    except FileNotFoundError:
        return True


def _is_work(name: str) -> bool:
    """True for a unit, and for what is half written."""
    first, *rest = PurePosixPath(name).parts
    return (
        is_temporary(first)
        or is_temporary(PurePosixPath(name).name)
        or (first == FOLDER and len(rest) == 1 and STORED_NAME.fullmatch(rest[0]) is not None)
    )


def _overlap(one: str, other: str) -> bool:
    """True if two names are the same, or one lies in the other."""
    return PurePosixPath(one).is_relative_to(other) or PurePosixPath(other).is_relative_to(one)


def _recover(run: Path) -> None:
    """Finish, or undo, what a killed process left of `new_results`."""
    own = _own_files(run)
    if own.incoming is not None:
        _bring_in(run, own)
    for entry in sorted(run.iterdir()):
        if is_temporary(entry.name):
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def _bring_in(run: Path, own: OwnFiles) -> None:
    """Remove the older results and move the new ones to their place; what is done already stays done."""
    assert own.incoming is not None, "there are new results"
    new, foreign = run / own.incoming, [*_foreign(run, own)]
    old = [name for name in own.files if name not in own.incoming_files and name not in foreign]
    for name in old:
        if not any(_overlap(name, other) for other in foreign):
            (run / name).unlink(missing_ok=True)
    for name in sorted(own.incoming_files, key=lambda name: name == "summary.json"):
        if (new / name).exists():
            (run / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).replace(run / name)
    for folder in sorted({str(folder) for name in old for folder in PurePosixPath(name).parents}, reverse=True):
        with suppress(OSError):  # something is in it
            (run / folder).rmdir()
    write_checked(run / FILES, OwnFiles(files=own.incoming_files))
    shutil.rmtree(new, ignore_errors=True)

"""The folder of a run: its results, and the work from which they are made.

```
<run>/manifest.json                          of what run all this is; there as soon as one begins
<run>/summary.json, tables, pictures, ...    results: they appear together, by one rename of the whole folder
<run>/units/*.unit                           work: results of units; what is there is done
```
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatch
from pathlib import Path

from bench.atomic import folder_lock
from bench.errors import DataError
from bench.harness.manifest import MANIFEST, Manifest, differences, read_manifest, write_manifest
from bench.harness.unit_files import FOLDER

RESULTS = (
    *("summary.json", "sums.csv", MANIFEST, "protocol.json", "predictions.json", "cost.json", "*.parquet", "*.npz"),
    *("table.*", "range_map.*", "pictures", "index.html", "index-*.html", "figures", "figures-*"),
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
            hint = "give another folder with --out, or remove what is in it"
            raise DataError(run, expected="an empty folder or an older run", got="a folder with other files", hint=hint)
        (run / FOLDER).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        got, hint = error.strerror or str(error), "give another folder with --out"
        raise DataError(run, expected="a folder for the run", got=got, hint=hint) from error
    with folder_lock(run, shared=shared, wait=False):
        if not shared:
            _recover(run)
        yield


def begin_run(run: Path, manifest: Manifest, *, overwrite: bool) -> None:
    """Note of what run the folder is; results that are there stay as they are until others take their place.

    Raises:
        DataError: the folder holds another run, or a damaged manifest, and `overwrite` is not set.
    """
    if not overwrite:
        _refuse_other(run, manifest)
    if not (run / "summary.json").is_file():
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
        hint = "give another folder with --out"
        raise DataError(
            new, expected="a folder for new results", got=error.strerror or str(error), hint=hint
        ) from error
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
        hint = f"the new results are in {new}; the same command brings them to their place"
        got = error.strerror or str(error)
        raise DataError(place, expected="a folder that can be renamed", got=got, hint=hint) from error
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
    return entry.name != FOLDER and any(fnmatch(entry.name, pattern) for pattern in RESULTS)


def _place(run: Path) -> Path:
    """The folder itself, by a name that can be renamed; as it was named where that is one."""
    return run if run.name not in {"", ".."} and not run.is_symlink() else run.resolve()


def _beside(run: Path, what: str) -> Path:
    place = _place(run)
    return place.with_name(f".{place.name}.{what}")

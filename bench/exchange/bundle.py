"""A run in one file, to be sent: a ZIP archive of what decides its metrics, whose digests the summary lists.

The cost of the method, tables to read, pages, pictures and the mark of a verified run are left out: they cannot be
counted again from the masks. A bundle may be foreign: nothing is unpacked but files that a run has, without
compression, which together are no larger than the bundle.
"""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import get_args
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from bench.atomic import new_folder, open_regular, replacing
from bench.errors import DataError
from bench.harness.manifest import MANIFEST
from bench.harness.run_folder import add_own_files, run_name
from bench.harness.stored import PROTOCOL, SUMMARY, SUMS, NamedFile, StoredRun, read_run

FILES = frozenset({SUMMARY, PROTOCOL, SUMS, *get_args(NamedFile)})


def write_bundle(run: Path, out: Path) -> StoredRun:
    """Pack a run; the same run gives the same bytes.

    Args:
        run: folder of the results.
        out: the file, which is replaced.

    Raises:
        DataError: a file of the run is missing or damaged.
        OutputError: the file cannot be written.
    """
    stored = _whole_run(run)
    with replacing(out) as temporary, ZipFile(temporary, "w", ZIP_STORED) as archive:
        for name in (SUMMARY, PROTOCOL, SUMS, *sorted(stored.summary.files)):
            with open_regular(run / name) as file, archive.open(ZipInfo(name), "w", force_zip64=True) as packed:
                shutil.copyfileobj(file, packed)
    return stored


def is_bundle(file: Path) -> bool:
    """True for what `write_bundle` wrote, as far as the names of its files say."""
    try:
        with ZipFile(file) as archive:
            return {MANIFEST, SUMMARY, PROTOCOL} <= {*archive.namelist()} <= FILES
    except (OSError, BadZipFile, NotImplementedError, ValueError):
        return False


def unpack_bundle(file: Path, out: Path) -> StoredRun:
    """Unpack a run into a folder that is new or empty, checked; it appears whole or not at all.

    Raises:
        DataError: no bundle, files that no run has, or that its summary is not of; the folder holds something.
    """
    with new_folder(out) as folder:
        with _readable(file), open_regular(file) as content, ZipFile(content) as archive:
            names = _names(file, archive)
            for name in names:
                with archive.open(name) as packed, replacing(folder / name) as temporary, temporary.open("wb") as there:
                    shutil.copyfileobj(packed, there)
        stored = _whole_run(folder)
        add_own_files(folder, [folder / name for name in names])
    return replace(stored, folder=out, label=run_name(out))


def _names(file: Path, archive: ZipFile) -> list[str]:
    """The files of a bundle, looked at before anything is unpacked."""
    entries = archive.infolist()
    names = [entry.filename for entry in entries]
    for entry in entries:
        if entry.filename not in FILES or names.count(entry.filename) > 1:
            expected = f"each of these at most once: {', '.join(sorted(FILES))}"
            raise DataError(file, field=entry.filename, expected=expected, got="another file, or one that stands twice")
        if entry.compress_type != ZIP_STORED:
            got = "a compressed one"
            raise DataError(file, field=entry.filename, expected="a file without compression", got=got)
    if (size := sum(entry.file_size for entry in entries)) > (largest := file.stat().st_size):
        raise DataError(file, expected=f"files of at most {largest} bytes, its own size", got=f"{size} bytes")
    return names


def _whole_run(folder: Path) -> StoredRun:
    """A run whose files are all there, and of each other.

    Raises:
        DataError: they are not.
    """
    run = read_run(folder)
    if missing := [name for name in (SUMS, *sorted(run.summary.files)) if not (folder / name).is_file()]:
        raise DataError(folder / missing[0], expected="a file of the run", got="no such file")
    return run


@contextmanager
def _readable(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise DataError(file, expected="the bundle of a run", got=" ".join(str(error).split())) from error

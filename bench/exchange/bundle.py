"""A run in one file, to be sent: a ZIP archive of what decides its metrics, with sizes and digests.

`bundle.json` lists the files. The cost of the method, tables to read, pages, pictures and the mark of a verified run
are left out: they cannot be counted again from the masks. A bundle may be foreign: nothing is unpacked but files that
a run has, each as large as the list says, without compression.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Literal, get_args
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from pydantic import AfterValidator, Field

from bench.atomic import new_folder, open_regular, replacing
from bench.errors import DataError
from bench.harness.manifest import MANIFEST
from bench.harness.run_folder import add_own_files
from bench.harness.stored import SUMMARY, RunSummary, Table, read_protocol, read_run
from bench.recordings.validation import FileModel, parse_json

LIST = "bundle.json"
PROTOCOL = "protocol.json"
FILES = frozenset({MANIFEST, SUMMARY, PROTOCOL, *get_args(Table)})
LARGEST_LIST_BYTES = 1 << 16
PIECE_BYTES = 1 << 20


def _of_a_run(name: str) -> str:
    if name not in FILES:
        raise ValueError(f"expected one of {', '.join(sorted(FILES))}")
    return name


class BundledFile(FileModel):
    """A file of a bundle."""

    size: Annotated[int, Field(ge=0)]
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class BundleList(FileModel):
    """`bundle.json`."""

    schema_version: Literal[1]
    files: dict[Annotated[str, AfterValidator(_of_a_run)], BundledFile]


def write_bundle(run: Path, out: Path) -> RunSummary:
    """Pack a run; the same run gives the same bytes.

    Args:
        run: folder of the results.
        out: the file, which is replaced.

    Raises:
        DataError: a file of the run is missing or damaged.
        OutputError: the file cannot be written.
    """
    summary = read_run(run)
    read_protocol(run, summary)
    names = [MANIFEST, SUMMARY, PROTOCOL, *sorted(summary.files)]
    if missing := [name for name in names if not (run / name).is_file()]:
        raise DataError(run / missing[0], expected="a file of the run", got="no such file")
    found = BundleList(schema_version=1, files={name: _listed(run / name) for name in names})
    with replacing(out) as temporary, ZipFile(temporary, "w", ZIP_STORED) as archive:
        archive.writestr(ZipInfo(LIST), found.model_dump_json(indent=1) + "\n")
        for name in names:
            with archive.open(ZipInfo(name), "w", force_zip64=True) as packed:
                for piece in _pieces(run / name):
                    packed.write(piece)
    return summary


def is_bundle(file: Path) -> bool:
    """True for what `write_bundle` wrote, as far as its list of files says."""
    try:
        with ZipFile(file) as archive:
            return LIST in archive.namelist()
    except (OSError, BadZipFile, NotImplementedError, ValueError):
        return False


def unpack_bundle(file: Path, out: Path) -> RunSummary:
    """Unpack a run into a folder that is new or empty, checked; it appears whole or not at all.

    Raises:
        DataError: no bundle, files that its list does not name, of other sizes or content, or that are no run; the
            folder holds something.
    """
    with new_folder(out) as folder, ExitStack() as opened:
        with _readable(file):
            archive = opened.enter_context(ZipFile(opened.enter_context(open_regular(file))))
            found = _read_list(file, archive)
        for name, expected in found.files.items():
            _unpack(file, archive, name, expected, folder)
        summary = read_run(folder)
        read_protocol(folder, summary)
        add_own_files(folder, [folder / name for name in found.files])
    return summary


def _read_list(file: Path, archive: ZipFile) -> BundleList:
    """The list of a bundle, after the archive's own directory was compared with it."""
    entries = archive.infolist()
    first = next((entry for entry in entries if entry.filename == LIST), None)
    if first is None or first.file_size > LARGEST_LIST_BYTES:
        raise DataError(file, field=LIST, expected="a list of the run's files", got="none")
    found = parse_json(BundleList, archive.read(first), file)
    if packed := [entry.filename for entry in entries if entry.compress_type != ZIP_STORED]:
        raise DataError(file, field=packed[0], expected="a file without compression", got="a compressed one")
    sizes = sorted((entry.filename, entry.file_size) for entry in entries if entry is not first)
    listed = sorted((name, one.size) for name, one in found.files.items())
    if sizes != listed:
        other = next(one for one in (*sizes, *listed) if one not in sizes or one not in listed or sizes.count(one) > 1)
        got = f"others, such as {other[0]!r} of {other[1]} bytes"
        raise DataError(file, field=LIST, expected="the files and sizes of the archive", got=got)
    return found


def _unpack(file: Path, archive: ZipFile, name: str, expected: BundledFile, folder: Path) -> None:
    digest = hashlib.sha256()
    with replacing(folder / name) as temporary, temporary.open("wb") as unpacked:
        for piece in _packed(file, archive, name):
            digest.update(piece)
            unpacked.write(piece)
    if digest.hexdigest() != expected.sha256:
        got = digest.hexdigest()[:12]
        raise DataError(file, field=name, expected=f"content with the digest {expected.sha256[:12]}", got=got)


def _packed(file: Path, archive: ZipFile, name: str) -> Iterator[bytes]:
    """The content of a file of a bundle; never more than the size that the archive states."""
    with _readable(file), archive.open(name) as packed:
        while piece := packed.read(PIECE_BYTES):
            yield piece


@contextmanager
def _readable(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise DataError(file, expected="the bundle of a run", got=" ".join(str(error).split())) from error


def _listed(file: Path) -> BundledFile:
    digest, size = hashlib.sha256(), 0
    for piece in _pieces(file):
        digest.update(piece)
        size += len(piece)
    return BundledFile(size=size, sha256=digest.hexdigest())


def _pieces(file: Path) -> Iterator[bytes]:
    with open_regular(file) as content:
        while piece := content.read(PIECE_BYTES):
            yield piece

"""The results of units on disk: one file each, there whole or not at all.

`<run>/units/<recording>-<camera>-<digest>-<start>.unit` is a ZIP archive without compression of `objects.parquet`,
`frames.parquet`, `masks.parquet`, `maps.npz` (none without a scored image) and `status.json`.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import DataError, OutputError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap, add_image_maps
from bench.harness.masks import MASKS, MASKS_SCHEMA
from bench.harness.unit import Unit, UnitTables
from bench.recordings import replacing
from bench.recordings.atomic import write_bytes

FOLDER, SUFFIX = "units", ".unit"
OBJECTS, FRAMES, MAPS, STATUS = "objects.parquet", "frames.parquet", "maps.npz", "status.json"
TABLES = {OBJECTS: OBJECTS_SCHEMA, FRAMES: FRAMES_SCHEMA, MASKS: MASKS_SCHEMA}
ROW_GROUP_ROWS = {OBJECTS: 64_000, FRAMES: 64_000, MASKS: 128}  # a mask is looked up alone, and takes some kB


class UnitStatus(BaseModel):
    """`status.json`.

    Attributes:
        unit: which images.
        key: digest of all that the result depends on.
        problems: one line per image that could not be used.
        sha256: of the other files of the unit, by name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    unit: dict[str, str | int]
    key: str
    problems: tuple[str, ...]
    sha256: dict[str, str]


def encode_unit(unit: Unit, tables: UnitTables, *, key: str) -> bytes:
    """The file of a unit; the same for the same result."""
    files = {OBJECTS: _parquet(tables.objects), FRAMES: _parquet(tables.frames), MASKS: _parquet(tables.masks)}
    if tables.image_map is not None:
        files[MAPS] = image_maps_bytes([tables.image_map])
    status = UnitStatus(
        unit={name: getattr(unit, name) for name in unit.__slots__},
        key=key,
        problems=tables.problems,
        sha256={name: hashlib.sha256(content).hexdigest() for name, content in files.items()},
    )
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_STORED) as archive:
        for name, content in (files | {STATUS: (status.model_dump_json(indent=1) + "\n").encode()}).items():
            archive.writestr(ZipInfo(name), content)
    return packed.getvalue()


class UnitFolder:
    """The units of a run on disk.

    Args:
        run: folder of the run.
    """

    def __init__(self, run: Path) -> None:
        self.folder = run / FOLDER

    def file(self, unit: Unit) -> Path:
        """Where a unit is stored."""
        return self.folder / unit_name(unit)

    def status(self, unit: Unit) -> UnitStatus | None:
        """A unit's status; None where it is not stored, or damaged."""
        try:
            return _read(self.file(unit), unit)[0]
        except DataError:
            return None

    def store(self, unit: Unit, content: bytes) -> None:
        """Store a unit.

        Raises:
            OutputError: the disk is full, or may not be written.
        """
        file = self.file(unit)
        try:
            write_bytes(file, content)
        except OutputError as error:
            do = "free some disk space, then run the same command again: units that are stored are not computed again"
            raise OutputError(file, got=error.got, do=do) from error

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove files that are not of these units."""
        names = {unit_name(unit) for unit in units}
        for file in self.folder.glob("*"):
            if file.name not in names and file.suffix != ".json" and file.is_file():
                file.unlink(missing_ok=True)

    def problems(self, units: Sequence[Unit]) -> list[str]:
        """The problems of stored units, in their order.

        Raises:
            DataError: a unit is not stored, or damaged.
        """
        return [problem for unit in units for problem in self.checked(unit).problems]

    def checked(self, unit: Unit) -> UnitStatus:
        """A unit's status.

        Raises:
            DataError: the unit is not stored, or damaged.
        """
        return _read(self.file(unit), unit)[0]

    def join(self, units: Sequence[Unit], out: Path, *, maps_name: str) -> None:
        """Write the tables and image maps of a run, with one unit in memory at a time.

        Raises:
            DataError: a unit is not stored, or damaged.
        """
        ordered = sorted(units, key=unit_name)
        for name, schema in TABLES.items():
            with replacing(out / name) as temporary:
                self._concatenate(ordered, name, schema, temporary)
        maps: tuple[ImageMap, ...] = ()
        for unit in ordered:
            _, files = _read(self.file(unit), unit)
            if MAPS in files:  # a unit without a scored image has none
                maps = add_image_maps([*maps, *load_image_maps(self.file(unit), io.BytesIO(files[MAPS]))])
        write_image_maps(out / maps_name, maps)

    def _concatenate(self, units: Sequence[Unit], name: str, schema: pa.Schema, out: Path) -> None:
        """Join tables, some units at a time; many small row groups would cost every reader memory."""
        with pq.ParquetWriter(out, schema, compression="zstd") as writer:
            waiting: list[pa.Table] = []
            for unit in units:
                _, files = _read(self.file(unit), unit)
                waiting.append(pq.read_table(io.BytesIO(files[name]), schema=schema))
                if sum(len(table) for table in waiting) >= ROW_GROUP_ROWS[name]:
                    writer.write_table(pa.concat_tables(waiting).combine_chunks())
                    waiting = []
            if waiting:
                writer.write_table(pa.concat_tables(waiting).combine_chunks())


def unit_name(unit: Unit) -> str:
    """File name of a unit: readable, safe on any file system, and never that of another unit."""
    readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{unit.recording}-{unit.camera}")[:80]
    tag = hashlib.sha256(f"{unit.recording}\0{unit.camera}".encode()).hexdigest()[:8]
    return f"{readable}-{tag}-{unit.start:08d}{SUFFIX}"


def _read(file: Path, unit: Unit) -> tuple[UnitStatus, Mapping[str, bytes]]:
    """The status and the other files of a stored unit, as they were written.

    Raises:
        DataError: the unit is not stored, or damaged.
    """
    do = "give the command of the run again; it computes what is missing"
    try:
        content = file.read_bytes()
        with ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if any(entry.compress_type != ZIP_STORED or entry.file_size > len(content) for entry in entries):
                raise BadZipFile("compressed files inside")
            files = {entry.filename: archive.read(entry) for entry in entries}
        status = UnitStatus.model_validate_json(files.pop(STATUS))
    except FileNotFoundError as error:
        raise DataError(file, expected="a stored unit", got="no such file", do=do) from error
    except (OSError, ValueError, KeyError, NotImplementedError, RuntimeError, EOFError, BadZipFile) as error:
        got = "a damaged status" if isinstance(error, ValidationError) else " ".join(str(error).split())
        raise DataError(file, expected="a stored unit", got=got, do=do) from error
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    if digests != status.sha256 or not TABLES.keys() <= digests.keys():
        raise DataError(file, expected="the files that its status lists", got="others, or damaged ones", do=do)
    if status.unit != {name: getattr(unit, name) for name in unit.__slots__}:
        raise DataError(file, field="unit", expected=str(unit), got=str(status.unit), do=do)
    return status, files


def _parquet(table: pa.Table) -> bytes:
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    return content.getvalue()


_WORDS = ("camera", "width", "height", "cell_px", "frames")
_GRIDS = ("reference_px", "missed_px", "false_px")


def write_image_maps(file: Path, maps: Sequence[ImageMap]) -> None:
    """Write an `.npz`: `index` (JSON, one entry per map), and `<number>.reference_px` and so on; atomically."""
    write_bytes(file, image_maps_bytes(maps))


def image_maps_bytes(maps: Sequence[ImageMap]) -> bytes:
    """The content of the `.npz`; the same for the same maps."""
    index = [{name: getattr(item, name) for name in _WORDS} for item in maps]
    grids = {f"{number}.{name}": getattr(item, name) for number, item in enumerate(maps) for name in _GRIDS}
    content = io.BytesIO()
    np.savez_compressed(content, index=np.array(json.dumps(index)), **grids)
    return content.getvalue()


def load_image_maps(file: Path, content: BinaryIO | None = None) -> tuple[ImageMap, ...]:
    """Read what `write_image_maps` wrote.

    Args:
        file: that holds it.
        content: the `.npz`, where it is a part of that file; None to read the file.

    Raises:
        DataError: missing or damaged.
    """
    try:
        with np.load(file if content is None else content, allow_pickle=False) as stored:
            index = json.loads(str(stored["index"]))
            return tuple(
                ImageMap(**{name: entry[name] for name in _WORDS}, **{g: stored[f"{number}.{g}"] for g in _GRIDS})
                for number, entry in enumerate(index)
            )
    except FileNotFoundError as error:
        got = "no such file; runs of older versions have none"
        raise DataError(file, expected="the image maps of a run", got=got) from error
    except (OSError, ValueError, KeyError, TypeError, NotImplementedError, BadZipFile, EOFError, zlib.error) as error:
        raise DataError(file, expected="the image maps of a run", got=" ".join(str(error).split())[:200]) from error

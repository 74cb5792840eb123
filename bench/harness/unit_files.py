"""The files of the units of a run: each unit's counts, its key, and digests by which damage is found.

```
<run>/units/<recording>-<camera>-<start>.{objects,frames}.parquet, .maps.npz    counts; no maps without a scored image
<run>/units/<recording>-<camera>-<start>.json                                   status, written last
```
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap, add_image_maps
from bench.harness.map_files import image_maps_bytes, load_image_maps, write_image_maps
from bench.harness.unit import UnitTables
from bench.harness.units import Unit
from bench.recordings import replacing
from bench.recordings.atomic import write_bytes

FOLDER = "units"
OBJECTS, FRAMES, MAPS, STATUS = ".objects.parquet", ".frames.parquet", ".maps.npz", ".json"
ROW_GROUP_ROWS = 64_000
SUFFIXES = (OBJECTS, FRAMES, MAPS, STATUS)


class UnitStatus(BaseModel):
    """`<unit>.json`.

    Attributes:
        unit: which images.
        key: digest of all that the result depends on.
        problems: one line per image that could not be used.
        sha256: of the unit's other files, by suffix.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    unit: dict[str, str | int]
    key: str
    problems: tuple[str, ...]
    sha256: dict[str, str]


def encode_unit(unit: Unit, tables: UnitTables, *, key: str) -> dict[str, bytes]:
    """The files of a unit by suffix, the status last."""
    files = {OBJECTS: _parquet(tables.objects), FRAMES: _parquet(tables.frames)}
    if tables.image_map is not None:
        files[MAPS] = image_maps_bytes([tables.image_map])
    status = UnitStatus(
        unit={name: getattr(unit, name) for name in unit.__slots__},
        key=key,
        problems=tables.problems,
        sha256={suffix: hashlib.sha256(content).hexdigest() for suffix, content in files.items()},
    )
    return files | {STATUS: (status.model_dump_json(indent=1) + "\n").encode()}


class UnitFolder:
    """The units of a run on disk.

    Args:
        run: folder of the run.
    """

    def __init__(self, run: Path) -> None:
        self.folder = run / FOLDER

    def status(self, unit: Unit) -> UnitStatus | None:
        """A unit's status; None where it is not stored, or not whole."""
        try:
            status = UnitStatus.model_validate_json(self._file(unit, STATUS).read_bytes())
            whole = all(
                hashlib.sha256(self._file(unit, suffix).read_bytes()).hexdigest() == digest
                for suffix, digest in status.sha256.items()
            )
        except (OSError, ValidationError):
            return None
        return status if whole and {OBJECTS, FRAMES} <= status.sha256.keys() else None

    def store(self, unit: Unit, files: Mapping[str, bytes]) -> None:
        """Store a unit, the status last, so that a unit is there whole or not at all.

        Raises:
            DataError: the disk is full, or may not be written.
        """
        self._file(unit, STATUS).unlink(missing_ok=True)
        for suffix in sorted(files, key=lambda suffix: suffix == STATUS):
            file = self._file(unit, suffix)
            try:
                write_bytes(file, files[suffix])
            except OSError as error:
                do = "make room, then give the same command again: units that are stored are not computed again"
                came = error.strerror or str(error)
                raise DataError(file, wanted="room for a unit's result", came=came, do=do) from error

    def files(self, unit: Unit) -> dict[str, bytes]:
        """The files of a stored unit by suffix."""
        found = {suffix: self._file(unit, suffix) for suffix in SUFFIXES}
        return {suffix: file.read_bytes() for suffix, file in found.items() if file.exists()}

    def keep_only(self, units: Iterable[Unit]) -> None:
        """Remove files of units that are not the run's."""
        stems = {unit_stem(unit) for unit in units}
        for file in self.folder.glob("*"):
            if _stem_of(file.name) not in stems:
                file.unlink(missing_ok=True)

    def problems(self, units: Sequence[Unit]) -> list[str]:
        """The problems of stored units, in their order.

        Raises:
            DataError: a unit is not stored, or not whole.
        """
        return [problem for unit in units for problem in self.checked(unit).problems]

    def checked(self, unit: Unit) -> UnitStatus:
        """A unit's status.

        Raises:
            DataError: the unit is not stored, or not whole.
        """
        status = self.status(unit)
        if status is None:
            do = "give the command of the run again; it computes what is missing"
            raise DataError(
                self._file(unit, STATUS), wanted="a stored unit", came="none, or one with damaged files", do=do
            )
        return status

    def join(self, units: Sequence[Unit], run: Path, *, maps_name: str) -> None:
        """Write the run's `objects.parquet`, `frames.parquet` and image maps, with one unit in memory at a time."""
        ordered = sorted(units, key=unit_stem)
        for name, suffix, schema in (("objects", OBJECTS, OBJECTS_SCHEMA), ("frames", FRAMES, FRAMES_SCHEMA)):
            with replacing(run / f"{name}.parquet") as temporary:
                _concatenate([self._file(unit, suffix) for unit in ordered], schema, temporary)
        maps: tuple[ImageMap, ...] = ()
        for unit in ordered:
            file = self._file(unit, MAPS)
            if file.exists():  # a unit without a scored image has none
                maps = add_image_maps([*maps, *load_image_maps(file)])
        write_image_maps(run / maps_name, maps)

    def _file(self, unit: Unit, suffix: str) -> Path:
        return self.folder / f"{unit_stem(unit)}{suffix}"


def unit_stem(unit: Unit) -> str:
    """File name of a unit: readable, safe on any file system, and never that of another unit."""
    readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{unit.recording}-{unit.camera}")[:80]
    tag = hashlib.sha256(f"{unit.recording}\0{unit.camera}".encode()).hexdigest()[:8]
    return f"{readable}-{tag}-{unit.start:08d}"


def _stem_of(name: str) -> str:
    return next((name.removesuffix(suffix) for suffix in SUFFIXES if name.endswith(suffix)), name)


def _parquet(table: pa.Table) -> bytes:
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    return content.getvalue()


def _concatenate(files: Sequence[Path], schema: pa.Schema, out: Path) -> None:
    """Join tables, some files at a time; many small row groups would cost every reader memory."""
    with pq.ParquetWriter(out, schema, compression="zstd") as writer:
        waiting: list[pa.Table] = []
        for file in files:
            waiting.append(pq.read_table(file, schema=schema))
            if sum(len(table) for table in waiting) >= ROW_GROUP_ROWS:
                writer.write_table(pa.concat_tables(waiting).combine_chunks())
                waiting = []
        if waiting:
            writer.write_table(pa.concat_tables(waiting).combine_chunks())

"""The results of units on disk: one file each, named by the digest of all that decides it; there whole or not at all.

`<run>/units/<recording>-<camera>-<first image>-<digest>.unit` is a ZIP archive without compression of
`objects.parquet`, `frames.parquet`, `masks.parquet`, `maps.npz` (none without a scored image) and `status.json`.

Beside the units `parts-<digest>.json` lists what a digest of code that decided some of them is of, so that a run can
say which module changed.
"""

from __future__ import annotations

import io
import json
import re
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.atomic import is_temporary, read_regular, replacing, write_bytes, write_text
from bench.errors import DataError, OutputError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap, add_image_maps
from bench.harness.digests import digest_of, short_digest
from bench.harness.masks import MASKS, MASKS_SCHEMA
from bench.harness.unit import Unit, UnitTables

FOLDER, SUFFIX = "units", ".unit"
STORED_NAME = re.compile(r"[A-Za-z0-9_.-]+-[0-9]{8,}-[0-9a-f]{64}\.unit|parts-[0-9a-f]{64}\.json")
OBJECTS, FRAMES, MAPS, STATUS = "objects.parquet", "frames.parquet", "maps.npz", "status.json"
TABLES = {OBJECTS: OBJECTS_SCHEMA, FRAMES: FRAMES_SCHEMA, MASKS: MASKS_SCHEMA}
ROW_GROUP_ROWS = {OBJECTS: 64_000, FRAMES: 64_000, MASKS: 128}  # a mask is looked up alone, and takes some kB


class UnitStatus(BaseModel):
    """`status.json`.

    Attributes:
        decided_by: digests of all that decides the result, by name; the unit's own digest is of these.
        problems: one line per image that could not be used.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    decided_by: dict[str, str]
    problems: tuple[str, ...]


def encode_unit(tables: UnitTables, *, decided_by: Mapping[str, str]) -> bytes:
    """The file of a unit; the same for the same result."""
    files = {OBJECTS: _parquet(tables.objects), FRAMES: _parquet(tables.frames), MASKS: _parquet(tables.masks)}
    if tables.image_map is not None:
        files[MAPS] = image_maps_bytes([tables.image_map])
    status = UnitStatus(decided_by=dict(decided_by), problems=tables.problems)
    files[STATUS] = (status.model_dump_json(indent=1) + "\n").encode()
    packed = io.BytesIO()
    with ZipFile(packed, "w", ZIP_STORED) as archive:
        for name, content in files.items():
            archive.writestr(ZipInfo(name), content)
    return packed.getvalue()


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitStore:
    """The units of a run on disk.

    Attributes:
        run: folder of the run.
    """

    run: Path

    def file(self, unit: Unit, digest: str) -> Path:
        """Return the file of a unit; its name is readable, and safe on any file system."""
        readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{unit.recording}-{unit.camera}")[:80]
        return self.run / FOLDER / f"{readable}-{unit.start:08d}-{digest}{SUFFIX}"

    def stored(self, unit: Unit) -> dict[str, dict[str, str]]:
        """The digests of all results of a unit that are stored, undamaged, with the digests of what decided each."""
        prefix = self.file(unit, "").name[: -len(SUFFIX)]
        found: dict[str, dict[str, str]] = {}
        for file in (self.run / FOLDER).glob(f"{prefix}*{SUFFIX}"):
            digest = file.name.removeprefix(prefix).removesuffix(SUFFIX)
            with suppress(DataError):
                found[digest] = _read(file, digest)[0].decided_by
        return found

    def write(self, unit: Unit, digest: str, content: bytes) -> None:
        """Store a unit, by one rename.

        Raises:
            OutputError: the disk is full, or may not be written.
        """
        file = self.file(unit, digest)
        try:
            write_bytes(file, content)
        except OutputError as error:
            hint = "free some disk space, then run the same command again: units that are stored are not computed again"
            raise OutputError(file, got=error.got, hint=hint) from error

    def write_parts(self, parts: Mapping[str, str]) -> None:
        """Store what a digest is of, for `changed_parts`.

        Args:
            parts: digests and versions by name.
        """
        short = {name: short_digest(part) if len(part) == 64 else part for name, part in parts.items()}
        write_text(self._parts_file(digest_of(dict(parts))), json.dumps(short, indent=1) + "\n")

    def changed_parts(self, digest: str, parts: Mapping[str, str]) -> list[str]:
        """Names of the parts that are others than those of an older digest; none where nobody knows its parts.

        Args:
            digest: of the older parts.
            parts: as they are now.
        """
        older, now = self._parts_file(digest), self._parts_file(digest_of(dict(parts)))
        try:
            was, found = (json.loads(read_regular(file)) for file in (older, now))
            return sorted(name for name in {*was, *found} if was.get(name) != found.get(name))
        except (OSError, ValueError, AttributeError):
            return []

    def keep_only(self, units: Mapping[Unit, str], parts: Collection[Mapping[str, str]]) -> None:
        """Remove other units and lists of parts, and what a killed process left half written."""
        names = {self.file(unit, digest).name for unit, digest in units.items()}
        names |= {self._parts_file(digest_of(dict(one))).name for one in parts}
        for file in (self.run / FOLDER).iterdir():
            if file.name not in names and (STORED_NAME.fullmatch(file.name) or is_temporary(file.name)):
                file.unlink(missing_ok=True)

    def _parts_file(self, digest: str) -> Path:
        return self.run / FOLDER / f"parts-{digest}.json"

    def join(self, units: Mapping[Unit, str], out: Path, *, maps_name: str) -> tuple[str, ...]:
        """Write the tables and image maps of a run, with one unit in memory at a time.

        Args:
            units: with their digests.
            out: folder of the results.
            maps_name: file of the image maps.

        Returns:
            The problems of all units.

        Raises:
            DataError: a unit is not stored, or damaged.
        """
        maps: tuple[ImageMap, ...] = ()
        problems: list[str] = []
        with ExitStack() as held:
            tables = {name: held.enter_context(_joined_table(out, name)) for name in TABLES}
            for unit in sorted(units, key=lambda unit: (unit.recording, unit.camera, unit.start)):
                file = self.file(unit, units[unit])
                status, files = _read(file, units[unit])
                problems += status.problems
                for name, add in tables.items():
                    add(files[name])
                if MAPS in files:  # a unit without a scored image has none
                    maps = add_image_maps([*maps, *load_image_maps(file, io.BytesIO(files[MAPS]))])
        write_bytes(out / maps_name, image_maps_bytes(maps))
        return tuple(problems)


@contextmanager
def _joined_table(out: Path, name: str) -> Iterator[Callable[[bytes], None]]:
    """Write a table of parts that are added, some at a time: many small row groups would cost every reader memory."""
    waiting: list[pa.Table] = []
    with replacing(out / name) as temporary, pq.ParquetWriter(temporary, TABLES[name], compression="zstd") as writer:

        def write() -> None:
            writer.write_table(pa.concat_tables(waiting).combine_chunks())
            waiting.clear()

        def add(content: bytes) -> None:
            waiting.append(pq.read_table(io.BytesIO(content), schema=TABLES[name]))
            if sum(len(table) for table in waiting) >= ROW_GROUP_ROWS[name]:
                write()

        yield add
        if waiting:
            write()


def _read(file: Path, digest: str) -> tuple[UnitStatus, Mapping[str, bytes]]:
    """The status and the other files of a stored unit, as they were written.

    Raises:
        DataError: the unit is not stored, or damaged.
    """
    hint = "give the command of the run again; it computes what is missing"
    try:
        content = read_regular(file)
        with ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if any(entry.compress_type != ZIP_STORED or entry.file_size > len(content) for entry in entries):
                raise BadZipFile("compressed files inside")
            files = {entry.filename: archive.read(entry) for entry in entries}
        status = UnitStatus.model_validate_json(files.pop(STATUS))
    except FileNotFoundError as error:
        raise DataError(file, expected="a stored unit", got="no such file", hint=hint) from error
    except (OSError, ValueError, KeyError, NotImplementedError, RuntimeError, EOFError, BadZipFile) as error:
        got = "a damaged status" if isinstance(error, ValidationError) else " ".join(str(error).split())
        raise DataError(file, expected="a stored unit", got=got, hint=hint) from error
    if missing := sorted(TABLES.keys() - files.keys()):
        raise DataError(file, expected="the tables of a unit", got=f"no {missing[0]}", hint=hint)
    if digest_of(status.decided_by) != digest:
        raise DataError(file, expected="a unit of the digest in its name", got="another one", hint=hint)
    return status, files


def _parquet(table: pa.Table) -> bytes:
    content = io.BytesIO()
    pq.write_table(table, content, compression="zstd")
    return content.getvalue()


_WORDS = ("camera", "width", "height", "cell_px", "frames")
_GRIDS = ("reference_px", "missed_px", "false_px")


def image_maps_bytes(maps: Sequence[ImageMap]) -> bytes:
    """An `.npz` of `index` (JSON, an entry per map), `<number>.reference_px` and so on; the same for the same maps."""
    index = [{name: getattr(item, name) for name in _WORDS} for item in maps]
    grids = {f"{number}.{name}": getattr(item, name) for number, item in enumerate(maps) for name in _GRIDS}
    content = io.BytesIO()
    np.savez_compressed(content, index=np.array(json.dumps(index)), **grids)
    return content.getvalue()


def load_image_maps(file: Path, content: BinaryIO | None = None) -> tuple[ImageMap, ...]:
    """Read what `image_maps_bytes` made.

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
        got = "no such file"
        raise DataError(file, expected="the image maps of a run", got=got) from error
    except (OSError, ValueError, KeyError, TypeError, NotImplementedError, BadZipFile, EOFError, zlib.error) as error:
        raise DataError(file, expected="the image maps of a run", got=" ".join(str(error).split())[:200]) from error

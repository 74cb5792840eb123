"""Counts as files: answers against a reference, counted by a protocol; and the counts of a whole run as tables.

```
<run>/<protocol>/counts/<recording>/<camera>-<first image>.objects.parquet   rows of `OBJECTS_SCHEMA`
<run>/<protocol>/counts/<recording>/<camera>-<first image>.map.npz           where in the image; only with a scored one
<run>/<protocol>/counts/<recording>/<camera>-<first image>.frames.parquet    rows of `FRAMES_SCHEMA`; written last
```
"""

from __future__ import annotations

import io
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench.atomic import open_regular, write_bytes
from bench.errors import BenchError, DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap, Protocol, SequenceScorer, add_image_maps
from bench.evaluation.rows import EVALUATED, IMAGE, NOT_ANNOTATED, OBJECT, to_frame
from bench.harness.answers import FAILED, SKIPPED, Answer, name_of, read_table, safe_name, write_table
from bench.harness.exact import exact_mask
from bench.harness.references import StoredReference
from bench.harness.stages import StageClock
from bench.recordings import ImageRef, Recording, read_truth
from bench.records.reference import Category, Direction, IgnoreReason, Status

COUNTS = "counts"
OBJECTS, FRAMES, MAP = ".objects.parquet", ".frames.parquet", ".map.npz"
REMOVE = "remove the file, and run again"
LARGEST = 1e12  # of any number of a table: no count of pixels or points, and no metres, are beyond
NULLABLE = {"reason", "category", "direction", "chance_tp", "ceiling_tp", "ceiling_fp", "problem", "undefined_px"}
WORDS = {
    "status": {*Status, EVALUATED, NOT_ANNOTATED, FAILED, SKIPPED},
    "reason": set(IgnoreReason),
    "category": set(Category),
    "direction": set(Direction),
}
_WORDS = ("camera", "width", "height", "cell_px", "frames")
_GRIDS = ("reference_px", "missed_px", "false_px")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TaskCounts:
    """What was counted in the images of a task by one protocol.

    Attributes:
        objects: rows of `OBJECTS_SCHEMA`.
        frames: rows of `FRAMES_SCHEMA`, one for each image.
        image_map: sums over its scored images; None without any.
    """

    objects: pa.Table
    frames: pa.Table
    image_map: ImageMap | None

    def write(self, folder: Path, name: str) -> None:
        """Write the files of a task, each by one rename, the one that says that all are there last.

        Args:
            folder: of the recording's counts.
            name: of the task.

        Raises:
            OutputError: the disk is full, or may not be written.
        """
        write_table(folder / f"{name}{OBJECTS}", self.objects)
        if self.image_map is not None:
            write_bytes(folder / f"{name}{MAP}", _map_bytes(self.image_map))
        write_table(folder / f"{name}{FRAMES}", self.frames)


def count_answers(
    recording: Recording,
    images: Sequence[ImageRef],
    *,
    answers: Sequence[Sequence[Answer]],
    references: Sequence[Sequence[StoredReference]],
    protocols: Sequence[Protocol],
    clock: StageClock,
) -> list[TaskCounts]:
    """Count the answers of a task by each protocol. An image that cannot be used is reported; the others go on.

    Args:
        recording: the drive.
        images: of one camera, in time order.
        answers: for each protocol, of each image.
        references: for each protocol, of each image.
        protocols: the rules.
        clock: adds up the time of each stage.
    """
    scorers = [SequenceScorer(protocol) for protocol in protocols]
    for number, image in enumerate(images):
        ids = None
        for scorer, said, reference in zip(scorers, answers, references, strict=True):
            answer = said[number]
            status, problem = answer.status, answer.problem
            if answer.is_answered:
                try:
                    with clock.stage("reference"):
                        frame = reference[number].frame(recording.name)
                    if ids is None and image.truth_path is not None:
                        with clock.stage("ceiling"):
                            ids = read_truth(image, recording.cameras[image.camera])
                    with clock.stage("counts"):
                        exact = None if ids is None else exact_mask(ids, recording, frame)
                        scorer.add(frame, answer.segmentation(), exact=exact)
                    continue
                except BenchError as error:
                    status, problem = FAILED, told(error, recording)
            scorer.leave_out(
                recording=recording.name,
                camera=image.camera,
                timestamp_ns=image.timestamp_ns,
                status=status,  # type: ignore[arg-type]
                problem=problem,
            )
    with clock.stage("counts"):
        ended = [scorer.finish() for scorer in scorers]
    return [
        TaskCounts(objects=objects, frames=frames, image_map=scorer.image_map())
        for scorer, (objects, frames) in zip(scorers, ended, strict=True)
    ]


def told(error: BaseException, recording: Recording) -> str:
    """The message of an error, the same wherever the data lie."""
    return str(error).replace(str(recording.root), recording.name)


class StoredRows:
    """A table of a run on disk, read a few recordings at a time.

    Args:
        folder: of the counts.
        suffix: of the files of the table.
        schema: that they are of.

    Raises:
        DataError: missing, damaged, or without a column.
    """

    def __init__(self, folder: Path, suffix: str, schema: pa.Schema) -> None:
        self.folder, self.suffix, self.schema = folder, suffix, schema
        self._files: dict[str, list[Path]] = {}
        for file in sorted(folder.glob(f"*/*{suffix}")):
            self._files.setdefault(name_of(file.parent.name), []).append(file)
        if not self._files:
            raise DataError(folder, expected=f"counts of a run (<recording>/*{suffix})", got="none", hint="run again")
        self._rows = {name: sum(self._checked(file) for file in files) for name, files in self._files.items()}

    def __len__(self) -> int:
        return sum(self._rows.values())

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        return self._rows

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, in the order of the files."""
        return to_frame(self._table(recordings, columns))

    def table(self, *, unread: frozenset[str] = frozenset()) -> pa.Table:
        """All of it, in memory; columns of `unread` are null."""
        read = self._table([*self._files], [name for name in self.schema.names if name not in unread])
        nulls = {name: pa.nulls(len(read), self.schema.field(name).type) for name in unread}
        columns = [nulls[name] if name in nulls else read[name] for name in self.schema.names]
        return pa.table(columns, names=self.schema.names).cast(self.schema)

    def _table(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        files = [file for name in recordings for file in self._files.get(name, ())]
        schema = pa.schema([self.schema.field(name) for name in columns])
        with _readable(self.folder):
            tables = [read_table(file, columns=list(columns)).cast(schema) for file in files]
            for file, table in zip(files, tables, strict=True):
                _refuse_strange_values(file, table)
                self._refuse_foreign_rows(file, table)
            rows = pa.concat_tables([schema.empty_table(), *tables])
        key = OBJECT if self.suffix == OBJECTS else IMAGE
        if set(key) <= set(columns) and rows.select(key).group_by(key).aggregate([]).num_rows < len(rows):
            raise _damage(self.folder, ", ".join(key), "each row once", "one twice")
        return rows

    def _refuse_foreign_rows(self, file: Path, rows: pa.Table) -> None:
        """Refuse rows of another recording or camera than the file's, or of objects in no image of it."""
        task = file.name.removesuffix(self.suffix)
        for name, safe in (("recording", file.parent.name), ("camera", task.rpartition("-")[0])):
            words = rows[name].unique().to_pylist() if name in rows.column_names else []
            if foreign := [word for word in words if safe_name(word) != safe]:
                raise _damage(file, name, f"rows of {name_of(safe)!r} alone", repr(foreign[0]))
        of_images = file.with_name(f"{task}{FRAMES}")
        if self.suffix == OBJECTS and "timestamp_ns" in rows.column_names and of_images.is_file():
            images = read_table(of_images, columns=["timestamp_ns"])["timestamp_ns"]
            if unknown := set(rows["timestamp_ns"].to_pylist()) - set(images.to_pylist()):
                raise _damage(file, "timestamp_ns", "times of the images beside it", min(unknown))

    def _checked(self, file: Path) -> int:
        """Rows of a file with the columns of the table."""
        with _readable(file), open_regular(file) as content:
            about = pq.ParquetFile(content)
            if missing := [name for name in self.schema.names if name not in about.schema_arrow.names]:
                raise DataError(file, field=missing[0], expected="this column of a run's counts", got="none")
            for field in self.schema:
                kind = about.schema_arrow.field(field.name).type
                if not pa.types.is_nested(kind) and kind != field.type:
                    raise DataError(file, field=field.name, expected=f"a column of {field.type}", got=str(kind))
            return int(about.metadata.num_rows)


def _refuse_strange_values(file: Path, rows: pa.Table) -> None:
    """Refuse nulls where there are none, words that are not of the enumeration, and numbers of nothing measured."""
    for field in rows.schema:
        column, real = rows[field.name], pa.types.is_floating(field.type)
        if column.null_count and not (pa.types.is_nested(field.type) or field.name in NULLABLE):
            raise _damage(file, field.name, "a value in every row", "null")
        if field.name in WORDS and (strange := set(column.unique().to_pylist()) - WORDS[field.name] - {None}):
            raise _damage(file, field.name, ", ".join(sorted(WORDS[field.name])), repr(min(strange)))
        if field.name != "timestamp_ns" and (real or pa.types.is_integer(field.type)):
            found = pc.min_max(pc.if_else(pc.is_nan(column), None, column) if real else column).as_py()
            low, high, least = found["min"], found["max"], -LARGEST if real else 0
            if low is not None and not least <= low <= high <= LARGEST:
                raise _damage(file, field.name, f"numbers from {least:g} to {LARGEST:g}", f"{low:g} to {high:g}")


def _damage(file: Path, field: str, expected: str, got: object) -> DataError:
    return DataError(file, field=field, expected=expected, got=str(got), hint=REMOVE)


def open_tables(folder: Path) -> tuple[StoredRows, StoredRows]:
    """The run's objects and frames, to be read a part at a time.

    Args:
        folder: of the run's protocol.

    Raises:
        DataError: missing, damaged, or without a column; damage further inside is met on reading.
    """
    counts = folder / COUNTS
    return StoredRows(counts, OBJECTS, OBJECTS_SCHEMA), StoredRows(counts, FRAMES, FRAMES_SCHEMA)


def read_image_maps(folder: Path) -> dict[str, ImageMap]:
    """Read the maps of where in the image a run's method was right and wrong, by camera.

    A camera that comes in several sizes has one map for each, as "front, 640 x 480".

    Args:
        folder: of the run's protocol.

    Raises:
        DataError: damaged.
    """
    maps: tuple[ImageMap, ...] = ()
    for file in sorted((folder / COUNTS).glob(f"*/*{MAP}")):
        maps = add_image_maps([*maps, _read_map(file)])
    several = [camera for camera, count in Counter(item.camera for item in maps).items() if count > 1]
    names = [f"{m.camera}, {m.width} x {m.height}" if m.camera in several else m.camera for m in maps]
    return dict(zip(names, maps, strict=True))


def is_counted(folder: Path, name: str) -> bool:
    """Whether the counts of a task are there.

    Args:
        folder: of the recording's counts.
        name: of the task.
    """
    return (folder / f"{name}{FRAMES}").is_file()


def remove_counts(folder: Path, name: str) -> None:
    """Remove the counts of a task, the file that says that all are there first.

    Args:
        folder: of the recording's counts.
        name: of the task.
    """
    for suffix in (FRAMES, MAP, OBJECTS):
        (folder / f"{name}{suffix}").unlink(missing_ok=True)


def counts_folder(folder: Path, recording: str) -> Path:
    """Folder of a recording's counts.

    Args:
        folder: of the run's protocol.
        recording: name.
    """
    return folder / COUNTS / safe_name(recording)


@contextmanager
def _readable(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        got, hint = " ".join(str(error).split())[:200], REMOVE
        raise DataError(file, expected="counts of a run", got=got, hint=hint) from error


def _map_bytes(item: ImageMap) -> bytes:
    content = io.BytesIO()
    arrays: dict[str, Any] = {name: np.array(getattr(item, name)) for name in (*_WORDS, *_GRIDS)}
    np.savez_compressed(content, **arrays)
    return content.getvalue()


def _read_map(file: Path) -> ImageMap:
    try:
        with open_regular(file) as content, np.load(content, allow_pickle=False) as stored:
            words = {name: stored[name].item() for name in _WORDS}
            return ImageMap(**words, **{name: stored[name] for name in _GRIDS})
    except (OSError, ValueError, KeyError, TypeError, NotImplementedError, BadZipFile, EOFError, zlib.error) as error:
        got, hint = " ".join(str(error).split())[:200], REMOVE
        raise DataError(file, expected="where in the image a run was right and wrong", got=got, hint=hint) from error

"""Counts as files: answers against a reference, counted by a protocol; and the counts of a whole run as tables.

```
<run>/<protocol>/counts/<recording>/<camera>-<first image>.objects.parquet   rows of `OBJECTS_SCHEMA`
<run>/<protocol>/counts/<recording>/<camera>-<first image>.map.parquet       where in the image; only with a scored one
<run>/<protocol>/counts/<recording>/<camera>-<first image>.frames.parquet    rows of `FRAMES_SCHEMA`; written last
```
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from bench.atomic import open_regular
from bench.errors import BenchError, DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, ImageMap, Protocol, SequenceScorer, add_image_maps
from bench.evaluation.rows import IMAGE, OBJECT, to_frame
from bench.harness.answers import (
    FAILED,
    Answer,
    is_answered,
    name_of,
    read_table,
    safe_name,
    segmentation_of,
    write_table,
)
from bench.harness.exact import exact_mask
from bench.harness.references import StoredReference, message_without_root, reference_of
from bench.recordings import ImageRef, Recording, read_truth

COUNTS = "counts"
OBJECTS, FRAMES, MAP = ".objects.parquet", ".frames.parquet", ".map.parquet"
REMOVE = "remove the file, and run again"
_GRIDS = ("reference_px", "missed_px", "false_px")
_MAP_SCHEMA = pa.schema(
    [
        pa.field("camera", pa.string(), nullable=False),
        *(pa.field(name, pa.int64(), nullable=False) for name in ("width", "height", "cell_px", "frames")),
        *(pa.field(name, pa.list_(pa.int64()), nullable=False) for name in _GRIDS),  # row by row
    ]
)


def count_answers(
    recording: Recording,
    images: Sequence[ImageRef],
    *,
    said: Sequence[Answer],
    reference: Sequence[StoredReference],
    protocol: Protocol,
) -> SequenceScorer:
    """Count the answers of a task by a protocol. An image that cannot be used is reported; the others go on.

    Args:
        recording: the drive.
        images: of one camera, in time order.
        said: of each image.
        reference: of each image.
        protocol: the rules.
    """
    scorer = SequenceScorer(protocol)
    for image, answer, row in zip(images, said, reference, strict=True):
        status, problem = answer["status"], answer["problem"]
        if is_answered(answer):
            try:
                frame = reference_of(row, recording.name)
                exact = None
                if image.truth_path is not None:
                    exact = exact_mask(read_truth(image, recording.cameras[image.camera]), recording, frame)
                scorer.add(frame, segmentation_of(answer), exact=exact)
                continue
            except BenchError as error:
                status, problem = FAILED, message_without_root(error, recording)
        scorer.leave_out(
            recording=recording.name,
            camera=image.camera,
            timestamp_ns=image.timestamp_ns,
            status=status,
            problem=problem,
        )
    return scorer


def write_counts(
    folder: Path, name: str, objects: pa.Table, frames: pa.Table, image_map: ImageMap | None = None
) -> None:
    """Write the counts of a task, each file by one rename, the one that says that all are there last.

    Args:
        folder: of the recording's counts.
        name: of the task.
        objects: rows of `OBJECTS_SCHEMA`.
        frames: rows of `FRAMES_SCHEMA`, one for each image.
        image_map: sums over its scored images; None without any.

    Raises:
        OutputError: the disk is full, or may not be written.
    """
    write_table(folder / f"{name}{OBJECTS}", objects)
    if image_map is not None:
        grids = {grid: getattr(image_map, grid).ravel() for grid in _GRIDS}
        row = {field.name: grids.get(field.name, getattr(image_map, field.name)) for field in _MAP_SCHEMA}
        write_table(folder / f"{name}{MAP}", pa.Table.from_pylist([row], _MAP_SCHEMA))
    write_table(folder / f"{name}{FRAMES}", frames)


class StoredRows:
    """A table of a run on disk, read a few recordings at a time.

    Its files must be of the schema and have each row once; whether its numbers are right says `verify`.

    Args:
        folder: of the counts.
        suffix: of the files of the table.
        schema: that they are of.

    Raises:
        DataError: missing, damaged, or without a column.
    """

    def __init__(self, folder: Path, suffix: str, schema: pa.Schema) -> None:
        self._schema, self._key = schema, OBJECT if suffix == OBJECTS else IMAGE
        self._files: dict[str, list[Path]] = {}
        for file in sorted(folder.glob(f"*/*{suffix}")):
            self._files.setdefault(name_of(file.parent.name), []).append(file)
        if not self._files:
            raise DataError(folder, expected=f"counts of a run (<recording>/*{suffix})", got="none", hint="run again")
        self._rows = {name: sum(self._length(file) for file in files) for name, files in self._files.items()}

    def __len__(self) -> int:
        return sum(self._rows.values())

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        return self._rows

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, in the order of the files."""
        return to_frame(self._table(recordings, columns))

    def table(self, columns: Sequence[str]) -> pa.Table:
        """Some columns of all of it, in memory."""
        return self._table([*self._files], columns)

    def _table(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        schema = pa.schema([self._schema.field(name) for name in columns])
        tables = [schema.empty_table()]
        for file in [file for name in recordings for file in self._files.get(name, ())]:
            with _readable(file):
                tables.append(read_table(file, columns=list(columns)).cast(schema))
        rows = pa.concat_tables(tables)
        if set(self._key) <= set(columns) and rows.group_by(self._key).aggregate([]).num_rows < len(rows):
            where = f"recordings {', '.join(recordings)}"
            raise DataError(where, field=", ".join(self._key), expected="each row once", got="one twice", hint=REMOVE)
        return rows

    def _length(self, file: Path) -> int:
        """Rows of a file with the columns of the table."""
        with _readable(file), open_regular(file) as content:
            about = pq.ParquetFile(content)
            if missing := [name for name in self._schema.names if name not in about.schema_arrow.names]:
                raise DataError(file, field=missing[0], expected="this column of a run's counts", got="none")
            return int(about.metadata.num_rows)


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
    except (OSError, ValueError, pa.ArrowException) as error:  # ValueError: null where none may be
        got = " ".join(str(error).split())[:200]
        raise DataError(file, expected="counts of a run", got=got, hint=REMOVE) from error


def _read_map(file: Path) -> ImageMap:
    with _readable(file):
        (row,) = read_table(file).cast(_MAP_SCHEMA).to_pylist()
        if not (row["height"] > 0 and row["cell_px"] > 0):
            raise ValueError(f"a height of {row['height']} px in cells of {row['cell_px']} px")
        rows = -(-row["height"] // row["cell_px"])
        return ImageMap(**row | {name: np.array(row[name], dtype=np.int64).reshape(rows, -1) for name in _GRIDS})

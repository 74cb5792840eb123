"""Tables of a 123D log: Arrow files with a head of MessagePack, of which single cells are read and decoded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import msgpack
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.fields import sweep_of
from bench.lidar.sweep import LARGEST_BYTES, LidarSweep
from bench.recordings.images import decode_image
from bench.recordings.validation import ForeignModel, validated

HEAD = b"metadata"
LARGEST_BATCH_BYTES = 1 << 31  # of one column
READERS_HELD = 16
BATCHES_HELD = 4  # in a process, so that compressed images of a batch are not unpacked again for each of them
MICROSECOND_NS = 1_000
ARROW_START = b"\xff\xff\xff\xff"
TIMES, LIDARS = "timestamps", "ids"
TIME_HINT = "set the card's option motion_compensated: start or end if they are no times of the points"
CONVERT_HINT = (
    "convert again with camera_store_option: jpeg_binary, lidar_store_option: binary and lidar_codec: ipc_zstd"
)


Head = TypeVar("Head", bound=ForeignModel)


@dataclass(frozen=True, slots=True)
class LogTable:
    """A table of a log: what one sensor, the ego vehicle or the annotators gave.

    Attributes:
        path: Arrow file.
    """

    path: Path

    @property
    def key(self) -> str:
        """The name of the table, with which the names of its columns begin."""
        return self.path.stem

    def head_content(self) -> dict[str, Any]:
        """The constant part of the table, such as a calibration, as it is stored.

        Raises:
            DataError: no Arrow file, or no head in it.
        """
        with _reading(self.path):
            packed = (_reader(*_state(self.path)).schema.metadata or {}).get(HEAD)
        if packed is None:
            raise DataError(self.path, field="metadata", expected="the head of a table of a 123D log", got="none")
        try:
            content = msgpack.unpackb(packed, raw=False, strict_map_key=False)
        except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
            raise DataError(self.path, field="metadata", expected="MessagePack", got=_in_one_line(error)) from error
        if not isinstance(content, dict):
            raise DataError(self.path, field="metadata", expected="an object", got=type(content).__name__)
        return content

    def head(self, model: type[Head]) -> Head:
        """The same, validated.

        Raises:
            DataError: as `head_content`, or not what the model asks for.
        """
        return validated(model, self.head_content(), file=self.path, field="metadata")

    def times_ns(self, name: str = "timestamp_us") -> NDArray[np.int64]:
        """(N,) int64, times of the rows.

        Raises:
            DataError: no such column, or times that are missing.
        """
        times_us = self.column(name)
        if times_us.null_count or not pa.types.is_int64(times_us.type):
            raise self._wrong(name, "int64 times, none missing", f"{times_us.type}, {times_us.null_count} none")
        values = times_us.to_numpy()
        if values.size and np.abs(values).max() > np.iinfo(np.int64).max // (2 * MICROSECOND_NS):
            raise self._wrong(name, "microseconds", str(values[np.abs(values).argmax()]))
        return np.asarray(values * MICROSECOND_NS)

    def column(self, name: str) -> pa.ChunkedArray:
        """A column, whole; not for images and points.

        Raises:
            DataError: no such column, or the file is damaged.
        """
        with _reading(self.path):
            reader = _reader(*_state(self.path), self._index(name))
            batches = (reader.get_batch(number) for number in range(reader.num_record_batches))
            columns = [_checked(batch.column(0), self.path) for batch in batches]
            return pa.chunked_array(columns, reader.schema.field(0).type)

    def items(self, name: str) -> list[list[Any]]:
        """The lists of a column, row by row; empty where one is missing.

        Raises:
            DataError: no such column, or one of no lists.
        """
        column = self.column(name)
        if not pa.types.is_nested(column.type):
            raise self._wrong(name, "lists", str(column.type))
        return [row or [] for row in column.to_pylist()]

    def vectors(self, name: str, lists: Iterable[list[float] | None], *, width: int) -> NDArray[np.float64]:
        """(N, width) float64 of lists of a column; NaN where one is missing.

        Raises:
            DataError: lists of another length or of no numbers.
        """
        try:
            return np.array([values or [np.nan] * width for values in lists], dtype=np.float64).reshape(-1, width)
        except (ValueError, TypeError) as error:
            raise self._wrong(name, f"lists of {width} numbers", _in_one_line(error)) from error

    def cells(self, name: str) -> Iterator[dict[str, Any]]:
        """Locations of a column's cells, in order, as `StoredCell` takes them; no cell is read.

        Raises:
            DataError: no such column, or the file is damaged.
        """
        with _reading(self.path):
            index = self._index(name)
        # The rows of a batch are known from the times, which are small.
        for batch, times_us in enumerate(self.column("timestamp_us").iterchunks()):
            for row in range(len(times_us)):
                yield {"container": self.path, "batch": batch, "column": index, "row": row}

    def _index(self, name: str) -> int:
        schema = _reader(*_state(self.path)).schema
        index = schema.get_field_index(f"{self.key}.{name}")
        if index < 0:
            raise self._wrong(name, "a column of this name", f"columns {', '.join(schema.names)[:200]}")
        return int(index)

    def _wrong(self, name: str, expected: str, got: str) -> DataError:
        return DataError(self.path, field=f"{self.key}.{name}", expected=expected, got=got)


def pose(values: tuple[float, ...] | NDArray[np.float64]) -> RigidTransform:
    """A pose from x, y, z, qw, qx, qy, qz."""
    return RigidTransform.from_quaternion(values[3:], values[:3])


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn errors of Arrow into one that names the file."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError, IndexError) as error:
        raise DataError(path, expected="an Arrow file of a 123D log", got=_in_one_line(error)) from error


def _in_one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


def _state(path: Path) -> tuple[Path, int, int]:
    """A file and what changes with its content; an open reader is of one state."""
    status = path.stat()
    return path, status.st_mtime_ns, status.st_size


@lru_cache(maxsize=READERS_HELD)
def _reader(path: Path, _mtime_ns: int, _size: int, column: int | None = None) -> pa.ipc.RecordBatchFileReader:
    """A reader of one column, so that others are not unpacked; None for all."""
    options = pa.ipc.IpcReadOptions(included_fields=None if column is None else [column])
    return pa.ipc.open_file(pa.memory_map(str(path)), options=options)


@lru_cache(maxsize=BATCHES_HELD)
def _column(path: Path, mtime_ns: int, size: int, column: int, batch: int) -> pa.Array:
    return _checked(_reader(path, mtime_ns, size, column).get_batch(batch).column(0), path)


def _checked(column: pa.Array, path: Path) -> pa.Array:
    """The column with sound lengths and offsets, so that a damaged file cannot make Arrow read elsewhere."""
    column.validate(full=True)
    if column.nbytes > LARGEST_BATCH_BYTES:
        raise DataError(path, expected="a batch that fits in memory", got=f"{column.nbytes} bytes")
    return column


# Images and sweeps, found again by their cells


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredCell:
    """A cell of a table; a `bench.records.recording.StoredPart`.

    Attributes:
        container: Arrow file.
        batch: number of the record batch.
        column: number of the column.
        row: in the batch.
    """

    container: Path
    batch: int
    column: int
    row: int

    def content(self) -> bytes:
        """Bytes of the cell.

        Raises:
            DataError: nothing there, something else, or it cannot be read.
        """
        place = f"batch {self.batch}, row {self.row}"
        with _reading(self.container):
            cell = _column(*_state(self.container), self.column, self.batch)[self.row]
            binary = pa.types.is_binary(cell.type) or pa.types.is_large_binary(cell.type)
            if not binary or not cell.is_valid:
                got = str(cell.type) if cell.is_valid else "none"
                raise DataError(self.container, field=place, expected="data in the log", got=got, hint=CONVERT_HINT)
            return bytes(cell.as_py())


@dataclass(frozen=True, slots=True, kw_only=True)
class LogImage(StoredCell):
    """An image in a log; a `bench.records.recording.StoredImage`."""

    def pixels(self, *, colour: bool) -> NDArray[np.uint8]:
        """Decode it: (height, width) uint8 grey or (height, width, 3) uint8 BGR.

        Raises:
            DataError: it cannot be read or decoded.
        """
        return decode_image(self.content(), colour=colour, file=self.container)


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSweep(StoredCell):
    """A sweep in a log, and the reader of its `SweepRef`.

    Attributes:
        lidar_id: whose points are used, of several that are merged; None for all.
        as_measured: whether points are each at their own time; else all are as at the time of the sweep.
    """

    lidar_id: int | None
    as_measured: bool

    def content(self) -> bytes:
        """All that decides what is read."""
        return StoredCell.content(self) + repr((self.lidar_id, self.as_measured)).encode()

    def __call__(self, name: Path, timestamp_ns: int) -> LidarSweep:
        """Decode it.

        Args:
            name: of the sweep, for messages.
            timestamp_ns: its reference time.

        Raises:
            DataError: it cannot be read or decoded, or lacks what the card asks for.
        """
        fields = decode_points(StoredCell.content(self), name)
        points = np.column_stack([fields.pop(axis) for axis in "xyz"])
        if self.lidar_id is not None:
            if LIDARS not in fields:
                raise DataError(name, field=LIDARS, expected="the lidar of each point", got="none")
            own = fields[LIDARS] == self.lidar_id
            points, fields = points[own], {key: values[own] for key, values in fields.items()}
        if not self.as_measured:
            fields.pop(TIMES, None)
        return sweep_of(
            points,
            fields,
            timestamp_ns,
            name=name,
            time_unit="us",
            time_hint=TIME_HINT,
        )


def decode_points(content: bytes, name: Path) -> dict[str, NDArray[Any]]:
    """Decode an Arrow stream of points, each coordinate and feature an array (N,).

    Args:
        content: the stream.
        name: for messages.

    Raises:
        DataError: none, or damaged.
    """
    if not content.startswith(ARROW_START):
        got = f"bytes that begin with {content[:8].hex(' ')}"
        raise DataError(name, expected="points as an Arrow stream", got=got, hint=CONVERT_HINT)
    try:
        with pa.ipc.open_stream(pa.BufferReader(content)) as stream:
            batch = stream.read_next_batch()
        batch.validate(full=True)
        if batch.nbytes > LARGEST_BYTES:
            raise ValueError(f"{batch.nbytes} bytes when unpacked")
        fields = {key: batch.column(key).to_numpy(zero_copy_only=False) for key in batch.schema.names}
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        raise DataError(name, expected="whole points", got=_in_one_line(error)) from error
    if missing := set("xyz") - fields.keys():
        raise DataError(name, expected="the coordinates x, y and z", got=f"no {', '.join(sorted(missing))}")
    return fields

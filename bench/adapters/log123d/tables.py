"""Tables of a 123D log: Arrow files with a head of MessagePack, of which single cells are read."""

from __future__ import annotations

from collections.abc import Iterator
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
from bench.recordings.validation import FileModel, validated

HEAD = b"metadata"
LARGEST_HEAD_BYTES = 1_000_000
LARGEST_CELL_BYTES = 1 << 28
LARGEST_BATCH_BYTES = 1 << 31  # of one column
READERS_HELD = 16
BATCHES_HELD = 4  # in a process, so that compressed images of a batch are not unpacked again for each of them
MICROSECOND_NS = 1_000

Head = TypeVar("Head", bound=FileModel)


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
        if packed is None or len(packed) > LARGEST_HEAD_BYTES:
            got = "none" if packed is None else f"one of {len(packed)} bytes"
            raise DataError(self.path, field="metadata", expected="the head of a table of a 123D log", got=got)
        try:
            content = msgpack.unpackb(packed, raw=False, strict_map_key=False)
        except (ValueError, TypeError, msgpack.exceptions.UnpackException) as error:
            got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise DataError(self.path, field="metadata", expected="MessagePack", got=got) from error
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

    def rows(self, name: str, *, width: int) -> NDArray[np.float64]:
        """(N, width) float64 of a column of lists of one length; NaN where the list is missing.

        Raises:
            DataError: lists of another length or of no numbers.
        """
        lists = self.column(name)
        try:
            values = np.full((len(lists), width), np.nan)
            present = lists.is_valid().to_numpy()
            numbers = lists.drop_null().combine_chunks().flatten().to_numpy(zero_copy_only=False).astype(np.float64)
            values[present] = numbers.reshape(-1, width)
        except (ValueError, TypeError, AttributeError) as error:
            raise self._wrong(name, f"lists of {width} numbers", str(lists.type)) from error
        return values

    def stores_text(self, name: str) -> bool:
        """True where the cells of a column are texts, such as paths."""
        with _reading(self.path):
            kind = _reader(*_state(self.path)).schema.field(self._index(name)).type
        return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))

    def cells(self, name: str) -> Iterator[StoredCell]:
        """The cells of a column, in order, none of them read.

        Raises:
            DataError: no such column, or the file is damaged.
        """
        with _reading(self.path):
            index = self._index(name)
        # The rows of a batch are known from the times, which are small.
        for batch, times_us in enumerate(self.column("timestamp_us").iterchunks()):
            for row in range(len(times_us)):
                yield StoredCell(container=self.path, batch=batch, column=index, row=row)

    def _index(self, name: str) -> int:
        schema = _reader(*_state(self.path)).schema
        index = schema.get_field_index(f"{self.key}.{name}")
        if index < 0:
            raise self._wrong(name, "a column of this name", f"columns {', '.join(schema.names)[:200]}")
        return int(index)

    def _wrong(self, name: str, expected: str, got: str) -> DataError:
        return DataError(self.path, field=f"{self.key}.{name}", expected=expected, got=got)


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

    def value(self) -> bytes | str | int:
        """Content of the cell: bytes, the path of a file, or the number of a frame in a video.

        Raises:
            DataError: nothing there, or it cannot be read.
        """
        with _reading(self.container):
            cell = _column(*_state(self.container), self.column, self.batch)[self.row]
            if not cell.is_valid:
                raise DataError(self.container, field=self._place, expected="data", got="none")
            if isinstance(cell, pa.BinaryScalar | pa.LargeBinaryScalar) and cell.as_buffer().size > LARGEST_CELL_BYTES:
                got = f"{cell.as_buffer().size} bytes"
                raise DataError(self.container, field=self._place, expected=f"at most {LARGEST_CELL_BYTES}", got=got)
            value: bytes | str | int = cell.as_py()
        return value

    def content(self) -> bytes:
        """All that decides what is read."""
        value = self.value()
        return value if isinstance(value, bytes) else repr(value).encode()

    @property
    def _place(self) -> str:
        return f"batch {self.batch}, row {self.row}"


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn errors of Arrow into one that names the file."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError, IndexError) as error:
        got = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(path, expected="an Arrow file of a 123D log", got=got) from error


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

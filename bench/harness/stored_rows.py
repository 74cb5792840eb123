"""The tables of a stored run, read some recordings at a time; a run may be larger than the memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from bench.errors import DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA
from bench.evaluation.row_source import BATCH_ROWS, count_words

HISTOGRAMS = frozenset({"likelihood_reference_px", "likelihood_outside_px"})
LATER_COLUMNS = HISTOGRAMS  # not in the first runs of version 1
RECORDING = "recording"
READ_ROWS = 8192  # at a time: a row of frames with its histograms takes 2 kB


class StoredRows:
    """A table of a run on disk.

    Args:
        file: Parquet.
        schema: that it is of; columns that came later are null where they are missing.

    Raises:
        DataError: missing, damaged, or without a column.
    """

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        self.file, self.schema = file, schema
        with self._readable():
            self._metadata = pq.read_metadata(file)
            self._held = frozenset(self._metadata.schema.to_arrow_schema().names)
        missing = [name for name in schema.names if name not in self._held | LATER_COLUMNS]
        if missing:
            raise DataError(file, field=missing[0], expected="this column of a run's table", got="none")
        self._groups: list[Mapping[str, int]] | None = None

    def __len__(self) -> int:
        return int(self._metadata.num_rows)

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        counted: dict[str, int] = {}
        for group in self._row_groups():
            for name, rows in group.items():
                counted[name] = counted.get(name, 0) + rows
        return counted

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column, sorted, each once."""
        return tuple(
            sorted({word for batch in self.batches([column]) for word in count_words(_chunked(batch[column]))})
        )

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """All rows of some recordings, in the order of the file; strings come as dictionaries."""
        expected = frozenset(recordings)
        groups = [number for number, held in enumerate(self._row_groups()) if not expected.isdisjoint(held)]
        whole = all(expected.issuperset(self._row_groups()[number]) for number in groups)
        needed = list(columns) if whole or RECORDING in columns else [*columns, RECORDING]
        names = pa.array(sorted(expected), pa.string())
        parts = []
        for batch in self._batches(needed, rows=READ_ROWS, row_groups=groups):
            kept = batch if whole else batch.filter(pc.is_in(_decoded(batch[RECORDING]), value_set=names))
            if len(kept):
                parts.append(kept.select(list(columns)))
        return pa.Table.from_batches(parts) if parts else self._empty(columns)

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """All rows, at most `rows` at a time, in the order of the file; strings come as dictionaries."""
        yield from self._batches(columns, rows=rows, row_groups=range(self._metadata.num_row_groups))

    def table(self, *, unread: frozenset[str] = frozenset()) -> pa.Table:
        """All of it, in memory; columns of `unread` are null."""
        columns = [name for name in self.schema.names if name not in unread]
        whole = pa.Table.from_batches(self.batches(columns), self._schema(columns))
        read = {name: whole[name].cast(self.schema.field(name).type) for name in columns}
        nulls = {name: pa.nulls(len(whole), self.schema.field(name).type) for name in unread}
        return pa.table([(read | nulls)[name] for name in self.schema.names], schema=self.schema)

    def _batches(self, columns: Sequence[str], *, rows: int, row_groups: Sequence[int]) -> Iterator[pa.RecordBatch]:
        schema = self._schema(columns)
        held = [name for name in columns if name in self._held]
        words = [field.name for field in self.schema if pa.types.is_string(field.type)]
        with (
            self._readable(),
            pq.ParquetFile(self.file, metadata=self._metadata, read_dictionary=words) as stored,
        ):
            if not row_groups:
                return
            for batch in stored.iter_batches(batch_size=rows, row_groups=list(row_groups), columns=held):
                yield pa.RecordBatch.from_arrays([_column(batch, field) for field in schema], schema=schema)

    def _row_groups(self) -> list[Mapping[str, int]]:
        """Rows of each recording, of each group of rows of the file."""
        if self._groups is None:
            self._groups = [self._recordings_of(number) for number in range(self._metadata.num_row_groups)]
        return self._groups

    def _recordings_of(self, number: int) -> Mapping[str, int]:
        group = self._metadata.row_group(number)
        place = self._metadata.schema.names.index(RECORDING)
        found = group.column(place).statistics
        # One recording, as its unit was written: nothing has to be read.
        if found is not None and found.has_min_max and found.min == found.max and found.null_count == 0:
            return {str(found.min): int(group.num_rows)}
        counted: dict[str, int] = {}
        for batch in self._batches([RECORDING], rows=BATCH_ROWS, row_groups=[number]):
            for name, rows in count_words(_chunked(batch[RECORDING])).items():
                counted[name] = counted.get(name, 0) + rows
        return counted

    def _schema(self, columns: Sequence[str]) -> pa.Schema:
        words = pa.dictionary(pa.int32(), pa.string())
        fields = [self.schema.field(name) for name in columns]
        return pa.schema([f.with_type(words) if pa.types.is_string(f.type) else f for f in fields])

    def _empty(self, columns: Sequence[str]) -> pa.Table:
        return self._schema(columns).empty_table()

    @contextmanager
    def _readable(self) -> Iterator[None]:
        try:
            yield
        except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
            got = " ".join(str(error).split())[:200]
            raise DataError(self.file, expected="a table of a run", got=got) from error


def open_tables(run: Path) -> tuple[StoredRows, StoredRows]:
    """The run's objects and frames, to be read a part at a time.

    Raises:
        DataError: missing, damaged, or without a column; damage further inside is met on reading.
    """
    return StoredRows(run / "objects.parquet", OBJECTS_SCHEMA), StoredRows(run / "frames.parquet", FRAMES_SCHEMA)


def _column(batch: pa.RecordBatch, field: pa.Field) -> pa.Array:
    if field.name not in batch.schema.names:
        return pa.nulls(len(batch), field.type)
    column = batch[field.name]
    return column if column.type == field.type else column.cast(field.type)


def _decoded(column: pa.Array) -> pa.Array:
    return column.dictionary_decode() if pa.types.is_dictionary(column.type) else column


def _chunked(column: pa.Array) -> pa.ChunkedArray:
    return pa.chunked_array([column])

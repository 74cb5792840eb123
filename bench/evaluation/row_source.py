"""The rows of a run, a few recordings in memory at a time, so that a run may be larger than the memory.

No figure needs rows of two recordings at once: all are ratios of sums by recording. So tables are read in parts of
whole recordings, each part is put into canonical order, and the sums of the parts lie beside each other. The order of
the rows and the size of the parts then change no bit of any sum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

ROWS_AT_ONCE = 400_000  # of the widest table about 100 MB
BATCH_ROWS = 65_536


class RowSource(Protocol):
    """A table of a run, wherever it lies."""

    @property
    def schema(self) -> pa.Schema:
        """Its columns."""
        ...

    def recordings(self) -> Mapping[str, int]:
        """Rows of each recording, by name."""
        ...

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column, sorted, each once."""
        ...

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """All rows of some recordings, in any order; strings may come as dictionaries."""
        ...

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """All rows, at most `rows` at a time, in any order; strings may come as dictionaries."""
        ...


Rows: TypeAlias = pa.Table | RowSource


class TableRows:
    """A table in memory.

    Args:
        table: with a column "recording".
    """

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    @property
    def schema(self) -> pa.Schema:
        """Its columns."""
        return self._table.schema

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        return count_words(self._table["recording"])

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column, sorted, each once."""
        return tuple(sorted(count_words(self._table[column])))

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """All rows of some recordings, in the order of the table."""
        expected = pc.is_in(self._table["recording"], value_set=pa.array(recordings, pa.string()))
        return self._table.select(list(columns)).filter(expected)

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """All rows, at most `rows` at a time, in the order of the table."""
        yield from self._table.select(list(columns)).to_batches(max_chunksize=rows)


def as_source(rows: Rows) -> RowSource:
    """A table in memory as a source; a source as it is."""
    return TableRows(rows) if isinstance(rows, pa.Table) else rows


class ChosenRows:
    """Those rows of a source that have a word in a column.

    Args:
        source: of all rows.
        column: of words.
        word: that is wanted.
    """

    def __init__(self, source: RowSource, *, column: str, word: str) -> None:
        self._source, self._column, self._word = source, column, word

    @property
    def schema(self) -> pa.Schema:
        """Its columns."""
        return self._source.schema

    def recordings(self) -> Mapping[str, int]:
        """Most rows that each recording can have, by name."""
        return self._source.recordings()

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column, sorted, each once."""
        batches = self.batches([column])
        return tuple(sorted({word for batch in batches for word in count_words(pa.chunked_array([batch[column]]))}))

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """The chosen rows of some recordings."""
        table = self._source.read(recordings, self._with_column(columns))
        return table.filter(self._chosen(table[self._column])).select(list(columns))

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """The chosen rows, at most `rows` at a time."""
        for batch in self._source.batches(self._with_column(columns), rows=rows):
            yield batch.filter(self._chosen(batch[self._column])).select(list(columns))

    def _with_column(self, columns: Sequence[str]) -> list[str]:
        return [*columns] if self._column in columns else [*columns, self._column]

    def _chosen(self, column: pa.Array | pa.ChunkedArray) -> pa.Array | pa.ChunkedArray:
        words = column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
        return pc.fill_null(pc.equal(words, self._word), False)


def group_recordings(counts: Mapping[str, int], *, rows_at_once: int | None = None) -> list[tuple[str, ...]]:
    """Recordings in sorted order, so many together that their rows fit; one with more rows stands alone."""
    most = rows_at_once or ROWS_AT_ONCE
    groups: list[list[str]] = []
    held = 0
    for name in sorted(counts):
        if not groups or held + counts[name] > most:
            groups.append([])
            held = 0
        groups[-1].append(name)
        held += counts[name]
    return [tuple(group) for group in groups]


def read_parts(source: RowSource, columns: Sequence[str], *, rows_at_once: int | None = None) -> Iterator[pa.Table]:
    """Whole recordings in sorted order, so many at a time as fit.

    Args:
        source: of the rows.
        columns: to read.
        rows_at_once: most rows of a part of several recordings; `ROWS_AT_ONCE` without it.
    """
    for group in group_recordings(source.recordings(), rows_at_once=rows_at_once):
        yield source.read(group, columns)


def count_words(column: pa.ChunkedArray) -> dict[str, int]:
    """How often each word of a column is there."""
    counted: dict[str, int] = {}
    for chunk in column.chunks:
        codes = chunk if pa.types.is_dictionary(chunk.type) else chunk.dictionary_encode()
        known = codes.indices.drop_null().to_numpy(zero_copy_only=False)
        numbers = np.bincount(known, minlength=len(codes.dictionary)).tolist()
        for word, number in zip(codes.dictionary.to_pylist(), numbers, strict=True):
            if number:
                counted[word] = counted.get(word, 0) + number
    return counted

"""The rows of a run, a few recordings in memory at a time, so that a run may be larger than the memory.

No metric needs rows of two recordings at once: all are ratios of sums by recording. So tables are read in parts of
whole recordings, each part is put into canonical order, and the sums of the parts lie beside each other. The order of
the rows and the size of the parts then change no bit of any sum.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. What
compares then are the images that all runs scored: `CommonImages`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

ROWS_AT_ONCE = 400_000  # of the widest table about 100 MB
BATCH_ROWS = 65_536
IMAGE = ["recording", "camera", "timestamp_ns"]


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


Codes = NDArray[np.int64]


class Columns:
    """Some rows of a table.

    Words are turned to numbers once, since comparing and sorting strings would take most of the time.

    Args:
        table: of `OBJECTS_SCHEMA` or `FRAMES_SCHEMA`, or some columns of one; strings may be dictionaries.
    """

    def __init__(self, table: pa.Table) -> None:
        self._table = table
        self._words: dict[str, tuple[Codes, tuple[str, ...]]] = {}

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def words(self, name: str) -> tuple[Codes, tuple[str, ...]]:
        """A column of words.

        Returns:
            codes: (N,) int64, number of each row's word; -1 where null.
            words: that are there, sorted, so that codes compare as the words do.
        """
        if name not in self._words:
            self._words[name] = _encode(self._table[name])
        return self._words[name]

    def is_word(self, name: str, word: str) -> NDArray[np.bool_]:
        """(N,) bool, where a column of words has this one."""
        codes, words = self.words(name)
        return codes == words.index(word) if word in words else np.zeros(len(self), dtype=bool)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A numeric column: (N,) float64, NaN where null."""
        values = self._table[name].to_numpy()
        return np.asarray(values, dtype=np.float64)

    def integers(self, name: str) -> NDArray[np.int64]:
        """A column of whole numbers without nulls: (N,) int64."""
        return np.asarray(self._table[name].to_numpy(), dtype=np.int64)

    def pairs(self, name: str) -> tuple[NDArray[np.int64], pa.StringArray, NDArray[np.int64]]:
        """A column of maps from words to whole numbers, one entry a line.

        Returns:
            rows: (M,) int64, row of each entry.
            keys: M words.
            values: (M,) int64.
        """
        column = self._table[name].combine_chunks()
        offsets = column.offsets.to_numpy()
        rows = np.repeat(np.arange(len(column)), np.diff(offsets))
        first, last = (int(offsets[0]), int(offsets[-1])) if len(offsets) else (0, 0)
        entries = column.keys[first:last], column.items[first:last]
        return rows, entries[0], entries[1].to_numpy(zero_copy_only=False)

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Columns:
        """Some of the rows, by number or by flag."""
        numbers = np.flatnonzero(rows) if rows.dtype == bool else rows
        taken = Columns(self._table.take(pa.array(numbers)))
        # Words that nobody uses any more keep their numbers: codes stay comparable to those of all rows.
        taken._words = {name: (codes[numbers], words) for name, (codes, words) in self._words.items()}
        return taken

    def canonical(self, key: Sequence[str]) -> Columns:
        """The rows sorted by a key that names each once."""
        values = [self.words(name)[0] if _is_words(self._table[name].type) else self.integers(name) for name in key]
        order = np.lexsort(values[::-1])
        same = np.ones(max(len(self) - 1, 0), dtype=bool)
        for value in values:
            sorted_values = value[order]
            same &= sorted_values[1:] == sorted_values[:-1]
        assert not same.any(), f"{list(key)} names each row once"
        return self if np.array_equal(order, np.arange(len(self))) else self.take(order)

    @property
    def table(self) -> pa.Table:
        """The rows as a table."""
        return self._table


def _is_words(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_dictionary(kind))


def _encode(column: pa.ChunkedArray) -> tuple[Codes, tuple[str, ...]]:
    encoded = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
    if encoded.num_chunks == 0:
        return np.empty(0, dtype=np.int64), ()
    whole = encoded.unify_dictionaries().combine_chunks()
    codes = whole.indices.fill_null(-1).to_numpy(zero_copy_only=False).astype(np.int64)
    found = whole.dictionary.to_pylist()
    used = np.zeros(len(found) + 1, dtype=bool)
    used[codes] = True  # null, -1, is the last
    words = sorted({word for word, there in zip(found, used[:-1].tolist(), strict=True) if there})
    numbers = {word: number for number, word in enumerate(words)}
    rank = np.array([*(numbers.get(word, -1) for word in found), -1], dtype=np.int64)
    return rank[codes], tuple(words)


class CommonImages:
    """The images that all of several runs scored.

    Args:
        frames: of each run, of `FRAMES_SCHEMA`.
    """

    def __init__(self, frames: Sequence[RowSource]) -> None:
        self._scored = [ChosenRows(rows, column="status", word="evaluated") for rows in frames]

    def recordings(self) -> dict[str, int]:
        """Most images that each recording of all runs can have, by name."""
        first, *others = (rows.recordings() for rows in self._scored)
        return {name: count for name, count in first.items() if all(name in other for other in others)}

    def of(self, recordings: Sequence[str]) -> pa.Table:
        """The images of some recordings: columns `IMAGE`."""
        first, *others = (_images(rows.read(recordings, IMAGE)) for rows in self._scored)
        for other in others:
            first = first.join(other, keys=IMAGE, join_type="left semi", use_threads=False)
        return first

    def count(self) -> int:
        """How many there are."""
        return sum(len(self.of(group)) for group in group_recordings(self.recordings()))


class RowsOnImages:
    """Those rows of a run that are of some images.

    Args:
        source: of all rows.
        images: that are wanted.
    """

    def __init__(self, source: RowSource, images: CommonImages) -> None:
        self._source, self._images = source, images

    @property
    def schema(self) -> pa.Schema:
        """Its columns."""
        return self._source.schema

    def recordings(self) -> dict[str, int]:
        """Most rows that each recording can have, by name."""
        common = self._images.recordings()
        return {name: count for name, count in self._source.recordings().items() if name in common}

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column of all rows, sorted, each once."""
        return self._source.distinct(column)

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """The rows of some recordings."""
        table = self._source.read(recordings, list(dict.fromkeys([*columns, *IMAGE])))
        numbered = _images(table).append_column("row", pa.array(np.arange(len(table))))
        images = self._images.of(recordings)
        common = numbered.join(images, keys=IMAGE, join_type="left semi", use_threads=False)
        return table.take(pa.array(np.sort(common["row"].to_numpy()))).select(list(columns))

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """The rows, at most `rows` at a time."""
        for part in read_parts(self, columns):
            yield from part.to_batches(max_chunksize=rows)


def _images(table: pa.Table) -> pa.Table:
    """The columns of the key, with words as strings, which tables of other dictionaries share."""
    kinds = pa.schema([("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())])
    return table.select(IMAGE).cast(kinds)

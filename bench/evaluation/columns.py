"""Rows as arrays: words by their number, numbers as floats, in canonical order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

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
    place = {word: number for number, word in enumerate(words)}
    rank = np.array([*(place.get(word, -1) for word in found), -1], dtype=np.int64)
    return rank[codes], tuple(words)

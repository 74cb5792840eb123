"""The rows of a run as arrays, the slices that they are cut into, and the images that several runs have in common.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. What
compares then are the images that all runs scored. Like everything else they are read some recordings at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import BATCH_ROWS, ChosenRows, RowSource, group_recordings, read_parts

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


def bin_names(edges: tuple[float, ...]) -> tuple[str, ...]:
    """Names of the bins, for example "[0, 2)", "[2, 4)", "[4, inf)" of the edges 0, 2, 4."""
    return tuple(f"[{low:g}, {high:g})" for low, high in pairwise((*edges, np.inf)))


def number_bins(values: NDArray[np.float64], *, edges: tuple[float, ...]) -> NDArray[np.int64]:
    """The bin of each value.

    Args:
        values: (N,) float64.
        edges: increasing.

    Returns:
        (N,) int64, place in `bin_names(edges)`; -1 for NaN and below the first edge.
    """
    # A value on an edge belongs to the bin that starts there; NaN would be sorted behind all.
    index = np.searchsorted(np.array(edges), values, side="right") - 1
    return np.where(np.isnan(values), -1, index)


def name_bins(values: NDArray[np.float64], *, edges: tuple[float, ...]) -> NDArray[np.object_]:
    """The bin of each value.

    Args:
        values: (N,) float64.
        edges: increasing.

    Returns:
        (N,) names of `bin_names(edges)`; "" for NaN and below the first edge.
    """
    names = np.array(["", *bin_names(edges)], dtype=object)
    return names[number_bins(values, edges=edges) + 1]


IMAGE = ["recording", "camera", "timestamp_ns"]
ALL_MOVING = "all_moving"
FRAMES = "frames"
CATEGORY = "category"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Rows cut into slices.

    Attributes:
        names: of the slices.
        of_row: (N,) int64, place of each row's slice in `names`; -1 for a number that is unknown or below all bins.
    """

    names: tuple[str, ...]
    of_row: NDArray[np.int64]


def object_splits(evaluated: Columns, *, protocol: Protocol, cameras: Sequence[str]) -> dict[str, Split]:
    """The splits of evaluated object-frames by name: "category", "all_moving", then the breakdowns."""
    return {
        CATEGORY: _worded(evaluated, "category", [str(name) for name in protocol.reference.categories]),
        ALL_MOVING: _undivided(evaluated, ALL_MOVING),
        "object_class": _worded(evaluated, "object_class", protocol.reference.classes),
        "range_m": _binned(evaluated, "range_m", protocol.bins.range_m),
        "ego_speed_mps": _binned(evaluated, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": _worded(evaluated, "camera", cameras),
        "points": _binned(evaluated, "points", protocol.bins.points),
    }


def frame_splits(scored: Columns, *, protocol: Protocol, cameras: Sequence[str]) -> dict[str, Split]:
    """The splits of scored image-frames by name: "frames", then the breakdowns."""
    return {
        FRAMES: _undivided(scored, FRAMES),
        "ego_speed_mps": _binned(scored, "ego_speed_mps", protocol.bins.ego_speed_mps),
        "camera": _worded(scored, "camera", cameras),
    }


def slice_name(split: str, name: str) -> str:
    """What a slice is called among all: "crossing", "all_moving", "range_m=[0, 2)"."""
    return name if split in {CATEGORY, ALL_MOVING, FRAMES} else f"{split}={name}"


def _undivided(rows: Columns, name: str) -> Split:
    return Split(names=(name,), of_row=np.zeros(len(rows), dtype=np.int64))


def _worded(rows: Columns, column: str, names: Sequence[str]) -> Split:
    codes, words = rows.words(column)
    place = np.array([*(names.index(word) if word in names else -1 for word in words), -1], dtype=np.int64)
    of_row = place[codes]
    assert (of_row >= 0).all(), f"every row has one {column} of {list(names)}"
    return Split(names=tuple(names), of_row=of_row)


def _binned(rows: Columns, column: str, edges: tuple[float, ...]) -> Split:
    return Split(names=bin_names(edges), of_row=number_bins(rows.numbers(column), edges=edges))


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
        kept = numbered.join(images, keys=IMAGE, join_type="left semi", use_threads=False)
        return table.take(pa.array(np.sort(kept["row"].to_numpy()))).select(list(columns))

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """The rows, at most `rows` at a time."""
        for part in read_parts(self, columns):
            yield from part.to_batches(max_chunksize=rows)


def _images(table: pa.Table) -> pa.Table:
    """The columns of the key, with words as strings, which tables of other dictionaries share."""
    kinds = pa.schema([("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())])
    return table.select(IMAGE).cast(kinds)

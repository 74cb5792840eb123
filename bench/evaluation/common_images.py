"""The images that several runs scored, and the rows of a run on these.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. What
compares then are the images that all runs scored. Like everything else they are read some recordings at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa

from bench.evaluation.row_source import BATCH_ROWS, ChosenRows, RowSource, group_recordings, read_parts
from bench.evaluation.slices import IMAGE


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

"""Counts as files: answers against a reference, counted by a protocol; and the counts of a whole run as tables.

```
<run>/<protocol>/counts/<recording>/<camera>-<first image>.objects.parquet   rows of `OBJECTS_SCHEMA`
<run>/<protocol>/counts/<recording>/<camera>-<first image>.frames.parquet    rows of `FRAMES_SCHEMA`; written last
```
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from bench.atomic import open_regular
from bench.errors import BenchError, DataError
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import FRAMES_SCHEMA, IMAGE, OBJECT, OBJECTS_SCHEMA, to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.harness.answers import FAILED, Answer, is_answered, name_of, read_table, segmentation_of, write_table
from bench.harness.exact import read_exact_mask
from bench.harness.references import StoredReference, message_without_root, reference_of
from bench.recordings import ImageRef, Recording

COUNTS = "counts"
OBJECTS, FRAMES = ".objects.parquet", ".frames.parquet"
REMOVE = "remove the file, and run again"


def count_answers(
    recording: Recording,
    images: Sequence[ImageRef],
    *,
    answers: Sequence[Answer],
    references: Sequence[StoredReference],
    protocol: Protocol,
) -> tuple[pa.Table, pa.Table]:
    """Count the answers of a task. An image that cannot be used is reported; the others go on.

    Args:
        recording: the drive.
        images: of one camera, in time order.
        answers: of each image.
        references: of each image.
        protocol: the rules.

    Returns:
        objects: rows of `OBJECTS_SCHEMA`.
        frames: rows of `FRAMES_SCHEMA`, one for each image.
    """
    scorer = SequenceScorer(protocol)
    for image, answer, row in zip(images, answers, references, strict=True):
        status, problem = answer["status"], answer["problem"]
        if is_answered(answer):
            try:
                frame = reference_of(row, recording.name)
                scorer.add(frame, segmentation_of(answer), exact=read_exact_mask(image, recording, frame))
                continue
            except BenchError as error:
                status, problem = FAILED, message_without_root(error, recording)
        scorer.leave_out(**{name: answer[name] for name in IMAGE}, status=status, problem=problem)
    return scorer.finish()


def write_counts(results: Path, place: str, objects: pa.Table, frames: pa.Table) -> None:
    """Write the counts of a task, each file by one rename, the one that says that all are there last.

    Args:
        results: folder of the run's protocol.
        place: of the task's files.
        objects: rows of `OBJECTS_SCHEMA`.
        frames: rows of `FRAMES_SCHEMA`.

    Raises:
        OutputError: the disk is full, or may not be written.
    """
    for suffix, table in ((OBJECTS, objects), (FRAMES, frames)):
        write_table(results / COUNTS / f"{place}{suffix}", table)


def counts_mark(results: Path, place: str) -> Path:
    """The file that says that the counts of a task are there; without it they are made again.

    Args:
        results: folder of the run's protocol.
        place: of the task's files.
    """
    return results / COUNTS / f"{place}{FRAMES}"


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

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        return self._rows

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, in the order of the files."""
        return to_frame(self.table(columns, recordings))

    def table(self, columns: Sequence[str], recordings: Sequence[str] | None = None) -> pa.Table:
        """Some columns of some recordings, or of all of it, in memory."""
        chosen = [*self._files] if recordings is None else recordings
        schema = pa.schema([self._schema.field(name) for name in columns])
        tables = [schema.empty_table()]
        for file in [file for name in chosen for file in self._files.get(name, ())]:
            with _readable(file):
                tables.append(read_table(file, columns=list(columns)).cast(schema))
        rows = pa.concat_tables(tables)
        if set(self._key) <= set(columns) and rows.group_by(self._key).aggregate([]).num_rows < len(rows):
            where = f"recordings {', '.join(chosen)}"
            raise DataError(where, field=", ".join(self._key), expected="each row once", got="one twice", hint=REMOVE)
        return rows

    def _length(self, file: Path) -> int:
        with _readable(file), open_regular(file) as content:
            return int(pq.read_metadata(content).num_rows)


def open_tables(folder: Path) -> tuple[StoredRows, StoredRows]:
    """The run's objects and frames, to be read a part at a time.

    Args:
        folder: of the run's protocol.

    Raises:
        DataError: missing, damaged, or without a column; damage further inside is met on reading.
    """
    counts = folder / COUNTS
    return StoredRows(counts, OBJECTS, OBJECTS_SCHEMA), StoredRows(counts, FRAMES, FRAMES_SCHEMA)


@contextmanager
def _readable(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, pa.ArrowException) as error:  # ValueError: null where none may be
        got = " ".join(str(error).split())[:200]
        raise DataError(file, expected="counts of a run", got=got, hint=REMOVE) from error

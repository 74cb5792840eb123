"""Counts as files: answers against a reference, counted by a protocol; and the counts of a whole run as tables.

```
<run>/<protocol>/counts/<recording>/<camera>-<first image>.objects.parquet   rows of `OBJECTS_SCHEMA`
<run>/<protocol>/counts/<recording>/<camera>-<first image>.frames.parquet    rows of `FRAMES_SCHEMA`; written last
```
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import pandas as pd
import pyarrow as pa

from bench.errors import BenchError, DataError
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import COLUMNS_OF_FRAMES, FRAMES_SCHEMA, IMAGE, OBJECT, OBJECTS_SCHEMA, to_frame
from bench.evaluation.scorer import SequenceScorer
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
from bench.harness.exact import read_exact_mask
from bench.harness.references import StoredReference, message_without_root, reference_of
from bench.recordings import ImageRef, Recording

COUNTS = "counts"
OBJECTS, FRAMES = ".objects.parquet", ".frames.parquet"
TableName = Literal["objects", "frames"]
TABLES = {"objects": (OBJECTS_SCHEMA, OBJECT), "frames": (FRAMES_SCHEMA, IMAGE)}  # and the key of a row
COLUMNS = {"objects": OBJECTS_SCHEMA.names, "frames": COLUMNS_OF_FRAMES}  # that are read unless others are named
ROWS_AT_ONCE = 100_000  # in memory, or one recording
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


def read_counts(results: Path, table: TableName, recording: str, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read the counts of a recording. Files must be of the schema and hold each row once; `verify` tells the rest.

    Args:
        results: folder of the run's protocol.
        table: which.
        recording: name; no rows of one that is not there.
        columns: of the table; None for `COLUMNS`.

    Raises:
        DataError: damaged, or without a column.
    """
    whole, key = TABLES[table]
    schema = pa.schema([whole.field(name) for name in (COLUMNS[table] if columns is None else columns)])
    tables = [schema.empty_table()]
    for file in sorted((results / COUNTS / safe_name(recording)).glob(f"*.{table}.parquet")):
        try:
            tables.append(read_table(file, columns=schema.names).cast(schema))
        except (OSError, ValueError, pa.ArrowException) as error:  # ValueError: null where none may be
            got = " ".join(str(error).split())[:200]
            raise DataError(file, expected="counts of a run", got=got, hint=REMOVE) from error
    rows = to_frame(pa.concat_tables(tables))
    if set(key) <= set(schema.names) and rows.duplicated(key).any():
        expected, got = "each row once", "one twice"
        raise DataError(f"recording {recording}", field=", ".join(key), expected=expected, got=got, hint=REMOVE)
    return rows


def stored_recordings(results: Path) -> list[str]:
    """Names of the recordings of which there are counts, sorted.

    Raises:
        DataError: there are none.
    """
    names = {name_of(file.parent.name) for file in (results / COUNTS).glob(f"*/*{FRAMES}")}
    if not names:
        expected = f"counts of a run (<recording>/*{FRAMES})"
        raise DataError(results / COUNTS, expected=expected, got="none", hint="run again")
    return sorted(names)


def read_parts(
    results: Path, table: TableName, columns: Sequence[str] | None = None, *, rows_at_once: int | None = None
) -> Iterator[pd.DataFrame]:
    """Read counts, so many whole recordings at a time that a run may be larger than the memory.

    Args:
        results: folder of the run's protocol.
        table: which.
        columns: of it; None for `COLUMNS`.
        rows_at_once: from which on a part is full; `ROWS_AT_ONCE` without it.

    Raises:
        DataError: as `read_counts`, or there are none.
    """
    held: list[pd.DataFrame] = []
    for name in (names := stored_recordings(results)):
        held.append(read_counts(results, table, name, columns))
        if name == names[-1] or sum(map(len, held)) >= (rows_at_once or ROWS_AT_ONCE):
            yield pd.concat(held, ignore_index=True)
            held.clear()

"""Parquet files of runs and of the cache. pyarrow gets open files: by name it waits for pipes and asks for UTF-8."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bench.atomic import open_regular, replacing


def write_table(file: Path, table: pa.Table, *, rows_at_once: int | None = None) -> None:
    """Write a whole table.

    Args:
        file: to write.
        table: the rows.
        rows_at_once: that a reader of some of them unpacks together; None for all.

    Raises:
        OutputError: the disk is full, or may not be written.
    """
    with replacing(file) as temporary, temporary.open("wb") as out:
        pq.write_table(table, out, compression="zstd", row_group_size=rows_at_once)


def read_table(file: Path, **chosen: Any) -> pa.Table:
    """Read a table, or the columns, rows or schema of it that `pyarrow.parquet.read_table` is asked for.

    Raises:
        OSError: it cannot be opened, or is no regular file.
        ArrowException: it is no such table.
    """
    with open_regular(file) as content:
        return pq.read_table(content, use_threads=False, **chosen)

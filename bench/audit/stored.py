"""The files of an audit.

```
<audit>/audit.json                 the figures
<audit>/polygons.parquet           one row per object-frame, kind of polygon and compensation
<audit>/scores.parquet             one row per object-frame and scoring, integer counts
<audit>/misses.parquet             one row per object-frame: cells of its exact mask by cause
<audit>/false_alarms.parquet       one row per image: static cells by cause
```
"""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from bench.audit.figures import AuditSummary
from bench.audit.recording import RecordingAudit
from bench.errors import DataError
from bench.recordings import replacing
from bench.recordings.sealed_json import read_sealed, write_sealed

SCHEMA_VERSION = 1
AUDIT, POLYGONS, MISSES = "audit.json", "polygons.parquet", "misses.parquet"


def write_audit(folder: Path, summary: AuditSummary, audit: RecordingAudit) -> None:
    """Write every file of an audit, the figures last."""
    tables = {
        POLYGONS: audit.polygons,
        "scores.parquet": _with_scoring(audit),
        MISSES: audit.misses,
        "false_alarms.parquet": audit.false_alarms,
    }
    for name, table in tables.items():
        with replacing(folder / name) as temporary:
            pq.write_table(table, temporary, compression="zstd")
    write_sealed(folder / AUDIT, summary)


def read_audit(folder: Path) -> AuditSummary:
    """Read `audit.json`.

    Raises:
        DataError: missing, or not an audit of a known version; names the field.
    """
    return read_sealed(AuditSummary, folder / AUDIT, expected="the figures of an audit")


def read_polygons(folder: Path) -> pa.Table:
    """Read the rows of `POLYGONS_SCHEMA`.

    Raises:
        DataError: missing or damaged.
    """
    return _read_table(folder / POLYGONS)


def read_misses(folder: Path) -> pa.Table:
    """Read the rows of `MISSES_SCHEMA`.

    Raises:
        DataError: missing or damaged.
    """
    return _read_table(folder / MISSES)


def _read_table(file: Path) -> pa.Table:
    try:
        return pq.read_table(file)
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        got = " ".join(str(error).split())[:200]
        raise DataError(file, expected="a table of an audit", got=got) from error


def _with_scoring(audit: RecordingAudit) -> pa.Table:
    return pa.concat_tables(
        objects.add_column(0, "scoring", pa.array([name] * len(objects), pa.string()))
        for name, (objects, _) in audit.scores.items()
    )

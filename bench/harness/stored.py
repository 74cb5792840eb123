"""The files of a run: written once, atomically; everything above reads only these.

```
<run>/units/<recording>-<camera>-<start>.{objects,frames}.parquet and .json    a unit's rows and its status
<run>/objects.parquet, frames.parquet, summary.json                            the whole run
<run>/protocol.json                                                            the rules that it was scored by
```
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import DataError
from bench.evaluation import FRAMES_SCHEMA, OBJECTS_SCHEMA, Protocol, Summary, load_protocol
from bench.harness.provenance import Provenance
from bench.harness.unit import UnitTables
from bench.harness.units import Unit
from bench.recordings import replacing, write_text

SCHEMA_VERSION = 1

# What the reference alone decides, in whole numbers and words: no floats, whose text could differ between versions.
REFERENCE_OF_OBJECTS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px"),
)
REFERENCE_OF_FRAMES = ("recording", "camera", "timestamp_ns", "status", "valid_px", "reference_px", "ignored_px")


class MethodStamp(BaseModel):
    """Which method made the figures.

    Attributes:
        name: as the registry knows it.
        settings: every parameter.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]


class RunSummary(Summary):
    """`summary.json`: the figures, and what they are of.

    Attributes:
        schema_version: of this file.
        dataset: name of the data set.
        card: file of the data set's card, as it was named.
        reference_fingerprint: SHA-256 over what the reference alone decides; runs of different ones do not compare.
        split: of the data set; None for all of it.
        method: that was scored.
        provenance: where the result comes from.
        vehicle_outline_m: the host from above, vehicle frame, for pictures.
        failures: one line per recording, unit or image that could not be used; the figures are of the rest.
    """

    schema_version: int
    dataset: str
    card: str
    reference_fingerprint: str
    split: str | None
    method: MethodStamp
    provenance: Provenance
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failures: tuple[str, ...]


def unit_stem(unit: Unit) -> str:
    """File name of a unit: readable, safe on any file system, and never that of another unit."""
    readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", f"{unit.recording}-{unit.camera}")[:80]
    tag = hashlib.sha256(f"{unit.recording}\0{unit.camera}".encode()).hexdigest()[:8]
    return f"{readable}-{tag}-{unit.start:08d}"


def write_unit(run: Path, unit: Unit, tables: UnitTables) -> None:
    """Store a unit's rows, the status file last."""
    stem = unit_stem(unit)
    for name, table in (("objects", tables.objects), ("frames", tables.frames)):
        with replacing(run / "units" / f"{stem}.{name}.parquet") as temporary:
            pq.write_table(table, temporary, compression="zstd")
    status = {"unit": {name: getattr(unit, name) for name in unit.__slots__}, "problems": list(tables.problems)}
    write_text(run / "units" / f"{stem}.json", json.dumps(status, indent=1) + "\n")


def join_units(run: Path, units: Sequence[Unit]) -> None:
    """Write `objects.parquet` and `frames.parquet` from the units, one unit in memory at a time."""
    stems = sorted(unit_stem(unit) for unit in units)
    for name, schema in (("objects", OBJECTS_SCHEMA), ("frames", FRAMES_SCHEMA)):
        with replacing(run / f"{name}.parquet") as temporary:
            _concatenate([run / "units" / f"{stem}.{name}.parquet" for stem in stems], schema, temporary)


def read_tables(run: Path) -> tuple[pa.Table, pa.Table]:
    """The run's objects and frames.

    Raises:
        DataError: missing or damaged.
    """
    return _read_table(run / "objects.parquet"), _read_table(run / "frames.parquet")


def write_protocol(run: Path, protocol: Protocol) -> None:
    """Write `protocol.json`, so that a run can be read without the file that its rules came from."""
    write_text(run / "protocol.json", protocol.model_dump_json(indent=1, exclude_unset=True) + "\n")


def read_protocol(run: Path) -> Protocol:
    """The rules of a run.

    Raises:
        DataError: missing or not a protocol.
    """
    if not (run / "protocol.json").is_file():
        raise DataError(run / "protocol.json", wanted="the protocol of a run", came="no such file")
    return load_protocol(run / "protocol.json")  # JSON is YAML


def reference_fingerprint(objects: pa.Table, frames: pa.Table) -> str:
    """SHA-256 over the columns that the method has no part in."""
    digest = hashlib.sha256()
    for table, columns in ((objects, REFERENCE_OF_OBJECTS), (frames, REFERENCE_OF_FRAMES)):
        order = [(name, "ascending") for name in columns[:4] if name in table.column_names]
        text = io.BytesIO()
        pyarrow.csv.write_csv(table.select(list(columns)).sort_by(order), text)
        digest.update(text.getvalue())
    return digest.hexdigest()


def write_summary(run: Path, summary: RunSummary) -> None:
    """Write `summary.json`; NaN becomes null."""
    write_text(run / "summary.json", summary.model_dump_json(indent=1) + "\n")


def read_run(run: Path) -> RunSummary:
    """Read `summary.json`.

    Raises:
        DataError: missing, or not a summary of a known version; names the field.
    """
    file = run / "summary.json"
    try:
        text = file.read_text("utf-8")
    except OSError as error:
        raise DataError(file, wanted="the summary of a run", came=error.strerror or str(error)) from error
    try:
        return RunSummary.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"]) or None
        raise DataError(file, field=field, wanted="a summary", came=first["msg"]) from error


def _concatenate(files: Sequence[Path], schema: pa.Schema, out: Path) -> None:
    with pq.ParquetWriter(out, schema, compression="zstd") as writer:
        for file in files:
            writer.write_table(pq.read_table(file, schema=schema))


def _read_table(file: Path) -> pa.Table:
    try:
        return pq.read_table(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise DataError(file, wanted="a table of a run", came=" ".join(str(error).split())[:200]) from error

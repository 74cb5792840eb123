"""The files of a run: written once, atomically; everything above reads only these.

```
<run>/units/<recording>-<camera>-<start>.{objects,frames}.parquet, .maps.npz, .json    a unit's counts and its status
<run>/objects.parquet, frames.parquet, image_maps.npz, summary.json                    the whole run
<run>/protocol.json                                                                    the rules that it was scored by
```

Runs of older versions are read for ever: columns that came later are null in them, files that came later are missed by
name.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from pydantic import BaseModel, ConfigDict, ValidationError

from bench.errors import DataError
from bench.evaluation import (
    FRAMES_SCHEMA,
    OBJECTS_SCHEMA,
    ImageMap,
    Protocol,
    Summary,
    ThresholdFreeFigures,
    add_image_maps,
    load_protocol,
    threshold_free_figures,
)
from bench.evaluation.threshold_free import COLUMNS as THRESHOLD_FREE_COLUMNS
from bench.harness.map_files import load_image_maps, write_image_maps
from bench.harness.provenance import Provenance
from bench.harness.unit import UnitTables
from bench.harness.units import Unit
from bench.methods import Method, build_method, known_methods
from bench.recordings import replacing, write_text

SCHEMA_VERSION = 1
BATCH_IMAGES = 512
IMAGE_MAPS = "image_maps.npz"
PREDICTIONS = "predictions.json"  # of runs of predictions from disk
HISTOGRAMS = frozenset({"likelihood_reference_px", "likelihood_outside_px"})
LATER_COLUMNS = HISTOGRAMS  # not in the first runs of version 1

# What the reference alone decides, in whole numbers and words: no floats, whose text could differ between versions.
REFERENCE_OF_OBJECTS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px"),
)
REFERENCE_OF_FRAMES = ("recording", "camera", "timestamp_ns", "status", "valid_px", "reference_px", "ignored_px")


class MethodStamp(BaseModel):
    """Which method made the figures.

    Attributes:
        name: its own.
        settings: every parameter.
        place: "module:Class", by which a method is found that no registry knows; None in runs of older versions.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    settings: dict[str, object]
    place: str | None = None

    @classmethod
    def of(cls, method: Method) -> MethodStamp:
        """The stamp of a method."""
        kind = type(method)
        return cls(name=method.name, settings=method.settings(), place=f"{kind.__module__}:{kind.__qualname__}")

    @property
    def called(self) -> str:
        """What `--method` takes for it."""
        return self.name if self.place in {None, known_methods().get(self.name)} else str(self.place)

    def build(self) -> Method:
        """The method again, to look at single frames.

        Raises:
            UnknownNameError: neither the registry nor the place knows it.
            UsageError: it does not take its own settings.
        """
        return build_method(self.called, self.settings)


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
        caveats: what a reader has to know of the data set, from its card.
        failures: one line per recording, unit or image that could not be used; the figures are of the rest.
        threshold_free: what the method's likelihood is worth at all thresholds; None for a method without one and in
            runs of older versions.
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
    caveats: str = ""
    threshold_free: ThresholdFreeFigures | None = None


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
    if tables.image_map is not None:
        write_image_maps(run / "units" / f"{stem}.maps.npz", [tables.image_map])
    status = {"unit": {name: getattr(unit, name) for name in unit.__slots__}, "problems": list(tables.problems)}
    write_text(run / "units" / f"{stem}.json", json.dumps(status, indent=1) + "\n")


def join_units(run: Path, units: Sequence[Unit]) -> None:
    """Write `objects.parquet`, `frames.parquet` and `image_maps.npz` from the units, one unit in memory at a time."""
    stems = sorted(unit_stem(unit) for unit in units)
    for name, schema in (("objects", OBJECTS_SCHEMA), ("frames", FRAMES_SCHEMA)):
        with replacing(run / f"{name}.parquet") as temporary:
            _concatenate([run / "units" / f"{stem}.{name}.parquet" for stem in stems], schema, temporary)
    maps: tuple[ImageMap, ...] = ()
    for stem in stems:
        file = run / "units" / f"{stem}.maps.npz"
        if file.exists():  # a unit without a scored image has none
            maps = add_image_maps([*maps, *load_image_maps(file)])
    write_image_maps(run / IMAGE_MAPS, maps)


def read_tables(run: Path, *, histograms: bool = True) -> tuple[pa.Table, pa.Table]:
    """The run's objects and frames.

    Args:
        run: folder.
        histograms: whether to read those over the likelihood, which take ten times the rest of a frame's row; they
            are null otherwise.

    Raises:
        DataError: missing or damaged.
    """
    unread = frozenset() if histograms else HISTOGRAMS
    objects = _read_table(run / "objects.parquet", OBJECTS_SCHEMA)
    return objects, _read_table(run / "frames.parquet", FRAMES_SCHEMA, unread=unread)


def read_threshold_free(run: Path, protocol: Protocol) -> ThresholdFreeFigures | None:
    """Take the threshold-free figures of a run from its frames, some hundred of them in memory at a time.

    Raises:
        DataError: the frames are missing or damaged.
    """
    file = run / "frames.parquet"
    try:
        with pq.ParquetFile(file) as frames:
            return threshold_free_figures(
                frames.iter_batches(batch_size=BATCH_IMAGES, columns=list(THRESHOLD_FREE_COLUMNS)), protocol=protocol
            )
    except (OSError, pa.ArrowInvalid) as error:
        raise DataError(file, wanted="a table of a run", came=" ".join(str(error).split())[:200]) from error


def read_image_maps(run: Path) -> dict[str, ImageMap]:
    """Where in the image a run's method was right and wrong, by camera.

    A camera that comes in several sizes has one map for each, as "front, 640 x 480".

    Raises:
        DataError: missing, as in runs of older versions, or damaged.
    """
    maps = load_image_maps(run / IMAGE_MAPS)
    several = [camera for camera, count in Counter(item.camera for item in maps).items() if count > 1]
    names = [f"{m.camera}, {m.width} x {m.height}" if m.camera in several else m.camera for m in maps]
    return dict(zip(names, maps, strict=True))


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


def _read_table(file: Path, schema: pa.Schema, *, unread: frozenset[str] = frozenset()) -> pa.Table:
    try:
        table = pq.read_table(file, columns=[name for name in pq.read_schema(file).names if name not in unread])
        for name in LATER_COLUMNS & set(schema.names) - set(table.column_names):
            table = table.append_column(schema.field(name), pa.nulls(len(table), schema.field(name).type))
        missing = [name for name in schema.names if name not in table.column_names]
        if missing:
            raise DataError(file, field=missing[0], wanted="this column of a run's table", came="none")
        return table.select(schema.names).cast(schema)
    except (OSError, pa.ArrowInvalid) as error:
        raise DataError(file, wanted="a table of a run", came=" ".join(str(error).split())[:200]) from error

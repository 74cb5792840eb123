"""The files of a run: written once, atomically; everything above reads only these.

```
<run>/units/                                                                           see `bench.harness.unit_files`
<run>/objects.parquet, frames.parquet, masks.parquet, image_maps.npz, summary.json     the whole run
<run>/protocol.json                                                                    the rules that it was scored by
```

Runs of older versions are read for ever: columns that came later are null in them, files that came later are missed by
name.
"""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
from pydantic import Field

from bench.errors import DataError
from bench.evaluation import (
    FRAMES_SCHEMA,
    OBJECTS_SCHEMA,
    ImageMap,
    ObjectMetrics,
    Protocol,
    Summary,
    ThresholdFreeMetrics,
    load_protocol,
    threshold_free_metrics,
)
from bench.evaluation.likelihood import COLUMNS as THRESHOLD_FREE_COLUMNS
from bench.evaluation.row_source import BATCH_ROWS, Columns, Rows, as_source, count_words, read_parts
from bench.evaluation.sums import level_ratios
from bench.harness.manifest import Manifest, write_manifest
from bench.harness.provenance import Provenance
from bench.harness.unit_files import load_image_maps
from bench.recordings import write_text
from bench.recordings.sealed_json import read_sealed, write_sealed

SCHEMA_VERSION = 1
BATCH_IMAGES = 512
SUMMARY, IMAGE_MAPS = "summary.json", "image_maps.npz"
Table = Literal["objects.parquet", "frames.parquet", "image_maps.npz", "masks.parquet"]
PREDICTIONS = "predictions.json"  # of runs of predictions from disk

# What the reference alone decides, in whole numbers and words: no floats, whose text could differ between versions.
REFERENCE_OF_OBJECTS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px"),
)
REFERENCE_OF_FRAMES = ("recording", "camera", "timestamp_ns", "status", "valid_px", "reference_px", "ignored_px")
HISTOGRAMS = frozenset({"likelihood_reference_px", "likelihood_outside_px"})
LATER_COLUMNS = HISTOGRAMS | {"unknown_px", "ceiling_tp", "ceiling_fp"}  # not in the first runs of version 1
RECORDING = "recording"
READ_ROWS = 8192  # at a time: a row of frames with its histograms takes 2 kB


class StoredRows:
    """A table of a run on disk.

    Args:
        file: Parquet.
        schema: that it is of; columns that came later are null where they are missing.

    Raises:
        DataError: missing, damaged, or without a column.
    """

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        self.file, self.schema = file, schema
        with self._readable():
            self._metadata = pq.read_metadata(file)
            self._held = frozenset(self._metadata.schema.to_arrow_schema().names)
        missing = [name for name in schema.names if name not in self._held | LATER_COLUMNS]
        if missing:
            raise DataError(file, field=missing[0], expected="this column of a run's table", got="none")
        self._groups: list[Mapping[str, int]] | None = None

    def __len__(self) -> int:
        return int(self._metadata.num_rows)

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        counted: dict[str, int] = {}
        for group in self._row_groups():
            for name, rows in group.items():
                counted[name] = counted.get(name, 0) + rows
        return counted

    def distinct(self, column: str) -> tuple[str, ...]:
        """The words of a column, sorted, each once."""
        return tuple(
            sorted({word for batch in self.batches([column]) for word in count_words(_chunked(batch[column]))})
        )

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pa.Table:
        """All rows of some recordings, in the order of the file; strings come as dictionaries."""
        expected = frozenset(recordings)
        groups = [number for number, held in enumerate(self._row_groups()) if not expected.isdisjoint(held)]
        whole = all(expected.issuperset(self._row_groups()[number]) for number in groups)
        needed = list(columns) if whole or RECORDING in columns else [*columns, RECORDING]
        names = pa.array(sorted(expected), pa.string())
        parts = []
        for batch in self._batches(needed, rows=READ_ROWS, row_groups=groups):
            kept = batch if whole else batch.filter(pc.is_in(_decoded(batch[RECORDING]), value_set=names))
            if len(kept):
                parts.append(kept.select(list(columns)))
        return pa.Table.from_batches(parts) if parts else self._empty(columns)

    def batches(self, columns: Sequence[str], *, rows: int = BATCH_ROWS) -> Iterator[pa.RecordBatch]:
        """All rows, at most `rows` at a time, in the order of the file; strings come as dictionaries."""
        yield from self._batches(columns, rows=rows, row_groups=range(self._metadata.num_row_groups))

    def table(self, *, unread: frozenset[str] = frozenset()) -> pa.Table:
        """All of it, in memory; columns of `unread` are null."""
        columns = [name for name in self.schema.names if name not in unread]
        whole = pa.Table.from_batches(self.batches(columns), self._schema(columns))
        read = {name: whole[name].cast(self.schema.field(name).type) for name in columns}
        nulls = {name: pa.nulls(len(whole), self.schema.field(name).type) for name in unread}
        return pa.table([(read | nulls)[name] for name in self.schema.names], schema=self.schema)

    def _batches(self, columns: Sequence[str], *, rows: int, row_groups: Sequence[int]) -> Iterator[pa.RecordBatch]:
        schema = self._schema(columns)
        held = [name for name in columns if name in self._held]
        words = [field.name for field in self.schema if pa.types.is_string(field.type)]
        with (
            self._readable(),
            pq.ParquetFile(self.file, metadata=self._metadata, read_dictionary=words) as stored,
        ):
            if not row_groups:
                return
            for batch in stored.iter_batches(batch_size=rows, row_groups=list(row_groups), columns=held):
                yield pa.RecordBatch.from_arrays([_column(batch, field) for field in schema], schema=schema)

    def _row_groups(self) -> list[Mapping[str, int]]:
        """Rows of each recording, of each group of rows of the file."""
        if self._groups is None:
            self._groups = [self._recordings_of(number) for number in range(self._metadata.num_row_groups)]
        return self._groups

    def _recordings_of(self, number: int) -> Mapping[str, int]:
        group = self._metadata.row_group(number)
        place = self._metadata.schema.names.index(RECORDING)
        found = group.column(place).statistics
        # One recording, as its unit was written: nothing has to be read.
        if found is not None and found.has_min_max and found.min == found.max and found.null_count == 0:
            return {str(found.min): int(group.num_rows)}
        counted: dict[str, int] = {}
        for batch in self._batches([RECORDING], rows=BATCH_ROWS, row_groups=[number]):
            for name, rows in count_words(_chunked(batch[RECORDING])).items():
                counted[name] = counted.get(name, 0) + rows
        return counted

    def _schema(self, columns: Sequence[str]) -> pa.Schema:
        words = pa.dictionary(pa.int32(), pa.string())
        fields = [self.schema.field(name) for name in columns]
        return pa.schema([f.with_type(words) if pa.types.is_string(f.type) else f for f in fields])

    def _empty(self, columns: Sequence[str]) -> pa.Table:
        return self._schema(columns).empty_table()

    @contextmanager
    def _readable(self) -> Iterator[None]:
        try:
            yield
        except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
            got = " ".join(str(error).split())[:200]
            raise DataError(self.file, expected="a table of a run", got=got) from error


def open_tables(run: Path) -> tuple[StoredRows, StoredRows]:
    """The run's objects and frames, to be read a part at a time.

    Raises:
        DataError: missing, damaged, or without a column; damage further inside is met on reading.
    """
    return StoredRows(run / "objects.parquet", OBJECTS_SCHEMA), StoredRows(run / "frames.parquet", FRAMES_SCHEMA)


def _column(batch: pa.RecordBatch, field: pa.Field) -> pa.Array:
    if field.name not in batch.schema.names:
        return pa.nulls(len(batch), field.type)
    column = batch[field.name]
    return column if column.type == field.type else column.cast(field.type)


def _decoded(column: pa.Array) -> pa.Array:
    return column.dictionary_decode() if pa.types.is_dictionary(column.type) else column


def _chunked(column: pa.Array) -> pa.ChunkedArray:
    return pa.chunked_array([column])


class RunSummary(Summary):
    """`summary.json`: the metrics, and what they are of.

    Attributes:
        schema_version: of this file.
        manifest: what the metrics are of, also in `manifest.json`.
        provenance: how the result came about.
        vehicle_outline_m: the ego vehicle from above, vehicle frame, for pictures.
        caveats: what a reader has to know of the data set, from its card.
        failures: one line per recording, unit or image that could not be used; the metrics are of the rest.
        threshold_free: what the method's likelihood is worth at all thresholds; None for a method without one and in
            runs of older versions.
        files: SHA-256 of the tables that the metrics are of, by name; empty in runs of older versions.
    """

    schema_version: int
    manifest: Manifest
    provenance: Provenance
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failures: tuple[str, ...]
    caveats: str = ""
    threshold_free: ThresholdFreeMetrics | None = None
    files: dict[Table, str] = Field(default_factory=dict)


def read_tables(run: Path, *, histograms: bool = True) -> tuple[pa.Table, pa.Table]:
    """The run's objects and frames, whole, in memory; `open_tables` reads runs of any size.

    Args:
        run: folder.
        histograms: whether to read those over the likelihood, which take ten times the rest of a frame's row; they
            are null otherwise.

    Raises:
        DataError: missing or damaged.
    """
    objects, frames = open_tables(run)
    return objects.table(), frames.table(unread=frozenset() if histograms else HISTOGRAMS)


def read_threshold_free(run: Path) -> ThresholdFreeMetrics | None:
    """Take the threshold-free metrics of a run from its frames, some hundred of them in memory at a time.

    Raises:
        DataError: the frames are missing or damaged.
    """
    _, frames = open_tables(run)
    return threshold_free_metrics(frames.batches(THRESHOLD_FREE_COLUMNS, rows=BATCH_IMAGES))


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


def read_protocol(run: Path, summary: RunSummary) -> Protocol:
    """The rules of a run.

    Args:
        run: folder.
        summary: of the run, which has to be made by these rules.

    Raises:
        DataError: missing, not a protocol, or the summary is of another one or lacks its metrics.
    """
    file = run / "protocol.json"
    if not file.is_file():
        raise DataError(file, expected="the protocol of a run", got="no such file")
    protocol = load_protocol(file)  # JSON is YAML
    if protocol.digest != summary.protocol.digest:
        raise DataError(
            file,
            expected=f"the protocol of {SUMMARY}, with digest {summary.protocol.digest[:12]}",
            got=f"{protocol.name!r} with digest {protocol.digest[:12]}",
        )
    rows = {str(category) for category in protocol.reference.categories}
    metrics = {*ObjectMetrics.model_fields, *level_ratios(protocol.scoring.detection_levels)}
    if rows != summary.categories.keys():
        got = ", ".join(summary.categories)
        raise DataError(run / SUMMARY, field="categories", expected=", ".join(sorted(rows)), got=got)
    for name, row in (*summary.categories.items(), ("all_moving", summary.all_moving)):
        if missing := sorted(metrics - set(row.metric_names()) - {"object_frames", "tracks", "recordings"}):
            raise DataError(run / SUMMARY, field=name, expected="the metrics of its protocol", got=f"no {missing[0]}")
    return protocol


def reference_fingerprint(objects: Rows, frames: Rows) -> str:
    """SHA-256 over the columns that the method has no part in, some recordings in memory at a time."""
    digest = hashlib.sha256()
    for rows, columns, key in (
        (objects, REFERENCE_OF_OBJECTS, REFERENCE_OF_OBJECTS[:4]),
        (frames, REFERENCE_OF_FRAMES, REFERENCE_OF_FRAMES[:3]),
    ):
        source = as_source(rows)
        schema = pa.schema([source.schema.field(name) for name in columns])
        digest.update(_csv(schema.empty_table(), heading=True))
        for part in read_parts(source, columns):
            digest.update(_csv(Columns(part).canonical(key).table.cast(schema), heading=False))
    return digest.hexdigest()


def write_summary(run: Path, summary: RunSummary) -> None:
    """Write `manifest.json` and `summary.json`; NaN becomes null."""
    write_manifest(run, summary.manifest)
    write_sealed(run / SUMMARY, summary)


def file_digests(run: Path) -> dict[Table, str]:
    """SHA-256 of the files of a run that its summary is of, by name."""
    return {name: _sha256(run / name) for name in get_args(Table) if (run / name).is_file()}


def read_run(run: Path) -> RunSummary:
    """Read `summary.json`; the tables beside it must be those that it is of.

    Raises:
        DataError: missing, not a summary of a known version, damaged, or beside tables of something else.
    """
    file = run / SUMMARY
    summary = read_sealed(RunSummary, file, expected="the summary of a run")
    if summary.schema_version != SCHEMA_VERSION:
        expected, got = f"{SCHEMA_VERSION}", f"{summary.schema_version}"
        raise DataError(
            file, field="schema_version", expected=expected, got=got, do="read it with the version it is of"
        )
    for name, digest in summary.files.items():
        _check(run / name, digest)
    return summary


def _check(file: Path, digest: str) -> None:
    """Refuse a file of a run, where it is there, that is not the one that the summary is of.

    Raises:
        DataError: it is another, damaged, or cannot be read.
    """
    try:
        found = _sha256(file)
    except FileNotFoundError:
        return
    except OSError as error:
        raise DataError(file, expected="a file of a run", got=error.strerror or str(error)) from error
    if found != digest:
        got, do = "another one: it is damaged, or of another run", "score again"
        raise DataError(file, expected=f"the file that {SUMMARY} is of", got=got, do=do)


def _sha256(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _csv(table: pa.Table, *, heading: bool) -> bytes:
    text = io.BytesIO()
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=heading))
    return text.getvalue()

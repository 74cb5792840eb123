"""The files of a run: written once, atomically; everything above reads only these, as a `StoredRun`.

```
<run>/manifest.json                                                what the run is; names protocol.json and sums.csv
<run>/summary.json                                                 metrics, provenance, failures; names the other files
<run>/objects.parquet, frames.parquet, masks.parquet, image_maps.npz                             the whole run
<run>/sums.csv                                                     the tables, summed by recording
<run>/protocol.json                                                the rules that it was scored by
<run>/units/                                                       see `bench.harness.unit_files`
```

A file is named with the digest of its content, so that files of two runs are never taken for one.
"""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.dataset

from bench.atomic import read_regular, write_text
from bench.errors import DataError, UsageError
from bench.evaluation import (
    FRAMES_SCHEMA,
    OBJECTS_SCHEMA,
    ImageMap,
    ObjectMetrics,
    Protocol,
    Summary,
    ThresholdFreeMetrics,
    load_protocol,
    read_sums,
    sum_run,
    summary_of,
    threshold_free_metrics,
)
from bench.evaluation.definitions import level_metrics
from bench.evaluation.likelihood import OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.evaluation.rows import (
    ChosenRows,
    CommonImages,
    Rows,
    RowsOnImages,
    RowSource,
    read_parts,
    sort_rows,
    to_frame,
)
from bench.harness.digests.content import MISSING, UNREADABLE, FileDigests, short_digest
from bench.harness.manifest import MANIFEST, PREDICTIONS_DIGEST, Manifest, read_manifest, write_manifest
from bench.harness.masks import MASKS
from bench.harness.provenance import Provenance
from bench.harness.run_folder import run_name
from bench.harness.unit_files import load_image_maps
from bench.recordings.checked_json import read_checked, write_checked
from bench.recordings.openlabel import NOT_REVIEWED
from bench.records.reference import Category

SUMMARY, SUMS, IMAGE_MAPS, PROTOCOL = "summary.json", "sums.csv", "image_maps.npz", "protocol.json"
NamedFile = Literal["manifest.json", "objects.parquet", "frames.parquet", "image_maps.npz", "masks.parquet"]
PREDICTIONS = "predictions.json"  # of runs of predictions from disk

# What the reference alone decides, in whole numbers and words: no floats, whose text could differ between versions.
REFERENCE_OF_OBJECTS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px"),
)
REFERENCE_OF_FRAMES = ("recording", "camera", "timestamp_ns", "status", "valid_px", "reference_px", "ignored_px")
HISTOGRAMS = frozenset({REFERENCE_COLUMN, OUTSIDE_COLUMN})


class StoredRows:
    """A table of a run on disk, read a few recordings at a time.

    Args:
        file: Parquet.
        schema: that it is of.

    Raises:
        DataError: missing, damaged, or without a column.
    """

    def __init__(self, file: Path, schema: pa.Schema) -> None:
        self.file, self.schema = file, schema
        with self._readable():
            self._stored = pyarrow.dataset.dataset(file, format="parquet")
        if missing := [name for name in schema.names if name not in self._stored.schema.names]:
            raise DataError(file, field=missing[0], expected="this column of a run's table", got="none")
        for field in schema:
            kind = self._stored.schema.field(field.name).type
            if not pa.types.is_nested(kind) and kind != field.type:
                raise DataError(file, field=field.name, expected=f"a column of {field.type}", got=str(kind))
        self._recordings: dict[str, int] | None = None

    def __len__(self) -> int:
        return sum(self.recordings().values())

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        if self._recordings is None:
            found: Counter[str] = Counter()
            with self._readable():
                for batch in self._stored.to_batches(columns=["recording"], batch_readahead=1):
                    for one in pc.value_counts(batch["recording"]).to_pylist():
                        found[one["values"]] += one["counts"]
            self._recordings = dict(found)
        return self._recordings

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, in the order of the file."""
        name = pyarrow.dataset.field("recording")
        wanted = name.isin(pa.array(recordings, pa.string()))
        if recordings:  # groups of rows of others are not read
            wanted &= (name >= min(recordings)) & (name <= max(recordings))
        return to_frame(self._table(columns, wanted))

    def table(self, *, unread: frozenset[str] = frozenset()) -> pa.Table:
        """All of it, in memory; columns of `unread` are null."""
        read = self._table([name for name in self.schema.names if name not in unread])
        nulls = {name: pa.nulls(len(read), self.schema.field(name).type) for name in unread}
        columns = [nulls[name] if name in nulls else read[name] for name in self.schema.names]
        return pa.table(columns, names=self.schema.names).cast(self.schema)

    def _table(self, columns: Sequence[str], wanted: pyarrow.dataset.Expression | None = None) -> pa.Table:
        with self._readable():
            return self._stored.to_table(columns=list(columns), filter=wanted, batch_readahead=1, use_threads=False)

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


class RunSummary(Summary):
    """`summary.json`: the metrics, and how they came about; what they are of is in `manifest.json`.

    Attributes:
        schema_version: of this file.
        provenance: how the result came about.
        vehicle_outline_m: the ego vehicle from above, vehicle frame, for pictures.
        caveats: what a reader has to know of the data set, from its card.
        failures: one line per recording, unit or image that could not be used; the metrics are of the rest.
        threshold_free: what the method's likelihood is worth at all thresholds; None for a method without one.
        files: SHA-256 of the manifest and of the tables that the metrics are of, by name.
    """

    schema_version: Literal[1]
    provenance: Provenance
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failures: tuple[str, ...]
    caveats: str = ""
    threshold_free: ThresholdFreeMetrics | None = None
    files: dict[NamedFile, str]

    @property
    def unreviewed(self) -> str:
        """The caveat of annotations that were not reviewed; empty where they were."""
        return next((line for line in self.caveats.splitlines() if line.startswith(NOT_REVIEWED)), "")


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


def read_image_maps(run: Path) -> dict[str, ImageMap]:
    """Read the maps of where in the image a run's method was right and wrong, by camera.

    A camera that comes in several sizes has one map for each, as "front, 640 x 480".

    Raises:
        DataError: missing or damaged.
    """
    maps = load_image_maps(run / IMAGE_MAPS)
    several = [camera for camera, count in Counter(item.camera for item in maps).items() if count > 1]
    names = [f"{m.camera}, {m.width} x {m.height}" if m.camera in several else m.camera for m in maps]
    return dict(zip(names, maps, strict=True))


def reference_digest(objects: Rows, frames: Rows) -> str:
    """SHA-256 over the columns that the method has no part in, some recordings in memory at a time."""
    digest = hashlib.sha256()
    for rows, whole, columns, key in (
        (objects, OBJECTS_SCHEMA, REFERENCE_OF_OBJECTS, REFERENCE_OF_OBJECTS[:4]),
        (frames, FRAMES_SCHEMA, REFERENCE_OF_FRAMES, REFERENCE_OF_FRAMES[:3]),
    ):
        schema = pa.schema([whole.field(name) for name in columns])
        digest.update(_csv(schema.empty_table(), heading=True))
        for part in read_parts(rows, columns):
            digest.update(_csv(pa.Table.from_pandas(sort_rows(part, key), schema, preserve_index=False), heading=False))
    return digest.hexdigest()


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredRun:
    """A run on disk: its small files as they were read, its tables as they are asked for.

    It may be of the object-frames of one kind of motion only, and of some images: objects, frames, sums and metrics are
    then of these, the summary is of the whole run.

    Attributes:
        folder: of the run.
        label: what tables call it.
        manifest: what the run is.
        summary: its metrics, and how they came about.
        protocol: its rules.
        category: of the object-frames; None for all.
        images: which; None for all of the run.
    """

    folder: Path
    label: str
    manifest: Manifest
    summary: RunSummary
    protocol: Protocol
    category: Category | None = None
    images: CommonImages | None = None

    @cached_property
    def objects(self) -> RowSource:
        """Rows of `OBJECTS_SCHEMA`, on disk."""
        rows: RowSource = open_tables(self.folder)[0]
        if self.category is not None:
            rows = ChosenRows(source=rows, column="category", word=self.category.value)
        return rows if self.images is None else RowsOnImages(rows, self.images)

    @cached_property
    def frames(self) -> RowSource:
        """Rows of `FRAMES_SCHEMA`, on disk."""
        rows = open_tables(self.folder)[1]
        return rows if self.images is None else RowsOnImages(rows, self.images)

    @cached_property
    def sums(self) -> pd.DataFrame:
        """Table of sums: as it is stored, or of the rows that were chosen."""
        if self._is_whole:
            return read_sums(self.folder / SUMS)
        return sum_run(self.objects, self.frames, protocol=self.protocol)

    @cached_property
    def metrics(self) -> Summary:
        """Metrics of these rows; the summary itself for all of them."""
        return self.summary if self._is_whole else summary_of(self.sums, protocol=self.protocol)

    @property
    def masks(self) -> Path:
        """File of the masks that were scored.

        Raises:
            DataError: the run holds none.
        """
        file = self.folder / MASKS
        if not file.is_file():
            hint = "run again: pictures are drawn from stored masks, and the method of a stored run is never called"
            raise DataError(file, expected="the masks that were scored", got="no such file", hint=hint)
        return file

    @property
    def commit(self) -> str | None:
        """Commit of the method's code, "+" behind it where files were changed; None where it is unknown, and of
        predictions from disk."""
        method = self.manifest.method
        if PREDICTIONS_DIGEST in method.settings:
            return None
        return self.manifest.code.commit if method.is_own else method.commit

    @property
    def _is_whole(self) -> bool:
        return self.category is None and self.images is None


def read_run(folder: Path, *, label: str | None = None, category: Category | None = None) -> StoredRun:
    """Read a run; its files must all be of it.

    Args:
        folder: of the run.
        label: what tables call it; None for the folder's name.
        category: of the object-frames; None for all.

    Raises:
        DataError: a file is missing, damaged, or of another run.
    """
    summary = read_checked(RunSummary, folder / SUMMARY, expected="the summary of a run")
    digests = FileDigests()
    for name, digest in summary.files.items():
        if (found := digests.of(folder / name)) not in (digest, MISSING):
            got = found if found.startswith(UNREADABLE) else "another one: it is damaged, or of another run"
            raise DataError(folder / name, expected=f"the file that {SUMMARY} is of", got=got, hint="score again")
    manifest = read_manifest(folder)
    if manifest is None:
        raise DataError(folder / MANIFEST, expected="the manifest of a run", got="no such file")
    if (folder / SUMS).exists():
        refuse_other_sums(folder, manifest, hint="score again")
    open_tables(folder)  # what is wrong with them is told here, not halfway through a report
    return StoredRun(
        folder=folder,
        label=label or run_name(folder),
        manifest=manifest,
        summary=summary,
        protocol=_read_protocol(folder, manifest, summary),
        category=category,
    )


def refuse_other_sums(folder: Path, manifest: Manifest, *, hint: str) -> None:
    """Refuse sums that are not those of the manifest beside them, whatever ends their lines.

    Raises:
        DataError: they are not.
    """
    if manifest.sums is not None and manifest.sums != sums_digest(folder):
        raise DataError(folder / SUMS, expected=f"the file that {MANIFEST} is of", got="another one", hint=hint)


def refuse_unscored(summary: RunSummary, run: Path) -> None:
    """Refuse a run without scores, of data that are not annotated.

    Raises:
        UsageError: it has none.
    """
    if summary.images.not_annotated and not summary.images.evaluated:
        raise UsageError(f"{run}: expected a run with scores, got one of data that are not annotated")


def write_run(
    folder: Path,
    metrics: Summary,
    *,
    manifest: Manifest,
    protocol: Protocol,
    provenance: Provenance,
    failures: Sequence[str] = (),
    caveats: str = "",
    vehicle_outline_m: tuple[tuple[float, float], ...] = (),
) -> StoredRun:
    """Write the small files of a run, whose tables and sums lie in its folder; NaN becomes null.

    Args:
        folder: of the run.
        metrics: of the tables.
        manifest: what the run is, but for the digests of its reference and its sums.
        protocol: its rules.
        provenance: as in `RunSummary`, like what follows.
        failures: one line each.
        caveats: of the data.
        vehicle_outline_m: of the ego vehicle.
    """
    objects, frames = open_tables(folder)
    finished = {"reference": reference_digest(objects, frames), "sums": sums_digest(folder)}
    manifest = manifest.model_copy(update=finished)
    write_text(folder / PROTOCOL, protocol.model_dump_json(indent=1, exclude_unset=True) + "\n")
    write_manifest(folder, manifest)
    summary = RunSummary(
        **{name: getattr(metrics, name) for name in type(metrics).model_fields},
        schema_version=1,
        provenance=provenance,
        vehicle_outline_m=vehicle_outline_m,
        failures=tuple(failures),
        caveats=caveats,
        threshold_free=threshold_free_metrics(frames),
        files=file_digests(folder),
    )
    write_checked(folder / SUMMARY, summary)
    return StoredRun(folder=folder, label=run_name(folder), manifest=manifest, summary=summary, protocol=protocol)


def file_digests(folder: Path) -> dict[NamedFile, str]:
    """SHA-256 of the files of a run that its summary names."""
    digests = FileDigests()
    return {name: digests.of(folder / name) for name in get_args(NamedFile) if (folder / name).is_file()}


def sums_digest(folder: Path) -> str:
    """SHA-256 of `sums.csv`, whatever ends its lines, which a checkout may change.

    Raises:
        DataError: missing, or no regular file.
    """
    file = folder / SUMS
    try:
        return hashlib.sha256(read_regular(file).replace(b"\r\n", b"\n")).hexdigest()
    except OSError as error:
        raise DataError(file, expected="a table of sums", got=error.strerror or str(error)) from error


def _read_protocol(folder: Path, manifest: Manifest, summary: RunSummary) -> Protocol:
    """Read the rules of a run.

    Raises:
        DataError: missing, not a protocol, or the manifest is of another one, or the summary lacks its metrics.
    """
    file = folder / PROTOCOL
    if not file.is_file():
        raise DataError(file, expected="the protocol of a run", got="no such file")
    protocol = load_protocol(file)  # JSON is YAML
    if protocol.digest != manifest.protocol.digest:
        expected = f"the protocol of {MANIFEST}, with digest {short_digest(manifest.protocol.digest)}"
        got = f"{protocol.name!r} with digest {short_digest(protocol.digest)}"
        raise DataError(file, expected=expected, got=got)
    rows = {str(category) for category in protocol.reference.categories}
    metrics = {
        *ObjectMetrics.model_fields,
        *(metric.name for metric in level_metrics(protocol.scoring.detection_levels)),
    }
    if rows != summary.categories.keys():
        got = ", ".join(summary.categories)
        raise DataError(folder / SUMMARY, field="categories", expected=", ".join(sorted(rows)), got=got)
    for name, row in (*summary.categories.items(), ("all_moving", summary.all_moving)):
        if missing := sorted(metrics - set(row.metric_names()) - {"object_frames", "tracks", "recordings"}):
            got = f"no {missing[0]}"
            raise DataError(folder / SUMMARY, field=name, expected="the metrics of its protocol", got=got)
    return protocol


def _csv(table: pa.Table, *, heading: bool) -> bytes:
    text = io.BytesIO()
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=heading))
    return text.getvalue()

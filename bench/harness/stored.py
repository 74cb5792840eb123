"""The files of a run: written once, atomically; everything above reads only these.

```
<run>/units/                                                                           see `bench.harness.unit_files`
<run>/objects.parquet, frames.parquet, masks.parquet, image_maps.npz, summary.json     the whole run
<run>/sums.csv                                                                         the tables, summed by recording
<run>/protocol.json                                                                    the rules that it was scored by
```
"""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, get_args

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.dataset

from bench.atomic import write_text
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
    threshold_free_metrics,
)
from bench.evaluation.definitions import level_metrics
from bench.evaluation.likelihood import OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.evaluation.rows import Rows, read_parts, sort_rows, to_frame
from bench.harness.digests.content import MISSING, UNREADABLE, FileDigests
from bench.harness.manifest import PREDICTIONS_DIGEST, Manifest, write_manifest
from bench.harness.provenance import Provenance
from bench.harness.unit_files import load_image_maps
from bench.recordings.checked_json import read_checked, write_checked
from bench.recordings.openlabel import NOT_REVIEWED

SUMMARY, SUMS, IMAGE_MAPS = "summary.json", "sums.csv", "image_maps.npz"
Table = Literal["objects.parquet", "frames.parquet", "image_maps.npz", "masks.parquet", "sums.csv"]
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
    """`summary.json`: the metrics, and what they are of.

    Attributes:
        schema_version: of this file.
        manifest: what the metrics are of, also in `manifest.json`.
        provenance: how the result came about.
        vehicle_outline_m: the ego vehicle from above, vehicle frame, for pictures.
        caveats: what a reader has to know of the data set, from its card.
        failures: one line per recording, unit or image that could not be used; the metrics are of the rest.
        threshold_free: what the method's likelihood is worth at all thresholds; None for a method without one.
        files: SHA-256 of the tables that the metrics are of, by name.
    """

    schema_version: Literal[1]
    manifest: Manifest
    provenance: Provenance
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failures: tuple[str, ...]
    caveats: str = ""
    threshold_free: ThresholdFreeMetrics | None = None
    files: dict[Table, str]

    @property
    def commit(self) -> str | None:
        """Commit of the method's code, "+" behind it where files were changed; None where it is unknown, and of
        predictions from disk."""
        method = self.manifest.method
        if PREDICTIONS_DIGEST in method.settings:
            return None
        return self.manifest.code.commit if method.place.startswith("bench.") else self.provenance.method_commit

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


def read_threshold_free(run: Path) -> ThresholdFreeMetrics | None:
    """Take the threshold-free metrics of a run from its frames, a few recordings in memory at a time.

    Raises:
        DataError: the frames are missing or damaged.
    """
    _, frames = open_tables(run)
    return threshold_free_metrics(frames)


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
    metrics = {
        *ObjectMetrics.model_fields,
        *(metric.name for metric in level_metrics(protocol.scoring.detection_levels)),
    }
    if rows != summary.categories.keys():
        got = ", ".join(summary.categories)
        raise DataError(run / SUMMARY, field="categories", expected=", ".join(sorted(rows)), got=got)
    for name, row in (*summary.categories.items(), ("all_moving", summary.all_moving)):
        if missing := sorted(metrics - set(row.metric_names()) - {"object_frames", "tracks", "recordings"}):
            raise DataError(run / SUMMARY, field=name, expected="the metrics of its protocol", got=f"no {missing[0]}")
    return protocol


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


def write_summary(run: Path, summary: RunSummary) -> None:
    """Write `manifest.json` and `summary.json`; NaN becomes null."""
    write_manifest(run, summary.manifest)
    write_checked(run / SUMMARY, summary)


def file_digests(run: Path) -> dict[Table, str]:
    """SHA-256 of the files of a run that its summary is of, by name."""
    digests = FileDigests()
    return {name: digests.of(run / name) for name in get_args(Table) if (run / name).is_file()}


def sums_digest(run: Path) -> str:
    """SHA-256 of `sums.csv`, whatever ends its lines, which a checkout may change."""
    return hashlib.sha256((run / SUMS).read_text("utf-8").encode()).hexdigest()


def read_run(run: Path) -> RunSummary:
    """Read `summary.json`; the tables beside it must be those that it is of.

    Raises:
        DataError: missing, not a summary, damaged, or beside tables of something else.
    """
    file = run / SUMMARY
    summary = read_checked(RunSummary, file, expected="the summary of a run")
    digests = FileDigests()
    for name, digest in summary.files.items():
        if (found := digests.of(run / name)) not in (digest, MISSING):
            got = found if found.startswith(UNREADABLE) else "another one: it is damaged, or of another run"
            raise DataError(run / name, expected=f"the file that {SUMMARY} is of", got=got, hint="score again")
    return summary


def refuse_unscored(summary: RunSummary, run: Path) -> None:
    """Refuse a run without scores, of data that are not annotated.

    Raises:
        UsageError: it has none.
    """
    if summary.images.not_annotated and not summary.images.evaluated:
        raise UsageError(f"{run}: expected a run with scores, got one of data that are not annotated")


def _csv(table: pa.Table, *, heading: bool) -> bytes:
    text = io.BytesIO()
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=heading))
    return text.getvalue()

"""The results of a run by one protocol, as everything above reads them: a `StoredRun`.

```
<run>/run.json                          what was asked; see `bench.harness.manifest`
<run>/answers/                          what was answered; see `bench.harness.answers`
<run>/<protocol>/counts/                what was counted; see `bench.harness.counts`
<run>/<protocol>/sums.csv               the counts, summed by recording
<run>/<protocol>/protocol.json          the rules
<run>/<protocol>/manifest.json          what all this is of
<run>/<protocol>/summary.json           metrics, provenance, failures; written last
<run>/<protocol>/table.*, ...           reports
```
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Literal

import pandas as pd
import pyarrow as pa
import pyarrow.csv
from pydantic import BaseModel, ConfigDict

from bench.atomic import write_text
from bench.errors import DataError, UsageError
from bench.evaluation.counts import OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import (
    FRAMES_SCHEMA,
    IMAGE,
    OBJECTS_SCHEMA,
    RowsOnCommonImages,
    RowSource,
    read_parts,
    sort_rows,
)
from bench.evaluation.summary import Summary, summary_of
from bench.evaluation.sums import read_sums, sum_run
from bench.evaluation.thresholds import ThresholdFreeMetrics, threshold_free_metrics
from bench.execution import largest_resident_mb
from bench.harness.answers import ANSWERS, FAILED, Answer, read_answers, safe_name
from bench.harness.counts import COUNTS, open_tables
from bench.harness.digests import short_digest
from bench.harness.manifest import MANIFEST, Manifest, write_manifest
from bench.recordings.annotations import NOT_REVIEWED
from bench.recordings.validation import read_json

SUMMARY, SUMS, PROTOCOL = "summary.json", "sums.csv", "protocol.json"
PREDICTIONS = "predictions.json"  # of runs of predictions from disk
USUAL_PROTOCOL = "surface-v1"  # by which methods are compared
RESULT_FILES = (
    *(ANSWERS, COUNTS, MANIFEST, SUMMARY, SUMS, PROTOCOL, PREDICTIONS),
    *("table.*", "index.html", "figures", "pictures"),
)

# What the reference alone decides, in whole numbers and words: no floats, whose text could differ between versions.
REFERENCE_OF_OBJECTS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category", "direction"),
    *("points", "polygon_px", "region_px"),
)
REFERENCE_OF_FRAMES = ("recording", "camera", "timestamp_ns", "status", "valid_px", "reference_px", "ignored_px")
HISTOGRAMS = {REFERENCE_COLUMN, OUTSIDE_COLUMN}


class Provenance(BaseModel):
    """Record of how a run was made; none of it decides a metric.

    Attributes:
        started_utc: ISO 8601.
        seconds: wall time.
        images: scored images.
        images_asked: of which the method was asked; the answers of the others were stored.
        workers: how many; 0 where the executor does not tell.
        peak_memory_mb: largest resident size of a process of this machine.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    started_utc: str
    seconds: float
    images: int
    images_asked: int
    workers: int
    peak_memory_mb: float


def provenance_since(start_s: float, *, images_asked: int = 0, images: int = 0, workers: int = 1) -> Provenance:
    """The provenance of work that ends now.

    Args:
        start_s: when it began, by `time.perf_counter`, which never goes back.
        images_asked: of which a method was asked.
        images: that were scored.
        workers: processes.
    """
    seconds = round(perf_counter() - start_s, 3)
    return Provenance(
        started_utc=(datetime.now(UTC) - timedelta(seconds=seconds)).isoformat(timespec="seconds"),
        seconds=seconds,
        images=images,
        images_asked=images_asked,
        workers=workers,
        peak_memory_mb=round(largest_resident_mb(), 1),
    )


class RunSummary(Summary):
    """`summary.json`: the metrics, and how they came about; what they are of is in `manifest.json`.

    Attributes:
        schema_version: of this file.
        provenance: how the result came about.
        vehicle_outline_m: the ego vehicle from above, vehicle frame, for pictures.
        caveats: what a reader has to know of the data set, from its card.
        failures: one line per recording, task or image that could not be used; the metrics are of the rest.
        threshold_free: what the method's likelihood is worth at all thresholds; None for a method without one.
    """

    schema_version: Literal[1]
    provenance: Provenance
    vehicle_outline_m: tuple[tuple[float, float], ...]
    failures: tuple[str, ...]
    caveats: str = ""
    threshold_free: ThresholdFreeMetrics | None = None

    @property
    def unreviewed(self) -> str:
        """The caveat of annotations that were not reviewed; empty where they were."""
        return next((line for line in self.caveats.splitlines() if line.startswith(NOT_REVIEWED)), "")


def read_tables(run: Path, *, histograms: bool = True) -> tuple[pa.Table, pa.Table]:
    """The run's objects and frames, whole, in memory; `open_tables` reads runs of any size.

    Args:
        run: folder of the run, or of its results by a protocol.
        histograms: with those over the likelihood, which take ten times the rest of a frame's row.

    Raises:
        DataError: missing or damaged.
    """
    objects, frames = open_tables(results_folder(run))
    names = [name for name in FRAMES_SCHEMA.names if histograms or name not in HISTOGRAMS]
    return objects.table(OBJECTS_SCHEMA.names), frames.table(names)


def failed_images(frames: RowSource) -> list[str]:
    """One line for each image that could not be used, in the order of recording, camera and time."""
    failed = []
    for rows in read_parts(frames, [*IMAGE, "status", "problem"]):
        failed += sort_rows(rows[rows["status"] == FAILED], IMAGE)["problem"].tolist()
    return failed


def reference_digest(objects: RowSource, frames: RowSource) -> str:
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

    It may be of the images only that it has in common with other runs: objects, frames, sums and metrics are then of
    these, the summary is of the whole run.

    Attributes:
        folder: of the run.
        label: what tables call it.
        manifest: what the run is.
        summary: its metrics, and how they came about.
        protocol: its rules.
        common: frames of the runs whose common images it is of; empty for all of its own.
    """

    folder: Path
    label: str
    manifest: Manifest
    summary: RunSummary
    protocol: Protocol
    common: Sequence[RowSource] = ()

    @cached_property
    def _tables(self) -> Sequence[RowSource]:
        tables = open_tables(self.folder)
        return [RowsOnCommonImages(rows, self.common) for rows in tables] if self.common else tables

    @property
    def objects(self) -> RowSource:
        """Rows of `OBJECTS_SCHEMA`, on disk."""
        return self._tables[0]

    @property
    def frames(self) -> RowSource:
        """Rows of `FRAMES_SCHEMA`, on disk."""
        return self._tables[1]

    @cached_property
    def sums(self) -> pd.DataFrame:
        """Table of sums: as it is stored, or of the rows that were chosen."""
        if not self.common:
            return read_sums(self.folder / SUMS)
        return sum_run(self.objects, self.frames, protocol=self.protocol)

    @cached_property
    def metrics(self) -> Summary:
        """Metrics of these rows; the summary itself for all of them."""
        return summary_of(self.sums, protocol=self.protocol) if self.common else self.summary

    @property
    def answers(self) -> Path:
        """Folder of the answers: those of an oracle lie beside the results, those of a method above."""
        own = self.folder / ANSWERS
        return own if own.is_dir() else self.folder.parent / ANSWERS


def find_answer(answers: Path, recording: str, camera: str, timestamp_ns: int) -> Answer | None:
    """What was answered of an image; None where there is no such image.

    Args:
        answers: folder of a run's answers.
        recording: name.
        camera: name.
        timestamp_ns: of the image.

    Raises:
        DataError: the answers are damaged.
    """
    for file in sorted((answers / safe_name(recording)).glob(f"{safe_name(camera)}-{'[0-9]' * 8}.parquet")):
        if rows := read_answers(file, timestamp_ns=timestamp_ns):
            return rows[0]
    return None


def results_folder(folder: Path) -> Path:
    """The folder of results that a folder stands for: itself, or of a run that by surface-v1, or its only one.

    Raises:
        DataError: there are none, or several others.
    """
    if (folder / SUMMARY).is_file():
        return folder
    names = sorted(file.parent.name for file in folder.glob(f"*/{SUMMARY}"))
    if USUAL_PROTOCOL in names:
        return folder / USUAL_PROTOCOL
    if len(names) != 1:
        if names:
            got, hint = f"those by {', '.join(names)}", f"name one of them, as {folder / names[0]}"
        elif folder.is_dir():
            got, hint = f"no {SUMMARY}", "end the run, where it was interrupted, by the same command"
        else:
            got, hint = ("a file", "unpack an archive first") if folder.exists() else ("no such folder", "run first")
        raise DataError(folder, expected="the folder of a finished run", got=got, hint=hint)
    return folder / names[0]


def run_name(results: Path) -> str:
    """Name of a run, with that of the protocol behind it unless the run's folder stands for these results."""
    place = results.resolve()
    alone = place.name == USUAL_PROTOCOL or len([*place.parent.glob(f"*/{COUNTS}")]) <= 1
    return place.parent.name if alone else f"{place.parent.name}-{place.name}"


def read_run(folder: Path, *, label: str | None = None) -> StoredRun:
    """Read the results of a run.

    Args:
        folder: of the run or of its results by a protocol; see `results_folder`.
        label: what tables call it; None for the run's name.

    Raises:
        DataError: a file is missing, damaged, or of another run.
    """
    folder = results_folder(folder)
    summary, manifest = read_json(RunSummary, folder / SUMMARY), read_json(Manifest, folder / MANIFEST)
    file = folder / PROTOCOL
    if not file.is_file():
        raise DataError(file, expected="the protocol of a run", got="no such file")
    protocol = load_protocol(file)  # JSON is YAML
    if protocol.digest != manifest.protocol.digest:
        expected = f"the protocol of {MANIFEST}, with digest {short_digest(manifest.protocol.digest)}"
        got = f"{protocol.name!r} with digest {short_digest(protocol.digest)}"
        raise DataError(file, expected=expected, got=got)
    name = label or run_name(folder)
    return StoredRun(folder=folder, label=name, manifest=manifest, summary=summary, protocol=protocol)


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
    """Write the small files of results, whose counts and sums lie in their folder; NaN becomes null.

    Args:
        folder: of the results.
        metrics: of the counts.
        manifest: what the run is, but for the digest of its reference.
        protocol: its rules.
        provenance: as in `RunSummary`, like what follows.
        failures: one line each.
        caveats: of the data.
        vehicle_outline_m: of the ego vehicle.
    """
    objects, frames = open_tables(folder)
    manifest = manifest.model_copy(update={"reference": reference_digest(objects, frames)})
    write_text(folder / PROTOCOL, protocol.model_dump_json(indent=1, exclude_unset=True) + "\n")
    write_manifest(folder / MANIFEST, manifest)
    summary = RunSummary(
        **{name: getattr(metrics, name) for name in type(metrics).model_fields},
        schema_version=1,
        provenance=provenance,
        vehicle_outline_m=vehicle_outline_m,
        failures=tuple(failures),
        caveats=caveats,
        threshold_free=threshold_free_metrics(frames),
    )
    write_text(folder / SUMMARY, summary.model_dump_json(indent=1) + "\n")
    return StoredRun(folder=folder, label=run_name(folder), manifest=manifest, summary=summary, protocol=protocol)


def _csv(table: pa.Table, *, heading: bool) -> bytes:
    text = io.BytesIO()
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=heading))
    return text.getvalue()

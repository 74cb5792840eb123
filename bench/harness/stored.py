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
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property, partial
from pathlib import Path
from time import perf_counter
from typing import Literal

import pandas as pd
import pyarrow as pa
import pyarrow.csv
from pydantic import BaseModel, ConfigDict

from bench.atomic import write_text
from bench.errors import DataError, UsageError
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import EVALUATED, IMAGE, OBJECT, merge_rows, sort_rows
from bench.evaluation.summary import Summary, not_annotated, summary_of
from bench.evaluation.sums import read_sums, sum_run, write_sums
from bench.evaluation.thresholds import HISTOGRAM_COLUMNS, IMAGES_AT_ONCE, ThresholdFreeMetrics, threshold_free_metrics
from bench.execution import largest_resident_mb
from bench.harness.answers import ANSWERS, FAILED, Answer, read_answers, safe_name
from bench.harness.counts import COLUMNS, COUNTS, TABLES, TableName, read_counts, read_parts, stored_recordings
from bench.harness.digests import short_digest
from bench.harness.manifest import MANIFEST, Manifest, write_manifest
from bench.plain_text import listed
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
REFERENCE_COLUMNS: dict[TableName, list[str]] = {
    "objects": [
        *OBJECT,
        *("object_class", "status", "reason", "category", "direction", "points", "polygon_px", "region_px"),
    ],
    "frames": [*IMAGE, "status", "valid_px", "reference_px", "ignored_px"],
}


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


def reference_digest(parts: Callable[[TableName, Sequence[str]], Iterator[pd.DataFrame]]) -> str:
    """SHA-256 over the columns that the method has no part in, some recordings in memory at a time.

    Args:
        parts: reads a table, as `StoredRun.parts`.
    """
    digest = hashlib.sha256()
    for table, columns in REFERENCE_COLUMNS.items():
        whole, key = TABLES[table]
        schema = pa.schema([whole.field(name) for name in columns])
        digest.update(_csv(schema.empty_table(), heading=True))
        for rows in parts(table, columns):
            digest.update(_csv(pa.Table.from_pandas(sort_rows(rows, key), schema, preserve_index=False), heading=False))
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
        common: the images that it is of, columns `IMAGE`; None for all of its own.
    """

    folder: Path
    label: str
    manifest: Manifest
    summary: RunSummary
    protocol: Protocol
    common: pd.DataFrame | None = None

    def parts(
        self, table: TableName, columns: Sequence[str] | None = None, *, rows_at_once: int | None = None
    ) -> Iterator[pd.DataFrame]:
        """The rows of a table, some whole recordings at a time, as of `read_parts`."""
        names = list(COLUMNS[table] if columns is None else columns)
        if self.common is None:
            yield from read_parts(self.folder, table, names, rows_at_once=rows_at_once)
            return
        for rows in read_parts(self.folder, table, list(dict.fromkeys([*names, *IMAGE])), rows_at_once=rows_at_once):
            yield merge_rows(rows, self.common, on=IMAGE)[names]

    def objects(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Rows of `OBJECTS_SCHEMA`, in memory."""
        return pd.concat(self.parts("objects", columns), ignore_index=True)

    def frames(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Rows of `FRAMES_SCHEMA`, in memory; without the histograms unless these are named."""
        return pd.concat(self.parts("frames", columns), ignore_index=True)

    def evaluated(self, table: TableName, columns: Sequence[str] | None = None) -> Iterator[pd.DataFrame]:
        """The evaluated rows of a table, a recording at a time."""
        return (self.evaluated_of(name, table, columns) for name in stored_recordings(self.folder))

    def evaluated_of(self, recording: str, table: TableName, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """The evaluated rows of a recording; none where it has no counts."""
        chosen = list(COLUMNS[table] if columns is None else columns)
        rows = read_counts(self.folder, table, recording, list(dict.fromkeys([*chosen, *IMAGE, "status"])))
        rows = rows[rows["status"] == EVALUATED]
        return (rows if self.common is None else merge_rows(rows, self.common, on=IMAGE))[chosen]

    def histograms(self) -> Iterator[pd.DataFrame]:
        """The columns of frames that `bench.evaluation.thresholds` reads, some whole recordings at a time."""
        return self.parts("frames", HISTOGRAM_COLUMNS, rows_at_once=IMAGES_AT_ONCE)

    @cached_property
    def sums(self) -> pd.DataFrame:
        """Table of sums: as it is stored, or of the rows that were chosen."""
        if self.common is None:
            return read_sums(self.folder / SUMS)
        return sum_run(self.parts("objects"), self.parts("frames"), protocol=self.protocol)

    @cached_property
    def metrics(self) -> Summary:
        """Metrics of these rows; the summary itself for all of them."""
        return summary_of(self.sums, protocol=self.protocol) if self.common is not None else self.summary

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


def write_results(
    folder: Path,
    *,
    manifest: Manifest,
    protocol: Protocol,
    provenance: Provenance,
    failures: Sequence[str] = (),
    caveats: Sequence[str] = (),
    vehicle_outline_m: tuple[tuple[float, float], ...] = (),
) -> StoredRun:
    """Reduce the counts of a run to its sums and its summary, and store what they are of; NaN becomes null.

    Args:
        folder: of the results.
        manifest: what the run is, but for the digest of its reference.
        protocol: its rules.
        provenance: how the answers came about.
        failures: one line for each recording and task that could not be used; those of images are added.
        caveats: of the data, in lines.
        vehicle_outline_m: as in `RunSummary`.

    Raises:
        DataError: counts are damaged.
    """
    sums = sum_run(read_parts(folder, "objects"), read_parts(folder, "frames"), protocol=protocol)
    metrics = summary_of(sums, protocol=protocol)
    scored, told = metrics.images.evaluated + metrics.images.not_annotated, [*failures]
    rows = pd.concat(read_parts(folder, "frames", [*IMAGE, "status", "problem"]))
    problems = sort_rows(rows[rows["status"] == FAILED], IMAGE)["problem"].tolist()
    if not (scored or problems):
        reasons = [f"{problem} ({count})" for problem, count in metrics.images.problems.items()]
        told.append(f"no image was scored; {listed(reasons)}" if reasons else "no image was scored")
    manifest = manifest.model_copy(update={"reference": reference_digest(partial(read_parts, folder))})
    histograms = read_parts(folder, "frames", HISTOGRAM_COLUMNS, rows_at_once=IMAGES_AT_ONCE)
    summary = RunSummary(
        **{name: getattr(metrics, name) for name in type(metrics).model_fields},
        schema_version=1,
        provenance=provenance.model_copy(update={"images": scored}),
        vehicle_outline_m=vehicle_outline_m,
        failures=(*told, *problems),
        caveats="\n".join(filter(None, (not_annotated(metrics), *caveats))),
        threshold_free=threshold_free_metrics(histograms),
    )
    write_sums(sums, folder / SUMS)
    write_text(folder / PROTOCOL, protocol.model_dump_json(indent=1, exclude_unset=True) + "\n")
    write_manifest(folder / MANIFEST, manifest)
    write_text(folder / SUMMARY, summary.model_dump_json(indent=1) + "\n")
    return StoredRun(folder=folder, label=run_name(folder), manifest=manifest, summary=summary, protocol=protocol)


def _csv(table: pa.Table, *, heading: bool) -> bytes:
    text = io.BytesIO()
    pyarrow.csv.write_csv(table, text, pyarrow.csv.WriteOptions(include_header=heading))
    return text.getvalue()

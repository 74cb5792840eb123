"""The files of a run: written once, atomically; everything above reads only these.

```
<run>/units/                                                                           see `bench.harness.unit_files`
<run>/objects.parquet, frames.parquet, image_maps.npz, summary.json                    the whole run
<run>/protocol.json                                                                    the rules that it was scored by
```

Runs of older versions are read for ever: columns that came later are null in them, files that came later are missed by
name.
"""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from pathlib import Path
from typing import Literal, get_args

import pyarrow as pa
import pyarrow.csv
from pydantic import Field

from bench.errors import DataError
from bench.evaluation import (
    ImageMap,
    ObjectFigures,
    Protocol,
    Summary,
    ThresholdFreeFigures,
    load_protocol,
    threshold_free_figures,
)
from bench.evaluation.likelihood import COLUMNS as THRESHOLD_FREE_COLUMNS
from bench.evaluation.row_source import Rows, as_source, read_parts
from bench.evaluation.slices import Columns
from bench.evaluation.sums import level_ratios
from bench.harness.map_files import load_image_maps
from bench.harness.method_stamp import MethodStamp
from bench.harness.provenance import Provenance
from bench.harness.stored_rows import HISTOGRAMS, open_tables
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
        files: SHA-256 of the tables that the figures are of, by name; empty in runs of older versions.
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


def read_threshold_free(run: Path) -> ThresholdFreeFigures | None:
    """Take the threshold-free figures of a run from its frames, some hundred of them in memory at a time.

    Raises:
        DataError: the frames are missing or damaged.
    """
    _, frames = open_tables(run)
    return threshold_free_figures(frames.batches(THRESHOLD_FREE_COLUMNS, rows=BATCH_IMAGES))


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
        DataError: missing, not a protocol, or the summary is of another one or lacks its figures.
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
    figures = {*ObjectFigures.model_fields, *level_ratios(protocol.scoring.detection_levels)}
    if rows != summary.categories.keys():
        got = ", ".join(summary.categories)
        raise DataError(run / SUMMARY, field="categories", expected=", ".join(sorted(rows)), got=got)
    for name, row in (*summary.categories.items(), ("all_moving", summary.all_moving)):
        if missing := sorted(figures - set(row.figure_names()) - {"object_frames", "tracks", "recordings"}):
            raise DataError(run / SUMMARY, field=name, expected="the figures of its protocol", got=f"no {missing[0]}")
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
    """Write `summary.json`; NaN becomes null."""
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

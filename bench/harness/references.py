"""References as files in the user's cache: built once for any number of methods, read in a millisecond.

`<cache>/references/<digest>/<camera>-<first image>.parquet` has a row for each image of a task. The digest is of the
recording's content, the protocol's rules for references and the code that builds them, so that nothing there is ever
out of date; the folder may be removed at any time.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import shapely
from numpy.typing import NDArray
from platformdirs import user_cache_path

from bench.errors import BenchError, OutputError
from bench.harness.answers import read_table, write_table
from bench.harness.digests import REFERENCE_CODE, code_digest, digest_of, library_versions
from bench.harness.stages import StageClock
from bench.recordings import ImageRef, Recording
from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.reference import ReferenceBuilder, ReferenceSettings

CACHE_VARIABLE = "FISHEYE_BENCH_CACHE"
LIMIT_BYTES = 4 << 30

_SAME = ("track_id", "object_class", "speed_mps", "range_m", "points", "polygon_px", "region_px", "unknown_px")
_ENUMS = {"status": Status, "reason": IgnoreReason, "category": Category, "direction": Direction}
_OBJECT = pa.struct(
    [
        *((name, pa.string()) for name in ("track_id", "object_class", *_ENUMS)),
        *((name, pa.float64()) for name in ("speed_mps", "range_m", "x_m", "y_m")),
        *((name, pa.int64()) for name in ("points", "polygon_px", "region_px", "unknown_px")),
        ("polygon", pa.binary()),  # WKB
    ]
)
# Pixels are runs of equal label and kind, in rows from the first pixel: where each begins, int32, and what it is.
REFERENCES_SCHEMA = pa.schema(
    [
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("ego_speed_mps", pa.float64()),
        ("annotated", pa.bool_()),
        ("height", pa.int32()),
        ("width", pa.int32()),
        ("starts", pa.binary()),  # int32
        ("labels", pa.binary()),  # int32
        ("kinds", pa.binary()),  # uint8, bits in the order of `_KINDS`
        ("objects", pa.list_(_OBJECT)),
    ]
)
_KINDS = ("ignored", "unknown", "left_out", "valid")
Row = Mapping[str, Any]


def cache_folder() -> Path:
    """The user's cache folder, or the one that the environment names."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named).absolute() if named else user_cache_path("fisheye-bench")


@dataclass(frozen=True, slots=True, eq=False)
class StoredReference:
    """The reference of an image, not unpacked yet, or the reason why there is none."""

    row: Row | None
    problem: BenchError | None = None

    def frame(self, recording: str) -> ReferenceFrame:
        """Unpack it.

        Args:
            recording: name.

        Raises:
            BenchError: there is none.
        """
        if self.problem is not None:
            raise self.problem
        assert self.row is not None, "a reference, or a problem"
        return _frame(self.row, recording)


def find_references(
    recording: Recording,
    images: Sequence[ImageRef],
    *,
    settings: Sequence[ReferenceSettings],
    digest: str,
    clock: StageClock,
) -> list[list[StoredReference]]:
    """The references of the images of a task, from the cache where they are there, else built and put there.

    Args:
        recording: the drive.
        images: of one camera, at least one.
        settings: of each protocol.
        digest: `RecordingDigests.reference` of the recording.
        clock: adds up the time that building takes.

    Returns:
        For each of `settings`, a reference for each image.
    """
    camera, key = images[0].camera, [images[0].timestamp_ns, images[-1].timestamp_ns, len(images)]
    code = digest_of(code_digest(REFERENCE_CODE), library_versions())
    files = [
        cache_folder() / "references" / digest_of(code, digest, one)[:32] / f"{digest_of(camera, key)[:32]}.parquet"
        for one in settings
    ]
    found = [_read(file) for file in files]
    builder: ReferenceBuilder | None = None
    for number, (file, one) in enumerate(zip(files, settings, strict=True)):
        if found[number] is None:
            with clock.stage("reference"):
                builder = ReferenceBuilder(recording, camera, one, beside=builder)
                found[number] = [_build(builder, image) for image in images]
            _write(file, found[number] or [])
    return [one or [] for one in found]


def evict_cache(limit_bytes: int = LIMIT_BYTES) -> None:
    """Remove the references that were used longest ago until the rest takes no more than a limit."""
    folders = [entry for entry in _entries(cache_folder() / "references") if entry.is_dir()]
    sizes = {folder: sum(entry.stat().st_size for entry in _entries(Path(folder.path))) for folder in folders}
    total = sum(sizes.values())
    for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime):
        if total <= limit_bytes:
            break
        shutil.rmtree(folder.path, ignore_errors=True)
        total -= sizes[folder]


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            return list(entries)
    except OSError:
        return []


def _read(file: Path) -> list[StoredReference] | None:
    """What a file of the cache holds; None where there is none that can be read."""
    try:
        rows = read_table(file, schema=REFERENCES_SCHEMA).to_pylist()
    except (OSError, pa.ArrowException):
        return None
    with suppress(OSError):
        os.utime(file.parent)  # it was used
    return [StoredReference(row) for row in rows]


def _write(file: Path, references: Sequence[StoredReference]) -> None:
    """Put references into the cache, unless some could not be built, or the cache cannot be written."""
    if not any(reference.problem for reference in references):
        table = pa.Table.from_pylist([dict(reference.row or {}) for reference in references], REFERENCES_SCHEMA)
        with suppress(OutputError):
            write_table(file, table)


def _build(builder: ReferenceBuilder, image: ImageRef) -> StoredReference:
    try:
        return StoredReference(_row(builder.build(image)))
    except BenchError as error:
        return StoredReference(None, error)


def _row(frame: ReferenceFrame) -> Row:
    kinds = np.zeros(frame.valid.size, dtype=np.uint8)
    for bit, name in enumerate(_KINDS):
        kinds |= getattr(frame, name).ravel().view(np.uint8) << bit
    labels = frame.labels.ravel()
    starts = np.flatnonzero(np.r_[True, (kinds[1:] != kinds[:-1]) | (labels[1:] != labels[:-1])])
    return {
        "camera": frame.camera,
        "timestamp_ns": frame.timestamp_ns,
        "ego_speed_mps": frame.ego_speed_mps,
        "annotated": frame.annotated,
        "height": frame.valid.shape[0],
        "width": frame.valid.shape[1],
        "starts": starts.astype(np.int32).tobytes(),
        "labels": labels[starts].astype(np.int32).tobytes(),
        "kinds": kinds[starts].tobytes(),
        "objects": [_object_row(item) for item in frame.objects],
    }


def _object_row(item: ReferenceObject) -> Row:
    return {
        **{name: getattr(item, name) for name in _SAME},
        **{name: None if getattr(item, name) is None else getattr(item, name).value for name in _ENUMS},
        "x_m": float(item.centroid_m[0]),
        "y_m": float(item.centroid_m[1]),
        "polygon": None if item.polygon is None else item.polygon.wkb,
    }


def _frame(row: Row, recording: str) -> ReferenceFrame:
    """The reference again, equal in every value."""
    shape = row["height"], row["width"]
    starts = np.frombuffer(row["starts"], dtype=np.int32)
    lengths = np.diff(starts, append=shape[0] * shape[1])

    def spread(content: bytes, kind: type[np.generic]) -> NDArray[Any]:
        return np.repeat(np.frombuffer(content, dtype=kind), lengths).reshape(shape)

    kinds = spread(row["kinds"], np.uint8)
    return ReferenceFrame(
        recording=recording,
        camera=row["camera"],
        timestamp_ns=row["timestamp_ns"],
        ego_speed_mps=row["ego_speed_mps"],
        objects=tuple(_object(item) for item in row["objects"]),
        labels=spread(row["labels"], np.int32),
        **{name: (kinds >> bit & 1) > 0 for bit, name in enumerate(_KINDS)},
        annotated=row["annotated"],
    )


def _object(row: Row) -> ReferenceObject:
    enums: dict[str, Any] = {name: None if row[name] is None else kind(row[name]) for name, kind in _ENUMS.items()}
    return ReferenceObject(
        **{name: row[name] for name in _SAME},
        **enums,
        centroid_m=np.array([row["x_m"], row["y_m"]]),
        polygon=None if row["polygon"] is None else shapely.from_wkb(row["polygon"]),
    )

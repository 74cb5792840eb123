"""References as files in the user's cache: built once for any number of methods, read in a millisecond.

`<cache>/references/<digest>/<camera>-<first image>.parquet` has a row for each image of a task. The digest is of the
recording's content, the protocol's rules for references and the code that builds them, so that nothing there is ever
out of date; the folder may be removed at any time.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
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
from bench.recordings import ImageRef, Recording
from bench.records.reference import Category, Direction, IgnoreReason, ReferenceFrame, ReferenceObject, Status
from bench.records.rules import ReferenceSettings
from bench.reference import ReferenceBuilder

CACHE_VARIABLE = "FISHEYE_BENCH_CACHE"
LIMIT_BYTES = 4 << 30

_ENUMS = {"status": Status, "reason": IgnoreReason, "category": Category, "direction": Direction}
_KINDS = ("ignored", "unknown", "left_out", "valid")
# Pixels are runs of equal label and kind, in rows from the first pixel: where each begins, int32, and what it is.
REFERENCES_SCHEMA = pa.schema(
    [
        ("problem", pa.string()),  # why there is none; then all else is null
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("ego_speed_mps", pa.float64()),
        ("annotated", pa.bool_()),
        ("height", pa.int32()),
        ("width", pa.int32()),
        ("starts", pa.binary()),  # int32
        ("labels", pa.binary()),  # int32
        ("kinds", pa.binary()),  # uint8, bits in the order of `_KINDS`
        ("objects", pa.string()),  # JSON: the fields of each, polygons as WKB in hexadecimal digits
    ]
)
StoredReference = Mapping[str, Any]  # a row of `REFERENCES_SCHEMA`; what is missing is null


def cache_folder() -> Path:
    """The user's cache folder, or the one that the environment names."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named).absolute() if named else user_cache_path("fisheye-bench")


def message_without_root(error: BaseException, recording: Recording) -> str:
    """The message of an error, the same wherever the data lie."""
    return str(error).replace(str(recording.root), recording.name)


def find_references(
    recording: Recording, images: Sequence[ImageRef], *, settings: Sequence[ReferenceSettings], digest: str
) -> list[list[StoredReference]]:
    """The references of the images of a task, from the cache where they are there, else built and put there.

    Args:
        recording: the drive.
        images: of one camera, at least one.
        settings: of each protocol.
        digest: `RecordingDigests.reference` of the recording.

    Returns:
        For each of `settings`, a row for each image, which `reference_of` unpacks.
    """
    camera, key = images[0].camera, [images[0].timestamp_ns, images[-1].timestamp_ns, len(images)]
    code = digest_of(code_digest(REFERENCE_CODE), library_versions())
    builder: ReferenceBuilder | None = None
    references = []
    for rules in settings:
        folder = cache_folder() / "references" / digest_of(code, digest, rules)[:32]
        file = folder / f"{digest_of(camera, key)[:32]}.parquet"
        rows = _read(file)
        if rows is None:
            builder = ReferenceBuilder(recording, camera, rules, beside=builder)
            rows = [_built(builder, image) for image in images]
            if not any("problem" in row for row in rows):
                with suppress(OutputError):
                    write_table(file, pa.Table.from_pylist([dict(row) for row in rows], REFERENCES_SCHEMA))
        references.append(rows)
    return references


def reference_of(row: StoredReference, recording: str) -> ReferenceFrame:
    """Unpack a reference, equal in every value to that which was built.

    Args:
        row: of the image.
        recording: name.

    Raises:
        BenchError: there is none.
    """
    if row.get("problem") is not None:
        raise BenchError(row["problem"])
    shape = row["height"], row["width"]
    starts = np.frombuffer(row["starts"], dtype=np.int32)
    lengths = np.diff(starts, append=shape[0] * shape[1])

    def spread(content: bytes, kind: type[np.generic]) -> NDArray[Any]:
        return np.repeat(np.frombuffer(content, dtype=kind), lengths).reshape(shape)

    kinds = spread(row["kinds"], np.uint8)
    return ReferenceFrame(
        recording=recording,
        objects=tuple(_object(item) for item in json.loads(row["objects"])),
        labels=spread(row["labels"], np.int32),
        camera=row["camera"],
        timestamp_ns=row["timestamp_ns"],
        ego_speed_mps=row["ego_speed_mps"],
        annotated=row["annotated"],
        **{name: (kinds >> bit & 1) > 0 for bit, name in enumerate(_KINDS)},
    )


def evict_cache() -> None:
    """Remove the references that were used longest ago until the rest takes no more than `LIMIT_BYTES`."""
    with suppress(FileNotFoundError):  # another process does the same
        folders = [folder for folder in (cache_folder() / "references").glob("*") if folder.is_dir()]
        sizes = {folder: sum(file.stat().st_size for file in folder.iterdir()) for folder in folders}
        total = sum(sizes.values())
        for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime):
            if total <= LIMIT_BYTES:
                break
            shutil.rmtree(folder, ignore_errors=True)
            total -= sizes[folder]


def _read(file: Path) -> list[StoredReference] | None:
    """What a file of the cache holds; None where there is none that can be read."""
    try:
        rows: list[StoredReference] = read_table(file, schema=REFERENCES_SCHEMA).to_pylist()
    except (OSError, pa.ArrowException):
        return None
    with suppress(OSError):
        os.utime(file.parent)  # it was used
    return rows


def _built(builder: ReferenceBuilder, image: ImageRef) -> StoredReference:
    try:
        return reference_row(builder.build(image))
    except BenchError as error:
        return {"problem": message_without_root(error, builder.recording)}


def reference_row(frame: ReferenceFrame) -> StoredReference:
    """Pack a reference."""
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
        "objects": json.dumps([_object_row(item) for item in frame.objects]),
    }


def _object_row(item: ReferenceObject) -> dict[str, Any]:
    row = {name: getattr(item, name) for name in ReferenceObject.__slots__}
    outline = None if item.polygon is None else item.polygon.wkb_hex
    return row | {"centroid_m": item.centroid_m.tolist(), "polygon": outline}


def _object(row: dict[str, Any]) -> ReferenceObject:
    enums: dict[str, Any] = {name: None if row[name] is None else kind(row[name]) for name, kind in _ENUMS.items()}
    polygon = None if row["polygon"] is None else shapely.from_wkb(row["polygon"])
    return ReferenceObject(**{**row, **enums, "centroid_m": np.array(row["centroid_m"]), "polygon": polygon})

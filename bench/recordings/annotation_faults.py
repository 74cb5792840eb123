"""Everything that is wrong with an annotation file."""

from __future__ import annotations

from pathlib import Path

from bench.errors import DataError
from bench.recordings import openlabel
from bench.recordings.annotations import read_state
from bench.recordings.validation import MOST_FAULTS, salvage_json


def annotation_faults(file: Path) -> tuple[DataError, ...]:
    """All that `read_annotations` would refuse; at most 200.

    Faults of a value come first: only a file without any is searched for objects and frames that do not fit together.
    """
    read, faults = salvage_json(openlabel.AnnotationFile, file)
    if read is None:
        return faults
    content = read.openlabel
    found: list[DataError] = []
    seen: set[tuple[str, int]] = set()
    for number, frame in content.frames.items():
        timestamp_ns = frame.frame_properties.timestamp
        for uid, entry in frame.objects.items():
            field = f"openlabel.frames.{number}.objects.{uid}"
            if uid not in content.objects:
                found.append(
                    DataError(file, field=field, expected="an object listed under openlabel.objects", got=repr(uid))
                )
            if (uid, timestamp_ns) in seen:
                found.append(
                    DataError(file, field=field, expected="one frame for each time", got=f"{timestamp_ns} twice")
                )
            seen.add((uid, timestamp_ns))
            try:
                read_state(entry.object_data, timestamp_ns, file=file, field=field)
            except DataError as error:
                found.append(error)
    return tuple(found[:MOST_FAULTS])

"""The two tables of a run: one row per annotated object in an image, one row per image; and how they are read.

No metric needs rows of two recordings at once. So a run may be larger than the memory: its tables are read in parts of
whole recordings.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. Runs
compare on the images that all of them scored: `CommonImages`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from bench.evaluation.counts import FrameCounts, ObjectCounts
from bench.evaluation.likelihood import OUTSIDE_COLUMN, REFERENCE_COLUMN
from bench.records.reference import ReferenceFrame, Status

Row = dict[str, Any]

IMAGE = ["recording", "camera", "timestamp_ns"]
OBJECT = [*IMAGE, "track_id"]
EVALUATED, NOT_ANNOTATED = "evaluated", "not_annotated"
ROWS_AT_ONCE = 100_000  # in memory, unless one recording has more
_IMAGE_KEY = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]

# One row per annotated object per image, whatever its status. `tp`, `fn`, `fp`, `region_px` and `unknown_px` (pixels
# beside the region that may be the object's) are 0 unless evaluated.
# `ceiling_tp` and `ceiling_fp` are what the exact masks would have got; null unless evaluated and without exact masks.
# `chance_tp` is null unless evaluated and where the recording is too short for another mask. Unknown speeds and places
# are NaN, categories, directions and reasons that do not apply are null.
OBJECTS_SCHEMA = pa.schema(
    [
        *_IMAGE_KEY,
        ("track_id", pa.string()),
        ("object_class", pa.string()),
        ("status", pa.string()),
        ("reason", pa.string()),
        ("category", pa.string()),
        ("direction", pa.string()),
        ("range_m", pa.float64()),
        ("x_m", pa.float64()),
        ("y_m", pa.float64()),
        ("speed_mps", pa.float64()),
        ("ego_speed_mps", pa.float64()),
        ("points", pa.int64()),
        ("polygon_px", pa.int64()),
        ("region_px", pa.int64()),
        ("tp", pa.int64()),
        ("fn", pa.int64()),
        ("fp", pa.int64()),
        ("chance_tp", pa.int64()),
        ("unknown_px", pa.int64()),
        ("ceiling_tp", pa.int64()),
        ("ceiling_fp", pa.int64()),
    ]
)

_FRAME_COUNTS = tuple(field.name for field in fields(FrameCounts) if field.name != "fp_by_cause")

# One row per image. All counts are 0 where there is no mask; an image that is not annotated has those of its mask and
# of V only. `fp_by_cause` is empty for a method that names no causes. The histograms over
# `bench.evaluation.likelihood.EDGES` are null unless evaluated and where the method has no likelihood.
FRAMES_SCHEMA = pa.schema(
    [
        *_IMAGE_KEY,
        ("ego_speed_mps", pa.float64()),
        ("status", pa.string()),
        ("problem", pa.string()),
        *[(name, pa.int64()) for name in _FRAME_COUNTS],
        ("undefined_px", pa.int64()),
        ("fp_by_cause", pa.map_(pa.string(), pa.int64())),
        (REFERENCE_COLUMN, pa.list_(pa.int64())),
        (OUTSIDE_COLUMN, pa.list_(pa.int64())),
    ]
)


class RowSource(Protocol):
    """A table of a run, wherever it lies."""

    def recordings(self) -> Mapping[str, int]:
        """Most rows that each recording can have, by name."""
        ...

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, as `to_frame` makes them, in any order."""
        ...


Rows: TypeAlias = pa.Table | RowSource
JoinHow: TypeAlias = Literal["inner", "outer"]


def to_frame(table: pa.Table) -> pd.DataFrame:
    """Rows for pandas; maps are dictionaries, numbers with nulls float64."""
    frame: pd.DataFrame = table.to_pandas(maps_as_pydicts="strict")
    return frame


@dataclass(frozen=True, slots=True, eq=False)
class TableRows:
    """A table in memory."""

    table: pa.Table

    def recordings(self) -> dict[str, int]:
        """Rows of each recording, by name."""
        return {one["values"]: one["counts"] for one in pc.value_counts(self.table["recording"]).to_pylist()}

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """All rows of some recordings, in the order of the table."""
        wanted = pc.is_in(self.table["recording"], value_set=pa.array(recordings, pa.string()))
        return to_frame(self.table.select(list(columns)).filter(wanted))


def as_source(rows: Rows) -> RowSource:
    """A table in memory as a source; a source as it is."""
    return TableRows(rows) if isinstance(rows, pa.Table) else rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChosenRows:
    """Those rows of a source that have a word in a column."""

    source: RowSource
    column: str
    word: str

    def recordings(self) -> Mapping[str, int]:
        """Most rows that each recording can have, by name."""
        return self.source.recordings()

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """The chosen rows of some recordings."""
        rows = self.source.read(recordings, list(dict.fromkeys([*columns, self.column])))
        return rows.loc[rows[self.column] == self.word, list(columns)]


@dataclass(frozen=True, slots=True, eq=False)
class CommonImages:
    """The images that all of several runs scored, by the frames of each run."""

    frames: Sequence[RowSource]

    def recordings(self) -> dict[str, int]:
        """Most images that each recording of all runs can have, by name."""
        first, *others = (rows.recordings() for rows in self.frames)
        return {name: count for name, count in first.items() if all(name in other for other in others)}

    def of(self, recordings: Sequence[str]) -> pd.DataFrame:
        """The images of some recordings: columns `IMAGE`."""
        first, *others = (
            ChosenRows(source=rows, column="status", word=EVALUATED).read(recordings, IMAGE) for rows in self.frames
        )
        for other in others:
            first = merge_rows(first, other, on=IMAGE)[IMAGE]
        return first

    def count(self) -> int:
        """Count them, a few recordings at a time."""
        return sum(len(self.of(names)) for names in group_recordings(self.recordings()))


@dataclass(frozen=True, slots=True, eq=False)
class RowsOnImages:
    """Those rows of a run that are of some images."""

    source: RowSource
    images: CommonImages

    def recordings(self) -> dict[str, int]:
        """Most rows that each recording can have, by name."""
        common = self.images.recordings()
        return {name: count for name, count in self.source.recordings().items() if name in common}

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """The rows of some recordings."""
        rows = self.source.read(recordings, list(dict.fromkeys([*columns, *IMAGE])))
        return merge_rows(rows, self.images.of(recordings), on=IMAGE)[list(columns)]


def merge_rows(one: pd.DataFrame, other: pd.DataFrame, *, on: Sequence[str], how: JoinHow = "inner") -> pd.DataFrame:
    """Join rows by a key; columns that both have get the suffixes "_before" and "_after", `side` says who has a row."""
    words = {name: object for name in on if name != "timestamp_ns"}  # two empty columns of Arrow's strings do not merge
    sides = one.astype(words), other.astype(words)
    return sides[0].merge(sides[1], on=list(on), how=how, suffixes=("_before", "_after"), indicator="side")


def group_recordings(counts: Mapping[str, int], *, rows_at_once: int | None = None) -> list[list[str]]:
    """Recordings in sorted order, so many together that their rows fit; one with more rows stands alone."""
    groups: list[list[str]] = []
    held = 0
    for name in sorted(counts):
        if not groups or held + counts[name] > (rows_at_once or ROWS_AT_ONCE):
            groups.append([])
            held = 0
        groups[-1].append(name)
        held += counts[name]
    return groups


def read_parts(rows: Rows, columns: Sequence[str], *, rows_at_once: int | None = None) -> Iterator[pd.DataFrame]:
    """Whole recordings in sorted order, a few at a time; one part without rows where there is none at all.

    Args:
        rows: of a run, in memory or stored.
        columns: to read.
        rows_at_once: most rows of a part of several recordings; `ROWS_AT_ONCE` without it.
    """
    source = as_source(rows)
    for names in group_recordings(source.recordings(), rows_at_once=rows_at_once) or [[]]:
        yield source.read(names, columns)


def sort_rows(rows: pd.DataFrame, key: Sequence[str]) -> pd.DataFrame:
    """The rows by a key that names each once."""
    assert not rows.duplicated(list(key)).any(), f"{list(key)} names each row once"
    return rows.sort_values(list(key), ignore_index=True)


_OF_OBJECT = (
    "track_id", "object_class", "status", "reason", "category", "direction", "range_m", "speed_mps", "points",
    "polygon_px", "unknown_px",
)  # fmt: skip


def object_rows(
    reference: ReferenceFrame, counts: Sequence[ObjectCounts], *, ceiling: Sequence[ObjectCounts] | None = None
) -> list[Row]:
    """Rows of `OBJECTS_SCHEMA`, in the order of `reference.objects`; `chance_tp` is still missing.

    Args:
        reference: of the image.
        counts: one per object.
        ceiling: the same of the exact masks; None where nobody knows them.
    """
    image = _image_columns(reference)
    rows = []
    for number, (item, own) in enumerate(zip(reference.objects, counts, strict=True)):
        row = image | {name: getattr(item, name) for name in _OF_OBJECT} | asdict(own)
        row |= {"x_m": item.centroid_m[0], "y_m": item.centroid_m[1], "region_px": own.tp + own.fn}
        if ceiling is not None and item.status is Status.EVALUATED:
            row |= {"ceiling_tp": ceiling[number].tp, "ceiling_fp": ceiling[number].fp}
        rows.append(row)
    return rows


def frame_row(
    reference: ReferenceFrame, counts: FrameCounts, *, undefined_px: int, histograms: dict[str, NDArray[np.int64]]
) -> Row:
    """The row of `FRAMES_SCHEMA` of an image that was scored, or has a mask but no annotations to score it by.

    Args:
        reference: of the image.
        counts: of the image.
        undefined_px: pixels of V where the method could not say.
        histograms: of the likelihood, by column; none for a method without one.
    """
    status = EVALUATED if reference.annotated else NOT_ANNOTATED
    row = _image_columns(reference) | {"status": status, "undefined_px": undefined_px}
    return row | asdict(counts) | {"fp_by_cause": sorted(counts.fp_by_cause.items())} | histograms


def unscored_frame_row(
    *, recording: str, camera: str, timestamp_ns: int, status: Literal["failed", "skipped"], problem: str
) -> Row:
    """The row of `FRAMES_SCHEMA` of an image that could not be scored, with the reason in words."""
    row: Row = {"recording": recording, "camera": camera, "timestamp_ns": timestamp_ns, "ego_speed_mps": math.nan}
    row |= {"status": status, "problem": problem, "undefined_px": 0, "fp_by_cause": []}
    return row | dict.fromkeys(_FRAME_COUNTS, 0)


def objects_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`objects.parquet`; what a row does not have is null."""
    return pa.Table.from_pylist(list(rows), schema=OBJECTS_SCHEMA)


def frames_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`frames.parquet`; what a row does not have is null."""
    return pa.Table.from_pylist(list(rows), schema=FRAMES_SCHEMA)


def _image_columns(reference: ReferenceFrame) -> Row:
    return {name: getattr(reference, name) for name in (*IMAGE, "ego_speed_mps")}

"""The two tables of a run: one row per annotated object in an image, one row per image; and how they are read.

No metric needs rows of two recordings at once. So a run may be larger than the memory: its tables are read in parts of
whole recordings.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. Runs
compare on the images that all of them scored: `CommonImages`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, fields
from typing import Any, Literal, Protocol, TypeAlias

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from bench.evaluation.counts import OUTSIDE_COLUMN, REFERENCE_COLUMN, FrameCounts, ObjectCounts

Row = dict[str, Any]

IMAGE = ["recording", "camera", "timestamp_ns"]
OBJECT = [*IMAGE, "track_id"]
EVALUATED, NOT_ANNOTATED = "evaluated", "not_annotated"
IMAGE_STATUSES = (EVALUATED, "failed", "skipped", NOT_ANNOTATED)
ROWS_AT_ONCE = 100_000  # in memory, unless one recording has more
_IMAGE_KEY = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]


def _schema(columns: Iterable[tuple[str, pa.DataType]], *, nullable: Set[str]) -> pa.Schema:
    return pa.schema([pa.field(name, kind, nullable=name in nullable) for name, kind in columns])


# One row per annotated object per image, whatever its status. The counts, `region_px` and `unknown_px` (pixels
# beside the region that may be the object's) are 0 unless evaluated.
# `ceiling_tp` and `ceiling_fp` are what the exact masks would have got; null unless evaluated and without exact masks.
# `chance_tp` is null unless evaluated and where the recording is too short for another mask. Unknown speeds and places
# are NaN, categories, directions and reasons that do not apply are null.
OBJECTS_SCHEMA = _schema(
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
        *[(field.name, pa.int64()) for field in fields(ObjectCounts)],
        ("chance_tp", pa.int64()),
        ("unknown_px", pa.int64()),
        ("ceiling_tp", pa.int64()),
        ("ceiling_fp", pa.int64()),
    ],
    nullable={"reason", "category", "direction", "chance_tp", "ceiling_tp", "ceiling_fp"},
)

FRAME_COUNTS = tuple(field.name for field in fields(FrameCounts))

# One row per image. All counts are 0 where there is no mask; an image that is not annotated has those of its mask and
# of V only. `fp_by_cause` is `fp_px` by the cause that the method names, empty for one that names none. The histograms
# over `bench.evaluation.counts.EDGES` are null unless evaluated and where the method has no likelihood.
FRAMES_SCHEMA = _schema(
    [
        *_IMAGE_KEY,
        ("ego_speed_mps", pa.float64()),
        ("status", pa.string()),
        ("problem", pa.string()),
        *[(name, pa.int64()) for name in FRAME_COUNTS],
        ("undefined_px", pa.int64()),
        ("fp_by_cause", pa.map_(pa.string(), pa.int64())),
        (REFERENCE_COLUMN, pa.list_(pa.int64())),
        (OUTSIDE_COLUMN, pa.list_(pa.int64())),
    ],
    nullable={"problem", REFERENCE_COLUMN, OUTSIDE_COLUMN},
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
        read = [rows.read(recordings, [*IMAGE, "status"]) for rows in self.frames]
        first, *others = (rows.loc[rows["status"] == EVALUATED, IMAGE] for rows in read)
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


def pick(parts: Iterable[pd.DataFrame], choose: Callable[[pd.DataFrame], pd.DataFrame]) -> pd.DataFrame:
    """Return the few rows that are chosen of all parts, with one part in memory at a time.

    Args:
        parts: at least one, in the order of their key, so that a stable sort leaves equals in it.
        choose: of the rows that were chosen before and those of the next part.
    """
    found: pd.DataFrame | None = None
    for part in parts:
        found = choose(part if found is None else pd.concat([found, part], ignore_index=True))
    assert found is not None, "there is at least one part"
    return found


def sort_rows(rows: pd.DataFrame, key: Sequence[str]) -> pd.DataFrame:
    """The rows by a key that names each once."""
    assert not rows.duplicated(list(key)).any(), f"{list(key)} names each row once"
    return rows.sort_values(list(key), ignore_index=True)


def objects_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`objects.parquet`; what a row does not have is null."""
    return pa.Table.from_pylist(list(rows), schema=OBJECTS_SCHEMA)


def frames_table(rows: Iterable[Mapping[str, Any]]) -> pa.Table:
    """`frames.parquet`; what a row does not have is null."""
    return pa.Table.from_pylist(list(rows), schema=FRAMES_SCHEMA)

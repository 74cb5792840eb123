"""The two tables of a run: one row per annotated object in an image, one row per image; and how they are read.

No metric needs rows of two recordings at once. So a run may be larger than the memory: its tables are read in parts of
whole recordings.

Methods that need a longer history score fewer images of each recording, and an image may fail for one method only. Runs
compare on the images that all of them scored: `RowsOnCommonImages`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, fields
from typing import Any, Protocol

import pandas as pd
import pyarrow as pa

from bench.evaluation.counts import OUTSIDE_COLUMN, REFERENCE_COLUMN, FrameCounts, ObjectCounts

Row = dict[str, Any]

IMAGE = ["recording", "camera", "timestamp_ns"]
OBJECT = [*IMAGE, "track_id"]
EVALUATED, NOT_ANNOTATED = "evaluated", "not_annotated"
IMAGE_STATUSES = (EVALUATED, "failed", "skipped", NOT_ANNOTATED)
ROWS_AT_ONCE = 100_000  # in memory, unless one recording has more
IMAGE_COLUMNS = [("recording", pa.string()), ("camera", pa.string()), ("timestamp_ns", pa.int64())]


def _schema(columns: Iterable[tuple[str, pa.DataType]], *, nullable: Set[str]) -> pa.Schema:
    return pa.schema([pa.field(name, kind, nullable=name in nullable) for name, kind in columns])


# One row per annotated object per image, whatever its status. The counts, `region_px` and `unknown_px` (pixels
# beside the region that may be the object's) are 0 unless evaluated.
# `ceiling_tp` and `ceiling_fp` are what the exact masks would have got; null unless evaluated and without exact masks.
# `chance_tp` is null unless evaluated and where the recording is too short for another mask. Unknown speeds and places
# are NaN, categories, directions and reasons that do not apply are null.
OBJECTS_SCHEMA = _schema(
    [
        *IMAGE_COLUMNS,
        *[(name, pa.string()) for name in ("track_id", "object_class", "status", "reason", "category", "direction")],
        *[(name, pa.float64()) for name in ("range_m", "x_m", "y_m", "speed_mps", "ego_speed_mps")],
        *[(name, pa.int64()) for name in ("points", "polygon_px", "region_px")],
        *[(field.name, pa.int64()) for field in fields(ObjectCounts)],
        *[(name, pa.int64()) for name in ("chance_tp", "unknown_px", "ceiling_tp", "ceiling_fp")],
    ],
    nullable={"reason", "category", "direction", "chance_tp", "ceiling_tp", "ceiling_fp"},
)

FRAME_COUNTS = tuple(field.name for field in fields(FrameCounts))

# One row per image. All counts are 0 where there is no mask; an image that is not annotated has those of its mask and
# of V only. `fp_by_cause` is `fp_px` by the cause that the method names, empty for one that names none. The histograms
# over `bench.evaluation.counts.EDGES` are null unless evaluated and where the method has no likelihood.
FRAMES_SCHEMA = _schema(
    [
        *IMAGE_COLUMNS,
        ("ego_speed_mps", pa.float64()),
        *[(name, pa.string()) for name in ("status", "problem")],
        *[(name, pa.int64()) for name in (*FRAME_COUNTS, "undefined_px")],
        ("fp_by_cause", pa.map_(pa.string(), pa.int64())),
        *[(name, pa.list_(pa.int64())) for name in (REFERENCE_COLUMN, OUTSIDE_COLUMN)],
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


def to_frame(table: pa.Table) -> pd.DataFrame:
    """Rows for pandas; maps are dictionaries, numbers with nulls float64."""
    frame: pd.DataFrame = table.to_pandas(maps_as_pydicts="strict")
    return frame


@dataclass(frozen=True, slots=True, eq=False)
class RowsOnCommonImages:
    """The rows of a run that are of images which several runs scored.

    Attributes:
        rows: of the run.
        frames: rows of `FRAMES_SCHEMA` of each of the runs.
    """

    rows: RowSource
    frames: Sequence[RowSource]

    def recordings(self) -> dict[str, int]:
        """Most rows that each recording of all runs can have, by name."""
        runs = [frames.recordings() for frames in self.frames]
        return {name: count for name, count in self.rows.recordings().items() if all(name in run for run in runs)}

    def read(self, recordings: Sequence[str], columns: Sequence[str]) -> pd.DataFrame:
        """The rows of some recordings."""
        rows = self.rows.read(recordings, list(dict.fromkeys([*columns, *IMAGE])))
        for frames in self.frames:
            images = frames.read(recordings, [*IMAGE, "status"])
            rows = merge_rows(rows, images.loc[images["status"] == EVALUATED, IMAGE], on=IMAGE)
        return rows[list(columns)]


def merge_rows(one: pd.DataFrame, other: pd.DataFrame, *, on: Sequence[str]) -> pd.DataFrame:
    """The rows whose key both have; columns that both have get the suffixes "_before" and "_after"."""
    words = {name: object for name in on if name != "timestamp_ns"}  # two empty columns of Arrow's strings do not merge
    sides = one.astype(words), other.astype(words)
    return sides[0].merge(sides[1], on=list(on), suffixes=("_before", "_after"))


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


def read_parts(rows: RowSource, columns: Sequence[str], *, rows_at_once: int | None = None) -> Iterator[pd.DataFrame]:
    """Whole recordings in sorted order, a few at a time; one part without rows where there is none at all.

    Args:
        rows: of a run.
        columns: to read.
        rows_at_once: most rows of a part of several recordings; `ROWS_AT_ONCE` without it.
    """
    for names in group_recordings(rows.recordings(), rows_at_once=rows_at_once) or [[]]:
        yield rows.read(names, columns)


def read_pairs(
    before: RowSource, after: RowSource, columns: Sequence[str]
) -> Iterator[tuple[pd.DataFrame, pd.DataFrame]]:
    """The rows of two runs of the recordings that both have, a few at a time; at least one part, maybe without rows."""
    counts = before.recordings(), after.recordings()
    shared = {name: max(rows, counts[1][name]) for name, rows in counts[0].items() if name in counts[1]}
    for names in group_recordings(shared) or [[]]:
        yield before.read(names, columns), after.read(names, columns)


def count_rows(rows: RowSource) -> int:
    """Count the rows, a few recordings at a time."""
    return sum(len(part) for part in read_parts(rows, IMAGE))


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

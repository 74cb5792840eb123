"""A run reduced to sums, a few recordings in memory at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.columns import Columns
from bench.evaluation.ledger import RowLedger
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows, RowSource, as_source, read_parts
from bench.evaluation.slice_sums import SliceSums, place_sums, sum_slices
from bench.evaluation.slices import IMAGE, Split, frame_splits, object_splits
from bench.evaluation.terms import frame_terms, object_terms

OBJECT_COLUMNS = (
    *("recording", "camera", "timestamp_ns", "track_id", "object_class", "status", "reason", "category"),
    *("range_m", "ego_speed_mps", "points", "tp", "fn", "fp", "chance_tp"),
)
FRAME_COLUMNS = (
    *("recording", "camera", "timestamp_ns", "ego_speed_mps", "status", "problem", "width", "height", "valid_px"),
    *("tp_px", "fn_px", "fp_px", "fp_components", "fp_large_components", "fp_by_cause"),
)
EVALUATED = "evaluated"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunSums:
    """Everything that the figures, the score sheet and the ledgers of a run are made of.

    Attributes:
        recordings: S names of those with scored images, sorted.
        objects: split -> sums over the evaluated object-frames.
        frames: split -> sums over the scored image-frames.
        object_ledger: all rows of the objects table by status and reason.
        frame_ledger: all rows of the frames table by status and problem.
    """

    recordings: tuple[str, ...]
    objects: dict[str, SliceSums]
    frames: dict[str, SliceSums]
    object_ledger: RowLedger
    frame_ledger: RowLedger


def sum_run(objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None) -> RunSums:
    """Reduce the tables of a run.

    Neither the order of the rows nor `rows_at_once` changes a bit of the sums: those of a recording are taken over all
    of its rows in canonical order.

    Args:
        objects: of `OBJECTS_SCHEMA`.
        frames: of `FRAMES_SCHEMA`.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; `ROWS_AT_ONCE` without it.
    """
    of_objects, of_frames = as_source(objects), as_source(frames)
    cameras = of_frames.distinct("camera")
    levels = protocol.scoring.detection_levels

    frame_parts = _Parts()
    for part in _canonical_parts(of_frames, FRAME_COLUMNS, key=IMAGE, rows_at_once=rows_at_once):
        scored = frame_parts.account(part, reasons="problem")
        frame_parts.add(scored, frame_terms(scored), frame_splits(scored, protocol=protocol, cameras=cameras))

    object_parts = _Parts()
    for part in _canonical_parts(of_objects, OBJECT_COLUMNS, key=[*IMAGE, "track_id"], rows_at_once=rows_at_once):
        evaluated = object_parts.account(part, reasons="reason")
        splits = object_splits(evaluated, protocol=protocol, cameras=cameras)
        object_parts.add(evaluated, object_terms(evaluated, levels=levels), splits, tracks=True)

    recordings = tuple(sorted(frame_parts.recordings))
    assert object_parts.recordings <= set(recordings), "objects lie in scored images"
    return RunSums(
        recordings=recordings,
        objects=object_parts.placed(recordings),
        frames=frame_parts.placed(recordings),
        object_ledger=object_parts.ledger,
        frame_ledger=frame_parts.ledger,
    )


def _canonical_parts(
    source: RowSource, columns: Sequence[str], *, key: Sequence[str], rows_at_once: int | None
) -> Iterator[Columns]:
    # A run of nothing is one part without rows, so that its slices are there.
    if not source.recordings():
        yield Columns(source.read((), columns))
    for table in read_parts(source, columns, rows_at_once=rows_at_once):
        yield Columns(table).canonical(key)


class _Parts:
    """The sums of the parts of a table, as they come."""

    def __init__(self) -> None:
        self.recordings: set[str] = set()
        self.ledger = RowLedger(statuses=Counter(), reasons=Counter())
        self._held: list[tuple[tuple[str, ...], dict[str, SliceSums]]] = []

    def account(self, part: Columns, *, reasons: str) -> Columns:
        """Count all rows of a part by status and reason; return those that are scored."""
        self.ledger = self.ledger.with_rows(part, reasons=reasons)
        return part.take(part.is_word("status", EVALUATED))

    def add(
        self, rows: Columns, terms: dict[str, NDArray[np.float64]], splits: dict[str, Split], *, tracks: bool = False
    ) -> None:
        """Take in the scored rows of a part."""
        codes, names = rows.words("recording")
        numbers, recording = np.unique(codes, return_inverse=True)
        present = tuple(names[number] for number in numbers.tolist())
        track = rows.words("track_id")[0] if tracks else None
        sums = {
            name: sum_slices(split, terms, recording=recording, recordings=len(present), track=track)
            for name, split in splits.items()
        }
        assert not self.recordings & set(present), "no recording is in two parts"
        self.recordings |= set(present)
        self._held.append((present, sums))

    def placed(self, recordings: Sequence[str]) -> dict[str, SliceSums]:
        """The sums of all parts, by split."""
        place = {name: number for number, name in enumerate(recordings)}
        parts = [(np.array([place[n] for n in names], dtype=np.int64), sums) for names, sums in self._held]
        return {
            split: place_sums([(numbers, sums[split]) for numbers, sums in parts], recordings=len(recordings))
            for split in self._held[0][1]
        }

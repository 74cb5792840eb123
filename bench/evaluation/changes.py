"""Which object-frames one run found and another did not."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from bench.evaluation.columns import Columns
from bench.evaluation.row_source import Rows, as_source, group_recordings
from bench.evaluation.slices import IMAGE
from bench.evaluation.terms import coverage, intersection_over_union

_KEY = [*IMAGE, "track_id"]
_OF_OBJECT = ["object_class", "category", "range_m", "region_px"]
_READ = [*_KEY, "status", *_OF_OBJECT, "tp", "fn", "fp"]

# Null where the run did not evaluate the object-frame. `change` is "gained", "lost" (the detection), "both", "neither",
# or "only_before" and "only_after" for what one run alone evaluated.
CHANGES_SCHEMA = pa.schema(
    [
        ("recording", pa.string()),
        ("camera", pa.string()),
        ("timestamp_ns", pa.int64()),
        ("track_id", pa.string()),
        ("object_class", pa.string()),
        ("category", pa.string()),
        ("range_m", pa.float64()),
        ("region_px", pa.int64()),
        ("change", pa.string()),
        *[
            (f"{name}_{run}", kind)
            for name, kind in (("detected", pa.bool_()), ("coverage", pa.float64()), ("iou", pa.float64()))
            for run in ("before", "after")
        ],
    ]
)


def object_changes(before_objects: pa.Table, after_objects: pa.Table) -> pa.Table:
    """Set the evaluated object-frames of two runs side by side.

    Args:
        before_objects: of `OBJECTS_SCHEMA`.
        after_objects: of `OBJECTS_SCHEMA`.

    Returns:
        Of `CHANGES_SCHEMA`, one row per object-frame evaluated in either run, by recording, camera, time and track.
    """
    sides = _evaluated(before_objects), _evaluated(after_objects)
    rows = _side_by_side(*sides)
    keys = {name: _either(sides, rows, name) for name in (*_KEY, *_OF_OBJECT)}
    figures = [_figures(side, of) for side, of in zip(sides, rows, strict=True)]
    columns = keys | {
        f"{name}_{run}": of_run[name]
        for name in figures[0]
        for run, of_run in zip(("before", "after"), figures, strict=True)
    }
    was, is_now = (of_run["detected"].fill_null(False).to_numpy(zero_copy_only=False) for of_run in figures)
    change = np.select(
        [rows[1] < 0, rows[0] < 0, ~was & is_now, was & ~is_now, was & is_now],
        ["only_before", "only_after", "gained", "lost", "both"],
        "neither",
    )
    columns["change"] = pa.array(change.astype(object), pa.string())
    return pa.table([columns[name] for name in CHANGES_SCHEMA.names], schema=CHANGES_SCHEMA)


def changes_in_parts(before: Rows, after: Rows, *, rows_at_once: int | None = None) -> Iterator[pa.Table]:
    """The same of runs of any size, some recordings at a time, in the same order.

    Args:
        before: of `OBJECTS_SCHEMA`, in memory or stored.
        after: of `OBJECTS_SCHEMA`, in memory or stored.
        rows_at_once: most rows of a run in memory, unless one recording has more.
    """
    sources = as_source(before), as_source(after)
    counts = [dict(source.recordings()) for source in sources]
    most = {name: max(of.get(name, 0) for of in counts) for name in counts[0].keys() | counts[1].keys()}
    for group in group_recordings(most, rows_at_once=rows_at_once):
        yield object_changes(*(source.read(group, _READ) for source in sources))


def _evaluated(objects: pa.Table) -> Columns:
    rows = Columns(objects.select(_READ))
    return Columns(rows.take(rows.is_word("status", "evaluated")).table)


def _side_by_side(before: Columns, after: Columns) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """For every object-frame of either run, in canonical order, its row in each; -1 where a run has none."""
    keys = [_shared_numbers(before, after, name) for name in _KEY]
    side = np.repeat([0, 1], [len(before), len(after)])
    row = np.concatenate([np.arange(len(before)), np.arange(len(after))])
    order = np.lexsort([side, *keys[::-1]])
    differs = np.zeros(max(len(order) - 1, 0), dtype=bool)
    for key in keys:
        differs |= key[order][1:] != key[order][:-1]
    group = np.concatenate([[0], np.cumsum(differs)])[: len(order)]
    count = int(group[-1]) + 1 if len(group) else 0
    found = (np.full(count, -1, dtype=np.int64), np.full(count, -1, dtype=np.int64))
    for number in (0, 1):
        of_side = side[order] == number
        assert len(np.unique(group[of_side])) == np.count_nonzero(of_side), f"{_KEY} names each row once"
        found[number][group[of_side]] = row[order][of_side]
    return found


def _shared_numbers(before: Columns, after: Columns, name: str) -> NDArray[np.int64]:
    """A part of the key in both runs, by numbers that compare across them."""
    if name == "timestamp_ns":
        return np.concatenate([before.integers(name), after.integers(name)])
    found = [side.words(name) for side in (before, after)]
    place = {word: number for number, word in enumerate(sorted({*found[0][1], *found[1][1]}))}
    return np.concatenate([np.array([*(place[w] for w in words), -1], dtype=np.int64)[codes] for codes, words in found])


def _either(
    sides: tuple[Columns, Columns], rows: tuple[NDArray[np.int64], NDArray[np.int64]], name: str
) -> pa.ChunkedArray:
    """A column that both runs share, from the first that has the row."""
    kind = CHANGES_SCHEMA.field(name).type
    taken = [side.table[name].cast(kind).take(pa.array(of, mask=of < 0)) for side, of in zip(sides, rows, strict=True)]
    return pc.if_else(pa.array(rows[0] >= 0), *taken)


def _figures(side: Columns, rows: NDArray[np.int64]) -> dict[str, pa.Array]:
    tp, fp, fn = (side.numbers(name) for name in ("tp", "fp", "fn"))
    figures = {"detected": tp > 0, "coverage": coverage(tp, fn), "iou": intersection_over_union(tp, fp, fn)}
    taken = pa.array(rows, mask=rows < 0)
    return {name: pa.array(values).take(taken) for name, values in figures.items()}

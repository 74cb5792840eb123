"""Which object-frames and which images of a run are worth a look: the worst ones, and not one scene only."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation import Rows
from bench.evaluation.columns import Columns
from bench.evaluation.row_source import as_source, read_parts
from bench.evaluation.terms import coverage
from bench.reference import Category

FrameKey = tuple[str, str, int]
APART_NS = 1_000_000_000
_IMAGE = ["recording", "camera", "timestamp_ns"]
_TRACK = ["recording", "camera", "track_id"]
Order = NDArray[np.int64]  # numbers of rows, worst first
Found = list[dict[str, object]]


def worst_objects(objects: Rows, category: Category, *, most: int) -> Found:
    """Evaluated object-frames of a category with the lowest coverage, as rows of `OBJECTS_SCHEMA` plus `coverage`.

    Of each track only the worst, then, while places are left, others of it at least a second apart.
    """
    return worst_of_categories(objects, [category], most=most)[category.value]


def worst_of_categories(objects: Rows, categories: Sequence[Category], *, most: int) -> dict[str, Found]:
    """The same of several categories, by name, with one pass over the rows, some recordings in memory at a time."""
    kept: dict[str, list[pa.Table]] = {category.value: [] for category in categories}
    for rows in _parts(objects, key=[*_IMAGE, "track_id"]):
        evaluated = rows.is_word("status", "evaluated")
        for name, tables in kept.items():
            of_kind = rows.take(evaluated & rows.is_word("category", name))
            tables.append(_spread(of_kind, _least_covered, group=_TRACK, most=most).table)
    return {name: _join(tables, _least_covered, group=_TRACK, most=most) for name, tables in kept.items()}


def worst_frames(frames: Rows, *, most: int) -> Found:
    """Scored images with the largest false-positive coverage, as rows of `FRAMES_SCHEMA` plus `coverage`.

    Without the histograms. Of each recording and camera only the worst, then, while places are left, others of it at
    least a second apart.
    """
    kept = []
    for rows in _parts(frames, key=_IMAGE):
        with_false = rows.take(rows.is_word("status", "evaluated") & (rows.numbers("fp_px") > 0))
        kept.append(_spread(with_false, _most_false, group=_IMAGE[:2], most=most).table)
    return _join(kept, _most_false, group=_IMAGE[:2], most=most)


def frame_key(row: dict[str, object]) -> FrameKey:
    """The image of a row."""
    return str(row["recording"]), str(row["camera"]), int(str(row["timestamp_ns"]))


def _parts(rows: Rows, *, key: Sequence[str]) -> Iterator[Columns]:
    source = as_source(rows)
    flat = [field.name for field in source.schema if not pa.types.is_list(field.type)]
    for part in read_parts(source, flat):
        yield Columns(part).canonical(key)


def _least_covered(rows: Columns) -> tuple[NDArray[np.float64], Order]:
    """Coverage of each row, and the rows from the least covered on; of equals the largest, then in canonical order."""
    covered = coverage(rows.numbers("tp"), rows.numbers("fn"))
    return covered, np.lexsort([-rows.numbers("region_px"), covered])


def _most_false(rows: Columns) -> tuple[NDArray[np.float64], Order]:
    """False-positive coverage of each row, and the rows from the most covered on; of equals in canonical order."""
    share = rows.numbers("fp_px") / (rows.numbers("width") * rows.numbers("height"))
    return share, np.argsort(-share, kind="stable")


def _spread(
    rows: Columns, rank: Callable[[Columns], tuple[NDArray[np.float64], Order]], *, group: Sequence[str], most: int
) -> Columns:
    """At most so many of the rows, in canonical order.

    What is picked of a part is all that could be picked of the whole: groups do not reach across parts, and those of
    other parts only take places away.
    """
    _, order = rank(rows)
    groups = np.unique(np.stack([rows.words(name)[0] for name in group]), axis=1, return_inverse=True)[1].ravel()
    of_place, times_ns = groups[order], rows.integers("timestamp_ns")[order]
    first = np.sort(np.unique(of_place, return_index=True)[1])
    picked = first[:most].tolist()
    times_of: dict[int, list[int]] = {int(of_place[place]): [int(times_ns[place])] for place in picked}
    others = np.setdiff1d(np.arange(len(order)), first) if len(picked) < most else ()
    for place in others:
        if len(picked) == most:
            break
        times = times_of[int(of_place[place])]
        if all(abs(int(times_ns[place]) - other) >= APART_NS for other in times):
            picked.append(int(place))
            times.append(int(times_ns[place]))
    return rows.take(np.sort(order[picked]))


def _join(
    tables: Sequence[pa.Table],
    rank: Callable[[Columns], tuple[NDArray[np.float64], Order]],
    *,
    group: Sequence[str],
    most: int,
) -> Found:
    """What is picked of the parts, in canonical order as they are, picked once more; worst first."""
    if not tables:
        return []
    # Parts of a stored table have dictionaries of their own.
    rows = _spread(Columns(pa.concat_tables(tables).unify_dictionaries()), rank, group=group, most=most)
    shares, order = rank(rows)
    content = rows.table.to_pylist(maps_as_pydicts="strict")
    return [content[place] | {"coverage": float(shares[place])} for place in order.tolist()]

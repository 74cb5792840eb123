"""What a page is made of: the stored results of a run, the worst cases among them, and which ones a table lists."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation import Protocol, Rows, Summary, summarise
from bench.evaluation.row_source import ChosenRows, Columns, RowSource, as_source, read_parts
from bench.evaluation.sums import coverage
from bench.harness import RunSummary, open_tables, read_protocol, read_run
from bench.reference import Category


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageSource:
    """Everything that is stored.

    Attributes:
        folder: of the run.
        run: its summary.
        protocol: its rules.
        category: the page's slice; None for all.
        figures: of the slice; the run's own without one.
        objects: rows of the slice, on disk.
        frames: every image, on disk.
    """

    folder: Path
    run: RunSummary
    protocol: Protocol
    category: Category | None
    figures: Summary
    objects: RowSource
    frames: RowSource


def read_source(folder: Path, *, category: Category | None = None) -> PageSource:
    """Read a run.

    Raises:
        DataError: a stored result is missing or damaged, or the files are not of one run.
    """
    run = read_run(folder)
    protocol = read_protocol(folder, run)
    stored, frames = open_tables(folder)
    objects: RowSource = stored
    figures: Summary = run
    if category is not None:
        objects = ChosenRows(stored, column="category", word=category.value)
        figures = summarise(objects, frames, protocol=protocol)
    return PageSource(
        folder=folder,
        run=run,
        protocol=protocol,
        category=category,
        figures=figures,
        objects=objects,
        frames=frames,
    )


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


LISTED = 20_000  # 2 MB of the page
EVALUATED = "evaluated"
KEY = ("recording", "camera", "timestamp_ns", "track_id")
COLUMNS = (
    *KEY,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)
ObjectKey = tuple[str, str, int, str]


def listed_rows(source: RowSource, *, pictured: Collection[ObjectKey], most: int) -> tuple[Columns, int]:
    """The rows of the table, in canonical order, and how many there are in all.

    Args:
        source: of the objects.
        pictured: object-frames that are listed in any case.
        most: rows; where there are more, the evaluated with the lowest coverage are listed, of equals the largest and
            then the first, and behind them the others.
    """
    kept: list[pa.Table] = []
    annotated = 0
    for part in read_parts(source, COLUMNS):
        annotated += part.num_rows
        rows = Columns(part).canonical(KEY)
        kept = [_first(Columns(pa.concat_tables([*kept, rows.table]).unify_dictionaries()), pictured, most)]
    if not kept:
        return Columns(source.read((), COLUMNS)), 0
    return Columns(kept[0]), annotated


def _first(rows: Columns, pictured: Iterable[ObjectKey], most: int) -> pa.Table:
    """At most so many rows in the order that they came in; parts come in canonical order."""
    if len(rows) <= most:
        return rows.table
    scored = rows.is_word("status", EVALUATED)
    covered = np.where(scored, coverage(rows.numbers("tp"), rows.numbers("fn")), np.nan)
    order = np.lexsort([-rows.numbers("region_px"), covered, ~scored, ~_are(rows, pictured)])
    return rows.take(np.sort(order[:most])).table


def _are(rows: Columns, pictured: Iterable[ObjectKey]) -> NDArray[np.bool_]:
    """(N,) bool, which rows are among these."""
    found = np.zeros(len(rows), dtype=bool)
    held = set(rows.words("recording")[1])
    times_ns = rows.integers("timestamp_ns")
    for recording, camera, timestamp_ns, track in pictured:
        if recording in held and track:
            words = {"recording": recording, "camera": camera, "track_id": track}
            same = times_ns == timestamp_ns
            for name, word in words.items():
                same &= rows.is_word(name, word)
            found |= same
    return found

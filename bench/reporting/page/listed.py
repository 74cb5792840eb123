"""Which object-frames stand in the table of a page: all of them, or those that a browser can hold."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.columns import Columns
from bench.evaluation.row_source import RowSource, read_parts
from bench.evaluation.terms import coverage

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

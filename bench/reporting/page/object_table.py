"""The table of object-frames of a page: which rows it lists, and their content as the page's script takes it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.protocol import known_protocols
from bench.evaluation.row_source import IMAGE, Columns, RowSource, group_recordings, read_parts
from bench.evaluation.sums import coverage, intersection_over_union
from bench.reporting.stored_run import StoredRun

LISTED = 20_000  # 2 MB of the page
EVALUATED = "evaluated"
KEY = (*IMAGE, "track_id")
COLUMNS = (
    *KEY,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)
_WORDS = ("recording", "camera", "track_id", "object_class", "category", "outcome")
ObjectKey = tuple[str, str, int, str]


def listed_rows(source: RowSource, *, pictured: Collection[ObjectKey], most: int) -> tuple[Columns, int]:
    """The rows of the table, in canonical order, and how many there are in all.

    Args:
        source: of the objects.
        pictured: object-frames that are listed in any case.
        most: rows; where there are more, the evaluated with the lowest coverage are listed, of equals the largest and
            then the first, and behind them the others.
    """
    listed = source.read((), COLUMNS)
    annotated = 0
    for part in read_parts(source, COLUMNS):
        annotated += part.num_rows
        rows = Columns(part).canonical(KEY)
        listed = _first(Columns(pa.concat_tables([listed, rows.table]).unify_dictionaries()), pictured, most)
    return Columns(listed), annotated


def _first(rows: Columns, pictured: Collection[ObjectKey], most: int) -> pa.Table:
    """At most so many rows in the order that they came in; parts come in canonical order."""
    if len(rows) <= most:
        return rows.table
    scored = rows.is_word("status", EVALUATED)
    covered = np.where(scored, coverage(rows.numbers("tp"), rows.numbers("fn")), np.nan)
    times_ns = rows.integers("timestamp_ns")
    with_picture = np.zeros(len(rows), dtype=bool)
    for recording, camera, timestamp_ns, track in pictured:
        of_object = rows.is_word("recording", recording) & rows.is_word("camera", camera)
        with_picture |= of_object & rows.is_word("track_id", track) & (times_ns == timestamp_ns)
    order = np.lexsort([-rows.numbers("region_px"), covered, ~scored, ~with_picture])
    return rows.take(np.sort(order[:most])).table


def table_data(run: StoredRun, *, pictured: Mapping[ObjectKey, str], most: int = LISTED) -> dict[str, Any]:
    """Columns of the table: words by their index in a dictionary, numbers rounded to what is shown, null for NaN.

    Args:
        run: every annotated object-frame becomes a row where there are few enough of them.
        pictured: image and track -> the id of the element with their pictures; track "" for any object of the image.
        most: rows; where there are more, those with pictures of their own and the least covered are listed.

    Returns:
        `rows`, `annotated` (with those that are not listed), `words` (dictionaries), `columns` (one list each), and
        `command`, which draws an image, with `{recording}`, `{camera}` and `{index}` left to be filled.
    """
    rows, annotated = listed_rows(run.objects, pictured={key for key in pictured if key[3]}, most=most)
    columns: dict[str, list[Any]] = {}
    words: dict[str, list[str]] = {}
    for name in _WORDS:
        shown = _outcomes(rows) if name == "outcome" else _texts(rows, name)
        codes, found = pd.factorize(shown.str.replace("_", " ") if name == "category" else shown, sort=True)
        columns[name], words[name] = codes.tolist(), [str(word) for word in found]
    tp, fn, fp = (rows.numbers(name) for name in ("tp", "fn", "fp"))
    of_evaluated = {
        "coverage": (100 * coverage(tp, fn), 1),
        "iou": (100 * intersection_over_union(tp, fp, fn), 1),
        "false_px": (fp, 0),
        "region_px": (rows.numbers("region_px"), 0),
    }
    scored = rows.is_word("status", EVALUATED)
    columns |= {name: _numbers(np.where(scored, of, np.nan), digits) for name, (of, digits) in of_evaluated.items()}
    columns["time_s"] = _numbers(rows.integers("timestamp_ns") / 1e9, 3)
    columns["range_m"] = _numbers(rows.numbers("range_m"), 1)
    columns["ego_kmh"] = _numbers(3.6 * rows.numbers("ego_speed_mps"), 1)
    columns["points"] = _numbers(rows.numbers("points"), 0)
    keys = _keys(rows)
    columns["picture"] = [pictured.get(key) or pictured.get((*key[:3], ""), "") for key in keys]
    columns["index"] = _image_indices(run, keys)
    return {
        "rows": len(rows),
        "annotated": annotated,
        "words": words,
        "columns": columns,
        "command": view_command(run),
    }


def _keys(rows: Columns) -> list[ObjectKey]:
    texts = [_texts(rows, name) for name in ("recording", "camera", "track_id")]
    times_ns = rows.integers("timestamp_ns").tolist()
    return [(*image, time_ns, track) for *image, track, time_ns in zip(*texts, times_ns, strict=True)]


def _texts(rows: Columns, name: str) -> pd.Series[str]:
    """The words of a column, "" for null."""
    codes, words = rows.words(name)
    return pd.Series(np.array([*words, ""], dtype=object)[codes], dtype=object)


def _outcomes(rows: Columns) -> pd.Series[str]:
    status, reason = _texts(rows, "status"), _texts(rows, "reason")
    return status.where(reason == "", status + ": " + reason.str.replace("_", " "))


def _numbers(values: NDArray[np.float64], digits: int) -> list[float | int | None]:
    shown = [None if math.isnan(value) else round(float(value), digits) for value in values]
    return [value if value is None or digits else int(value) for value in shown]


def _image_indices(run: StoredRun, keys: Sequence[ObjectKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = 1 if run.summary.manifest.method.history is None else run.summary.manifest.method.history
    wanted = pd.DataFrame(keys, columns=list(KEY))[IMAGE]
    counts = run.frames.recordings()
    found = []
    for group in group_recordings({name: counts[name] for name in set(wanted["recording"])}):
        frames = Columns(run.frames.read(group, IMAGE)).canonical(IMAGE).table.to_pandas()
        frames["index"] = frames.groupby(IMAGE[:2], sort=False, observed=True).cumcount() + history
        found.append(frames.astype(dict.fromkeys(IMAGE[:2], object)).merge(wanted.drop_duplicates()))
    return wanted.merge(pd.concat(found), how="left")["index"].astype(int).tolist() if found else []


def view_command(run: StoredRun) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    words = ["fisheye-bench", "view", run.summary.manifest.dataset.card, *run.summary.manifest.method.options()]
    known = run.protocol.name in known_protocols()
    words += ["--protocol", run.protocol.name if known else str(run.folder / "protocol.json")]
    return " ".join(map(shlex.quote, words)) + " --recording {recording} --camera {camera} --frame {index}"

"""The table of object-frames of a page: which rows it lists, and their content as the page's script takes it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from bench.evaluation import RowSource
from bench.evaluation.definitions import coverage, intersection_over_union
from bench.evaluation.protocol import known_protocols
from bench.evaluation.rows import EVALUATED, IMAGE, OBJECT, group_recordings, pick, read_parts, sort_rows
from bench.harness.stored import StoredRun

LISTED = 20_000  # 2 MB of the page
COLUMNS = (
    *OBJECT,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)
_WORDS = ("recording", "camera", "track_id", "object_class", "category", "outcome")
ObjectKey = tuple[str, str, int, str]


def listed_rows(source: RowSource, *, pictured: Collection[ObjectKey], most: int) -> tuple[pd.DataFrame, int]:
    """The rows of the table, in canonical order, and how many there are in all.

    Args:
        source: of the objects.
        pictured: object-frames that are listed in any case.
        most: rows; where there are more, the evaluated with the lowest coverage are listed, of equals the largest and
            then the first, and behind them the others.
    """
    annotated = 0

    def sorted_parts() -> Iterator[pd.DataFrame]:
        nonlocal annotated
        for part in read_parts(source, COLUMNS):
            annotated += len(part)
            yield sort_rows(part, OBJECT)

    rows = pick(sorted_parts(), lambda rows: _first(rows, pictured, most))
    return rows, annotated


def _first(rows: pd.DataFrame, pictured: Collection[ObjectKey], most: int) -> pd.DataFrame:
    """At most so many rows in the order that they came in; parts come in the order of their key."""
    if len(rows) <= most:
        return rows
    scored = rows["status"] == EVALUATED
    with_picture = pd.MultiIndex.from_frame(rows[OBJECT]).isin(list(pictured)) if pictured else False
    ranks = pd.DataFrame(
        {"picture": with_picture, "scored": scored, "coverage": -coverage(rows).where(scored), "px": rows["region_px"]},
        index=rows.index,
    )
    first = ranks.sort_values(list(ranks.columns), ascending=False, kind="stable").index[:most]
    return rows.loc[first.sort_values()]


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
    of_evaluated = {
        "coverage": (100 * coverage(rows), 1),
        "iou": (100 * intersection_over_union(rows), 1),
        "false_px": (rows["fp"], 0),
        "region_px": (rows["region_px"], 0),
    }
    scored = rows["status"] == EVALUATED
    columns |= {name: _numbers(of.where(scored), digits) for name, (of, digits) in of_evaluated.items()}
    columns["time_s"] = _numbers(rows["timestamp_ns"] / 1e9, 3)
    columns["range_m"] = _numbers(rows["range_m"], 1)
    columns["ego_kmh"] = _numbers(3.6 * rows["ego_speed_mps"], 1)
    columns["points"] = _numbers(rows["points"], 0)
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


def _keys(rows: pd.DataFrame) -> list[ObjectKey]:
    return list(rows[OBJECT].itertuples(index=False, name=None))


def _texts(rows: pd.DataFrame, name: str) -> pd.Series[str]:
    """The words of a column, "" for null."""
    return rows[name].astype(object).fillna("")


def _outcomes(rows: pd.DataFrame) -> pd.Series[str]:
    status, reason = _texts(rows, "status"), _texts(rows, "reason")
    return status.where(reason == "", status + ": " + reason.str.replace("_", " "))


def _numbers(values: pd.Series[Any], digits: int) -> list[float | int | None]:
    shown = values.astype(float).round(digits)
    return [None if math.isnan(value) else value if digits else int(value) for value in shown]


def _image_indices(run: StoredRun, keys: Sequence[ObjectKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = 1 if run.manifest.method.history is None else run.manifest.method.history
    wanted = pd.DataFrame(keys, columns=OBJECT)[IMAGE]
    counts = run.frames.recordings()
    found = []
    for group in group_recordings({name: counts[name] for name in set(wanted["recording"])}):
        frames = sort_rows(run.frames.read(group, IMAGE), IMAGE)
        frames["index"] = frames.groupby(IMAGE[:2], sort=False).cumcount() + history
        found.append(frames.merge(wanted.drop_duplicates()))
    return wanted.merge(pd.concat(found), how="left")["index"].astype(int).tolist() if found else []


def view_command(run: StoredRun) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    words = ["fisheye-bench", "view", run.manifest.dataset.card, *run.manifest.method.options()]
    known = run.protocol.name in known_protocols()
    words += ["--protocol", run.protocol.name if known else str(run.folder / "protocol.json")]
    return " ".join(map(shlex.quote, words)) + " --recording {recording} --camera {camera} --frame {index}"

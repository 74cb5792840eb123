"""The rows of the object-frame table, as compact JSON for the page's script."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from bench.evaluation.columns import Columns
from bench.evaluation.protocol import known_protocols
from bench.evaluation.row_source import group_recordings
from bench.evaluation.terms import coverage, intersection_over_union
from bench.methods import METHODS, build_method
from bench.reporting.page.listed import EVALUATED, LISTED, listed_rows
from bench.reporting.page.source import PageSource
from bench.reporting.page.worst import FrameKey

_WORDS = ("recording", "camera", "track_id", "object_class", "category", "outcome")
_ORDER = ["recording", "camera", "timestamp_ns", "track_id"]


def table_data(
    source: PageSource, *, pictured: Mapping[tuple[str, str, int, str], str], most: int = LISTED
) -> dict[str, Any]:
    """Columns of the table: words by their place in a dictionary, numbers rounded to what is shown, null for NaN.

    Args:
        source: the run; every annotated object-frame becomes a row where there are few enough of them.
        pictured: image and track -> the id of the element with their pictures; track "" for any object of the image.
        most: rows; where there are more, those with pictures of their own and the least covered are listed.

    Returns:
        `rows`, `annotated` (with those that are not listed), `words` (dictionaries), `columns` (one list each), and
        `command`, which draws an image, with `{recording}`, `{camera}` and `{index}` left to be filled.
    """
    rows, annotated = listed_rows(source.objects, pictured=pictured.keys(), most=most)
    columns: dict[str, list[Any]] = {}
    words: dict[str, list[str]] = {}
    for name in _WORDS:
        shown = _outcomes(rows) if name == "outcome" else pd.Series(_texts(rows, name), dtype=object)
        codes, found = pd.factorize(shown.str.replace("_", " ") if name == "category" else shown, sort=True)
        columns[name], words[name] = codes.tolist(), [str(word) for word in found]
    tp, fp, region = (rows.numbers(name) for name in ("tp", "fp", "region_px"))
    scored = rows.is_word("status", EVALUATED)
    covered, overlap = coverage(tp, rows.numbers("fn")), intersection_over_union(tp, fp, rows.numbers("fn"))
    columns["coverage"] = _numbers(np.where(scored, 100 * covered, np.nan), 1)
    columns["iou"] = _numbers(np.where(scored, 100 * overlap, np.nan), 1)
    columns["false_px"] = _numbers(np.where(scored, fp, np.nan), 0)
    columns["region_px"] = _numbers(np.where(scored, region, np.nan), 0)
    columns["time_s"] = _numbers(rows.integers("timestamp_ns") / 1e9, 3)
    columns["range_m"] = _numbers(rows.numbers("range_m"), 1)
    columns["ego_kmh"] = _numbers(3.6 * rows.numbers("ego_speed_mps"), 1)
    columns["points"] = _numbers(rows.numbers("points"), 0)
    times_ns = rows.integers("timestamp_ns").tolist()
    keys: list[FrameKey] = list(zip(_texts(rows, "recording"), _texts(rows, "camera"), times_ns, strict=True))
    columns["picture"] = [
        pictured.get((*key, track)) or pictured.get((*key, ""), "")
        for key, track in zip(keys, _texts(rows, "track_id"), strict=True)
    ]
    columns["index"] = _image_indices(source, keys)
    return {
        "rows": len(rows),
        "annotated": annotated,
        "words": words,
        "columns": columns,
        "command": view_command(source),
    }


def script_json(content: object) -> Markup:
    """JSON that may stand inside a `<script>` element: nothing in it can close the element or open a comment."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    escapes: dict[str, str | int | None] = {
        "<": "\\u003c",
        ">": "\\u003e",
        "&": "\\u0026",
        "\u2028": "\\u2028",
        "\u2029": "\\u2029",
    }
    return Markup(text.translate(str.maketrans(escapes)))


def view_command(source: PageSource) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    run = source.run
    words = ["fisheye-bench", "view", run.card, "--method", run.method.called]
    defaults = _default_settings(run.method.called)
    for name, value in _leaves(run.method.settings):
        if _get(defaults, name) != value:
            words += ["--set", f"{name}={json.dumps(value)}"]
    known = source.protocol.name in known_protocols()
    words += ["--protocol", source.protocol.name if known else str(source.folder / "protocol.json")]
    told = " ".join(shlex.quote(word) for word in words)
    return told + " --recording {recording} --camera {camera} --frame {index}"


def _default_settings(method: str) -> dict[str, object]:
    """What need not be said; nothing for a method that is not of this package, since nothing stored is imported."""
    return build_method(method).settings() if method in METHODS else {}


def _image_indices(source: PageSource, keys: Sequence[FrameKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = 1 if source.run.method.history is None else source.run.method.history
    expected = pd.DataFrame(keys, columns=_ORDER[:3]).drop_duplicates()
    counts = source.frames.recordings()
    index: dict[FrameKey, int] = {}
    for group in group_recordings({name: counts[name] for name in set(expected["recording"])}):
        frames = Columns(source.frames.read(group, _ORDER[:3])).canonical(_ORDER[:3]).table.to_pandas()
        frames["index"] = frames.groupby(_ORDER[:2], sort=False, observed=True).cumcount() + history
        found = expected[expected["recording"].isin(group)].merge(frames.astype(dict.fromkeys(_ORDER[:2], object)))
        index |= dict(zip(zip(*(found[name] for name in _ORDER[:3]), strict=True), found["index"], strict=True))
    return [int(index[key]) for key in keys]


def _outcomes(rows: Columns) -> pd.Series[str]:
    status, reason = (pd.Series(_texts(rows, name), dtype=object) for name in ("status", "reason"))
    return status.where(reason == "", status + ": " + reason.str.replace("_", " "))


def _texts(rows: Columns, name: str) -> list[str]:
    """The words of a column, "" for null."""
    codes, words = rows.words(name)
    texts: list[str] = np.array([*words, ""], dtype=object)[codes].tolist()
    return texts


def _leaves(settings: Mapping[str, object], parents: str = "") -> list[tuple[str, object]]:
    found: list[tuple[str, object]] = []
    for name, value in settings.items():
        if isinstance(value, Mapping):
            found += _leaves(value, f"{parents}{name}.")
        else:
            found.append((parents + name, value))
    return found


def _get(settings: object, name: str) -> object:
    for part in name.split("."):
        settings = settings.get(part) if isinstance(settings, Mapping) else None
    return settings


def _numbers(values: Any, digits: int) -> list[float | int | None]:
    shown = [None if math.isnan(value) else round(float(value), digits) for value in values]
    return [value if value is None or digits else int(value) for value in shown]

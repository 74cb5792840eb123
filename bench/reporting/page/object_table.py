"""The rows of the object-frame table, as compact JSON for the page's script."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from bench.errors import BenchError
from bench.evaluation.protocol import known_protocols
from bench.methods import build_method
from bench.reporting.page.source import PageSource
from bench.reporting.page.worst import FrameKey

_WORDS = ("recording", "camera", "track_id", "object_class", "category", "outcome")
_ORDER = ["recording", "camera", "timestamp_ns", "track_id"]


def table_data(source: PageSource, *, pictured: Mapping[tuple[str, str, int, str], str]) -> dict[str, Any]:
    """Columns of the table: words by their place in a dictionary, numbers rounded to what is shown, null for NaN.

    Args:
        source: the run; every annotated object-frame becomes a row.
        pictured: image and track -> the id of the element with their pictures; track "" for any object of the image.

    Returns:
        `rows`, `words` (dictionaries), `columns` (one list each), and `command`, which draws an image, with
        `{recording}`, `{camera}` and `{index}` left to be filled.
    """
    rows = source.objects.to_pandas().sort_values(_ORDER, ignore_index=True)
    ignored = rows["status"] + ": " + rows["reason"].fillna("").str.replace("_", " ")
    rows["outcome"] = rows["status"].where(rows["reason"].isna(), ignored)
    columns: dict[str, list[Any]] = {}
    words: dict[str, list[str]] = {}
    for name in _WORDS:
        shown = rows[name].fillna("").astype(str)
        codes, found = pd.factorize(shown.str.replace("_", " ") if name == "category" else shown, sort=True)
        columns[name], words[name] = codes.tolist(), [str(word) for word in found]
    region = (rows["tp"] + rows["fn"]).to_numpy(dtype=np.float64)
    scored = (rows["status"] == "evaluated").to_numpy()
    with np.errstate(invalid="ignore", divide="ignore"):
        columns["coverage"] = _numbers(np.where(scored, 100 * rows["tp"] / region, np.nan), 1)
        columns["iou"] = _numbers(np.where(scored, 100 * rows["tp"] / (region + rows["fp"]), np.nan), 1)
    columns["false_px"] = _numbers(np.where(scored, rows["fp"], np.nan), 0)
    columns["region_px"] = _numbers(np.where(scored, rows["region_px"], np.nan), 0)
    columns["time_s"] = _numbers(rows["timestamp_ns"].to_numpy() / 1e9, 3)
    columns["range_m"] = _numbers(rows["range_m"].to_numpy(), 1)
    columns["ego_kmh"] = _numbers(3.6 * rows["ego_speed_mps"].to_numpy(), 1)
    columns["points"] = _numbers(rows["points"].to_numpy(dtype=np.float64), 0)
    keys = list(zip(rows["recording"], rows["camera"], rows["timestamp_ns"], strict=True))
    columns["picture"] = [
        pictured.get((*key, track)) or pictured.get((*key, ""), "")
        for key, track in zip(keys, rows["track_id"], strict=True)
    ]
    columns["index"] = _image_indices(source, keys)
    return {"rows": len(rows), "words": words, "columns": columns, "command": view_command(source)}


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
    """What need not be said; nothing for a method that is not at hand."""
    try:
        return build_method(method).settings()
    except BenchError:
        return {}


def _image_indices(source: PageSource, keys: list[FrameKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = source.run.method.build().history
    frames = source.frames.select(["recording", "camera", "timestamp_ns"]).to_pandas().sort_values(_ORDER[:3])
    order = frames.groupby(["recording", "camera"], sort=False).cumcount() + history
    index = dict(
        zip(zip(frames["recording"], frames["camera"], frames["timestamp_ns"], strict=True), order, strict=True)
    )
    return [int(index[key]) for key in keys]


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

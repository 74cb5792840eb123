"""The table of object-frames of a run's page: which it lists, and what it says of each."""

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
from bench.reporting.document import Cell, Table

LISTED = 2_000  # 1 MB of the page
ObjectKey = tuple[str, str, int, str]
_READ = (
    *OBJECT,
    *("object_class", "status", "reason", "category", "range_m", "ego_speed_mps", "points", "region_px"),
    *("tp", "fn", "fp"),
)
FILTERS = {"kind": "Kind", "class": "Class", "outcome": "Outcome", "camera": "Camera", "recording": "Recording"}


def listed_rows(
    source: RowSource, *, pictured: Collection[ObjectKey] = (), most: int = LISTED
) -> tuple[pd.DataFrame, int]:
    """The rows of the table, and how many there are in all.

    Args:
        source: of the objects.
        pictured: object-frames that are listed in any case.
        most: rows; the evaluated with the lowest coverage come first, of equals the largest, and then the others.
    """
    annotated, ranks = 0, ["scored", "coverage", "region_px"]

    def parts() -> Iterator[pd.DataFrame]:
        nonlocal annotated
        for part in read_parts(source, _READ):
            annotated += len(part)
            rows = sort_rows(part, OBJECT)
            scored = rows["status"] == EVALUATED
            own = pd.MultiIndex.from_frame(rows[OBJECT]).isin(list(pictured)) if pictured else False
            yield rows.assign(pictured=own, scored=scored, coverage=coverage(rows).where(scored))

    def first(rows: pd.DataFrame) -> pd.DataFrame:
        order = [False, False, True, False]
        return rows.sort_values(["pictured", *ranks], ascending=order, kind="stable").head(most)

    chosen = pick(parts(), first)
    return chosen.sort_values(ranks, ascending=[False, True, False], kind="stable", ignore_index=True), annotated


def object_table(run: StoredRun, *, pictured: Mapping[ObjectKey, str], most: int = LISTED) -> tuple[Table, int]:
    """Every annotated object-frame as a row; where there are too many the worst; and how many there are in all.

    Args:
        run: of the page.
        pictured: image and track -> the element with their pictures; track "" for any object of the image.
        most: rows; where there are more, those with pictures of their own and the least covered are listed.
    """
    rows, annotated = listed_rows(run.objects, pictured={key for key in pictured if key[3]}, most=most)
    keys: list[ObjectKey] = list(rows[OBJECT].itertuples(index=False, name=None))
    status, reason, kind = (rows[name].astype(object).fillna("") for name in ("status", "reason", "category"))
    rows["outcome"] = status.where(reason == "", status + ": " + reason.str.replace("_", " "))
    rows["kind"] = kind.str.replace("_", " ")
    addresses = [pictured.get(key) or pictured.get((*key[:3], ""), "") for key in keys]
    scored = rows["status"] == EVALUATED
    shown = {
        "object": [Cell(key[3], link=f"#{to}" if to else "") for key, to in zip(keys, addresses, strict=True)],
        "recording": rows["recording"],
        "camera": rows["camera"],
        "class": rows["object_class"],
        "kind": rows["kind"],
        "outcome": rows["outcome"],
        "time (s)": (rows["timestamp_ns"] / 1e9).map("{:.2f}".format),
        "image": _image_indices(run, keys),
        "IoU %": _numbers(100 * intersection_over_union(rows).where(scored), 1),
        "TPR %": _numbers(100 * rows["coverage"], 1),
        "false px": _numbers(rows["fp"].where(scored), 0),
        "object px": _numbers(rows["region_px"].where(scored), 0),
        "range (m)": _numbers(rows["range_m"], 1),
        "ego (km/h)": _numbers(3.6 * rows["ego_speed_mps"], 1),
        "points": _numbers(rows["points"], 0),
    }
    tags = rows.rename(columns={"object_class": "class"})[[*FILTERS]].astype(str)
    title = "Annotated object-frames; TPR (coverage) and IoU in percent"
    of_rows = [dict(zip(FILTERS, row, strict=True)) for row in tags.itertuples(index=False)]
    table = Table(
        title=title, columns=[*shown], rows=[*zip(*shown.values(), strict=True)], words=6, tags=of_rows, look="dense"
    )
    return table, annotated


def _numbers(values: pd.Series[Any], digits: int) -> list[str]:
    return ["" if math.isnan(value) else f"{value:.{digits}f}" for value in values.astype(float)]


def _image_indices(run: StoredRun, keys: Sequence[ObjectKey]) -> list[int]:
    """Index of each image among those of its camera; the first ones, which have no history, are in no table."""
    history = 1 if run.manifest.method.history is None else run.manifest.method.history
    wanted = pd.DataFrame(keys, columns=OBJECT)[IMAGE]
    counts = run.frames.recordings()
    indices = []
    for group in group_recordings({name: counts[name] for name in set(wanted["recording"])}):
        frames = sort_rows(run.frames.read(group, IMAGE), IMAGE)
        frames["index"] = frames.groupby(IMAGE[:2], sort=False).cumcount() + history
        indices.append(frames.merge(wanted.drop_duplicates()))
    return wanted.merge(pd.concat(indices), how="left")["index"].astype(int).tolist() if indices else []


def view_command(run: StoredRun) -> str:
    """The call of `view` that draws an image of the run, with its method, settings and protocol."""
    words = ["fisheye-bench", "view", run.manifest.dataset.card, *run.manifest.method.options()]
    known = run.protocol.name in known_protocols()
    words += ["--protocol", run.protocol.name if known else str(run.folder / "protocol.json")]
    return " ".join(map(shlex.quote, words)) + " --recording RECORDING --camera CAMERA --frame IMAGE"

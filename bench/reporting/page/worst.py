"""Which object-frames and which images of a run are worth a look: the worst ones, and not one scene only."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
import pyarrow as pa

from bench.reference import Category

FrameKey = tuple[str, str, int]
APART_NS = 1_000_000_000
_IMAGE = ["recording", "camera", "timestamp_ns"]


def worst_objects(objects: pa.Table, category: Category, *, most: int) -> list[dict[str, object]]:
    """Evaluated object-frames of a category with the lowest coverage, as rows of `OBJECTS_SCHEMA` plus `coverage`.

    Of each track only the worst, then, while places are left, others of it at least a second apart.
    """
    rows = objects.to_pandas()
    rows = rows[(rows["status"] == "evaluated") & (rows["category"] == category.value)]
    rows = rows.assign(coverage=rows["tp"] / (rows["tp"] + rows["fn"]))
    order = rows.sort_values(["coverage", "region_px", *_IMAGE, "track_id"], ascending=[True, False, *[True] * 4])
    return _spread(order, group=["recording", "camera", "track_id"], most=most)


def worst_frames(frames: pa.Table, *, most: int) -> list[dict[str, object]]:
    """Scored images with the largest false-positive coverage, as rows of `FRAMES_SCHEMA` plus `coverage`.

    Of each recording and camera only the worst, then, while places are left, others of it at least a second apart.
    """
    rows = frames.to_pandas(maps_as_pydicts="strict")
    rows = rows[rows["status"] == "evaluated"]
    rows = rows.assign(coverage=rows["fp_px"] / (rows["width"] * rows["height"]))
    order = rows.sort_values(["coverage", *_IMAGE], ascending=[False, True, True, True])
    return _spread(order[order["fp_px"] > 0], group=["recording", "camera"], most=most)


def frame_key(row: dict[str, object]) -> FrameKey:
    """The image of a row."""
    return str(row["recording"]), str(row["camera"]), int(str(row["timestamp_ns"]))


def _spread(order: pd.DataFrame, *, group: Sequence[str], most: int) -> list[dict[str, object]]:
    first = ~order.duplicated(list(group))
    candidates = pd.concat([order[first], order[~first]])
    picked: list[int] = []
    times: dict[tuple[object, ...], list[int]] = {}
    for place, (key, time) in enumerate(
        zip(candidates[list(group)].itertuples(index=False, name=None), candidates["timestamp_ns"], strict=True)
    ):
        if len(picked) == most:
            break
        if all(abs(time - other) >= APART_NS for other in times.get(key, [])):
            picked.append(place)
            times.setdefault(key, []).append(time)
    worst = candidates.iloc[picked]
    return order.loc[order.index.intersection(worst.index, sort=False)].to_dict("records")  # type: ignore[return-value]

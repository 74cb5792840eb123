"""The one table behind summary, gate, comparison and leaderboard: sums by slice, recording and metric.

    breakdown, slice, recording, metric, numerator, denominator
    category, crossing, drive-3, iou, 17.2, 41

A metric of a slice is the sum of its numerators over the sum of its denominators; its interval needs them by recording.
A run is summed some whole recordings at a time, whose tables are added, so that memory is bounded. Breakdowns are the
kinds of motion ("category"), everything ("all_moving" of objects, "frames" of images), class, camera, bins of range, of
the object's and the ego vehicle's speed and of points, and class x speed; a slice without rows is not there. `COUNTS`
stand in the same table, as numerators: all annotated objects by status and reason, all images by status, problem and
camera, and the tracks of each slice, over its object-frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from bench.atomic import open_regular, write_text
from bench.errors import BenchError, DataError
from bench.evaluation.definitions import (
    CAUSE,
    COUNTS,
    MARKED,
    Definition,
    find_metric,
    headlines,
    image_metrics,
    object_metrics,
)
from bench.evaluation.protocol import Protocol
from bench.evaluation.rows import EVALUATED, IMAGE, NOT_ANNOTATED, OBJECT

ALL_MOVING, FRAMES, CATEGORY = "all_moving", "frames", "category"
CLASS_AND_SPEED = "class_and_speed"
KEY, TERMS = ["breakdown", "slice", "recording", "metric"], ["numerator", "denominator"]
Breakdown = tuple[Sequence[str], Callable[[pd.DataFrame], "pd.Series[str]"]]


def bin_names(edges: Sequence[float]) -> tuple[str, ...]:
    """Names of the bins, for example "[0, 2)", "[2, 4)", "[4, inf)" of the edges 0, 2, 4."""
    return tuple(f"[{low:g}, {high:g})" for low, high in pairwise((*edges, np.inf)))


def name_bins(values: pd.Series[float], edges: Sequence[float]) -> pd.Series[str]:
    """The bin of each value, a name of `bin_names`; NaN for NaN and below the first edge."""
    return pd.cut(values, [*edges, np.inf], right=False, labels=bin_names(edges))


def name_slice(breakdown: str, name: str) -> str:
    """Return the name of a slice among all: "crossing", "all_moving", "range_m=[0, 2)"."""
    return name if breakdown in {CATEGORY, ALL_MOVING, FRAMES} else f"{breakdown}={name}"


def _named(column: str, names: Iterable[str]) -> Breakdown:
    return [*names], lambda rows: rows[column]


def _binned(column: str, edges: Sequence[float]) -> Breakdown:
    return bin_names(edges), lambda rows: name_bins(rows[column], edges)


def _by_class_and_speed(classes: Iterable[str], edges: Sequence[float]) -> Breakdown:
    names = [f"{name}, {speed}" for name in classes for speed in bin_names(edges)]

    def of(rows: pd.DataFrame) -> pd.Series[str]:
        speeds = name_bins(rows["speed_mps"], edges)
        joined = rows["object_class"].astype("str") + ", " + speeds.astype("str")  # all unknown, they have another type
        return joined.where(speeds.notna())  # before pandas 3, NaN as text is "nan"

    return names, of


def object_breakdowns(protocol: Protocol, cameras: Sequence[str] = ()) -> dict[str, Breakdown]:
    """Breakdowns of object-frames: all slices, also those without rows, and a function that names the slice of a row.

    Args:
        protocol: that the run was made with.
        cameras: of the run, where the names of all slices are needed.
    """
    bins = protocol.bins
    return {
        CATEGORY: _named("category", map(str, protocol.reference.categories)),
        ALL_MOVING: ([ALL_MOVING], lambda rows: pd.Series(ALL_MOVING, rows.index)),
        "object_class": _named("object_class", protocol.reference.classes),
        "range_m": _binned("range_m", bins.range_m),
        "speed_mps": _binned("speed_mps", bins.speed_mps),
        CLASS_AND_SPEED: _by_class_and_speed(protocol.reference.classes, bins.speed_mps),
        "ego_speed_mps": _binned("ego_speed_mps", bins.ego_speed_mps),
        "camera": _named("camera", cameras),
        "points": _binned("points", bins.points),
    }


def sum_run(objects: Iterable[pd.DataFrame], frames: Iterable[pd.DataFrame], *, protocol: Protocol) -> pd.DataFrame:
    """Reduce the tables of a run to sums, one part in memory at a time.

    Args:
        objects: of `OBJECTS_SCHEMA`, in parts of whole recordings.
        frames: of `FRAMES_SCHEMA`, likewise, at least `COLUMNS_OF_FRAMES`.
        protocol: that the run was made with.

    Returns:
        The table of sums, columns `KEY` and `TERMS`.
    """
    of_objects = [sum_objects(rows, protocol=protocol) for rows in objects]
    of_frames = [sum_frames(rows, protocol=protocol) for rows in frames]
    return add_sums([*of_objects, *of_frames])


def add_sums(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Add tables of sums; a recording's tracks are counted right if it is whole in one of them.

    Where images of a recording name different causes of false positives, a cause that they do not name has none of
    their pixels, but is a share of all.
    """
    added = pd.concat([*parts]).groupby(KEY, sort=False)[TERMS].sum().reset_index()
    of_cause = added["metric"].str.startswith(CAUSE)
    pixels = added[added["metric"] == "precision"]
    false_px = pixels.assign(denominator=pixels["denominator"] - pixels["numerator"])
    shares = [false_px.assign(metric=name, numerator=0.0) for name in sorted(set(added.loc[of_cause, "metric"]))]
    named = added[of_cause].assign(denominator=0.0)
    completed = pd.concat([named, *shares]).groupby(KEY, sort=False)[TERMS].sum().reset_index()
    return pd.concat([added[~of_cause], completed], ignore_index=True)


def sum_objects(objects: pd.DataFrame, *, protocol: Protocol) -> pd.DataFrame:
    """Reduce annotated object-frames of whole recordings, all columns, to sums that `add_sums` adds to others."""
    assert not objects.duplicated(OBJECT).any(), f"{OBJECT} names each row once"
    rows = objects[objects["status"] == EVALUATED]
    breakdowns = {name: of(rows) for name, (_, of) in object_breakdowns(protocol).items()}
    metrics = object_metrics(
        protocol.scoring.detection_levels,
        unknown_bands=protocol.reference.unknown_band is not None,
        ceilings=bool(rows["ceiling_tp"].notna().any()),
    )
    tracks = [_count_tracks(rows, name, slices) for name, slices in breakdowns.items()]
    ledger = _count(objects, "annotated", ("status", "reason"))
    return pd.concat([sum_metrics(rows, metrics, breakdowns), *tracks, ledger], ignore_index=True)


def sum_frames(frames: pd.DataFrame, *, protocol: Protocol) -> pd.DataFrame:
    """Reduce images of whole recordings, `COLUMNS_OF_FRAMES`, to sums that `add_sums` adds to others."""
    assert not frames.duplicated(IMAGE).any(), f"{IMAGE} names each row once"
    rows = frames[frames["status"] == EVALUATED]
    breakdowns = {
        FRAMES: pd.Series(FRAMES, rows.index),
        "ego_speed_mps": name_bins(rows["ego_speed_mps"], protocol.bins.ego_speed_mps),
        "camera": rows["camera"],
    }
    metrics = image_metrics(sorted({cause for px in rows["fp_by_cause"] for cause in px}))
    unknown = frames[frames["status"] == NOT_ANNOTATED]
    marked = sum_metrics(unknown, [MARKED], {FRAMES: pd.Series(FRAMES, unknown.index)})
    ledger = _count(frames, "images", ("status", "problem", "camera"))
    return pd.concat([sum_metrics(rows, metrics, breakdowns), marked, ledger], ignore_index=True)


def sum_metrics(
    rows: pd.DataFrame,
    metrics: Sequence[Definition],
    breakdowns: Mapping[str, pd.Series[str]],
    *,
    by: Sequence[str] = ("recording",),
) -> pd.DataFrame:
    """Sum the terms of metrics over the rows of each slice.

    Args:
        rows: evaluated object-frames or image-frames.
        metrics: of such rows.
        breakdowns: by name, the slice of each row.
        by: columns of the rows that are told apart within a slice.

    Returns:
        Columns breakdown, slice, metric and `TERMS`, and those of `by`.
    """
    terms = {(m.name, term): getattr(m, term)(rows).astype(np.float64) for m in metrics for term in TERMS}
    wide = pd.DataFrame(terms, index=rows.index).rename_axis(columns=["metric", "term"])
    without = [name for name, term in terms if not np.isfinite(wide[name, term]).all()]
    assert not without, f"every evaluated row has a number for each metric, not so for {without}"
    within = [rows[name].astype("category") for name in by]
    sums = [
        wide.groupby([slices.rename("slice"), *within], observed=True).sum().stack("metric", future_stack=True)  # noqa: PD013
        for slices in breakdowns.values()
    ]
    table = pd.concat([of.reset_index().assign(breakdown=name) for name, of in zip(breakdowns, sums, strict=True)])
    return table.rename_axis(columns=None).astype(dict.fromkeys({*KEY, *by}, str))


def _count_tracks(rows: pd.DataFrame, breakdown: str, slices: pd.Series[str]) -> pd.DataFrame:
    tracks = rows.groupby([slices.rename("slice"), "recording"], observed=True)["track_id"]
    counts = tracks.agg(numerator="nunique", denominator="size").astype(np.float64).reset_index()
    return counts.astype({"slice": str}).assign(breakdown=breakdown, metric="tracks")[[*KEY, *TERMS]]


def _count(rows: pd.DataFrame, metric: str, columns: Sequence[str]) -> pd.DataFrame:
    long = rows.melt("recording", [*columns], var_name="breakdown", value_name="slice").dropna()
    counts = long.groupby(["breakdown", "slice", "recording"]).size().astype(np.float64).reset_index(name="numerator")
    return counts.assign(metric=metric, denominator=counts["numerator"])[[*KEY, *TERMS]]


LARGEST = 1e15  # of a sum: the pixels of a billion images; whole numbers up to here are exact


def write_sums(table: pd.DataFrame, file: Path) -> None:
    """Store a table of sums as CSV, in the order of its key; numbers come back as they were."""
    write_text(file, table.sort_values(KEY)[[*KEY, *TERMS]].to_csv(index=False, lineterminator="\n"))


def read_sums(file: Path) -> pd.DataFrame:
    """Read a table of sums.

    Raises:
        DataError: missing, damaged, or not a table of sums; names the line.
    """
    expected, hint = f"a table of sums with the columns {', '.join([*KEY, *TERMS])}", "write it again from its run"
    try:
        with open_regular(file) as content:
            table = pd.read_csv(content, dtype=str, keep_default_na=False)
        if [*table.columns] != [*KEY, *TERMS]:
            raise ValueError(", ".join(map(str, table.columns)))
        table = table.astype(dict.fromkeys(TERMS, np.float64))
    except (OSError, ValueError) as error:  # pandas' own errors are of ValueError, as is UnicodeDecodeError
        raise DataError(file, expected=expected, got=" ".join(str(error).split()), hint=hint) from error
    wrong = ~((table[TERMS] >= 0) & (table[TERMS] <= LARGEST)).all(axis=1) | table.duplicated(KEY)
    if wrong.any():
        row = int(np.argmax(wrong))
        got, need = ", ".join(map(str, table.iloc[row])), f"each key once, with terms from 0 to {LARGEST:g}"
        raise DataError(file, field=f"line {row + 2}", expected=need, got=got, hint=hint)
    for name in {*table["metric"]} - {*COUNTS}:
        try:
            find_metric(name)
        except BenchError as error:
            raise DataError(file, field="metric", expected="known metrics", got=repr(name), hint=str(error)) from error
    return table


def recording_values(sums: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The headline metrics of each recording, over all its moving objects and its whole images.

    Args:
        sums: of a run.

    Returns:
        values: a row for each recording and a column for each metric, ratios; NaN without cases.
        cases: the same of their numbers, 0 without.
    """
    names = [metric.name for metric in headlines()]
    rows = sums[sums["breakdown"].isin([ALL_MOVING, FRAMES]) & sums["metric"].isin(names)]
    terms = [
        rows.pivot_table(term, index="recording", columns="metric", dropna=False, observed=True)
        for term in ("numerator", "denominator")
    ]
    values, cases = terms[0] / terms[1], terms[1]
    return values.reindex(columns=names), cases.reindex(columns=names).fillna(0)

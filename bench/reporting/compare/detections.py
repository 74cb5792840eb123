"""Which object-frames a run gained and lost against another, and which frames show it best."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import DataError
from bench.evaluation import changes_in_parts
from bench.evaluation.row_source import group_recordings
from bench.evaluation.slices import ALL_MOVING, IMAGE
from bench.reporting.compare.stored_runs import StoredRun

LISTED = 10  # of each kind, one per track
_COUNTED = ("object_frames", "before", "after", "gained", "lost")
_WORDS = ["recording", "camera", "track_id", "object_class", "category", "change"]


class Kind(StrEnum):
    """Why a frame is worth a look."""

    LOST = "newly missed"
    GAINED = "newly detected"
    FELL = "coverage fell"
    ROSE = "coverage rose"
    MORE_FALSE = "more false positives"
    FEWER_FALSE = "fewer false positives"


_OF_OBJECTS = (Kind.LOST, Kind.GAINED, Kind.FELL, Kind.ROSE)


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectionCounts:
    """Detected object-frames of a row; `after - before == gained - lost`."""

    name: str
    object_frames: int
    before: int
    after: int
    gained: int
    lost: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedFrame:
    """A frame that changed.

    Attributes:
        kind: in which way.
        recording: of the image.
        camera: of the image.
        timestamp_ns: of the image.
        track_id: of the object; None for false positives.
        what: the object in words; empty for false positives.
        before: coverage of the object, or false-positive coverage of the image.
        after: the same in the other run.
        iou_before: of the object; None for false positives.
        iou_after: of the object; None for false positives.
    """

    kind: Kind
    recording: str
    camera: str
    timestamp_ns: int
    track_id: str | None
    what: str
    before: float
    after: float
    iou_before: float | None
    iou_after: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectChanges:
    """What changed over all object-frames of two runs.

    Attributes:
        detections: gained and lost, by category and of all.
        frames: the object-frames that changed most.
    """

    detections: list[DetectionCounts]
    frames: list[ChangedFrame]


def paired_objects(before: StoredRun, after: StoredRun) -> Iterator[pd.DataFrame]:
    """The evaluated object-frames of both runs, one per row, as `object_changes` sets them side by side, in parts.

    Raises:
        DataError: the runs did not evaluate the same object-frames, though their summaries say so.
    """
    for part in changes_in_parts(before.objects, after.objects):
        rows: pd.DataFrame = part.to_pandas(categories=_WORDS)
        alone = rows[~rows["change"].isin(["gained", "lost", "both", "neither"])]
        if len(alone):
            first = " ".join(str(alone.iloc[0][name]) for name in (*IMAGE, "track_id"))
            raise DataError(
                after.folder / "objects.parquet",
                expected=f"the object-frames of {before.folder}, whose reference has the same fingerprint",
                got=f"at least {len(alone)} that only one has, first {first}",
                do="run again what was changed by hand",
            )
        yield rows


def sum_changes(parts: Iterable[pd.DataFrame], *, categories: tuple[str, ...], limit: int = LISTED) -> ObjectChanges:
    """Count the detections, and pick the object-frames that changed most.

    Args:
        parts: whole recordings, as `paired_objects` gives them.
        categories: of the protocol.
        limit: of object-frames of each kind; at most one of each track and kind, largest change of coverage first.
    """
    names = (*categories, ALL_MOVING)
    counted = {name: np.zeros(5, dtype=np.int64) for name in names}
    largest: dict[Kind, list[pd.DataFrame]] = {kind: [] for kind in _OF_OBJECTS}
    for rows in parts:
        for name in names:
            counted[name] += _detections(rows if name == ALL_MOVING else rows[rows["category"] == name])
        for kind, where in _kinds(rows).items():
            largest[kind] = [_largest([*largest[kind], rows[where]], limit=limit)]
    return ObjectChanges(
        detections=[
            DetectionCounts(name=name, **dict(zip(_COUNTED, counts.tolist(), strict=True)))
            for name, counts in counted.items()
        ],
        frames=[
            _object_frame(kind, row)
            for kind, kept in largest.items()
            for part in kept
            for row in part.to_dict("records")
        ],
    )


def changed_images(before: StoredRun, after: StoredRun) -> list[ChangedFrame]:
    """The image with most more and the one with most fewer false positives; none where nothing changed."""
    found: dict[Kind, tuple[float, dict[Hashable, Any]]] = {}
    counts = [run.frames.recordings() for run in (before, after)]
    for group in group_recordings({name: rows for name, rows in counts[0].items() if name in counts[1]}):
        rows = _false_shares(before, group).merge(_false_shares(after, group), on=IMAGE, suffixes=("_before", "_after"))
        rows = rows.sort_values(IMAGE, ignore_index=True)
        difference = (rows["share_after"] - rows["share_before"]).to_numpy()
        for kind, sign in ((Kind.MORE_FALSE, 1), (Kind.FEWER_FALSE, -1)):
            # Of equals the first: recordings come in order.
            if len(rows) and (sign * difference).max() > found.get(kind, (0.0, {}))[0]:
                place = int(np.argmax(sign * difference))
                found[kind] = float(sign * difference[place]), rows.iloc[place].to_dict()
    return [_image(kind, found[kind][1]) for kind in (Kind.MORE_FALSE, Kind.FEWER_FALSE) if kind in found]


def _image(kind: Kind, row: Mapping[Hashable, Any]) -> ChangedFrame:
    return ChangedFrame(
        kind=kind, recording=str(row["recording"]), camera=str(row["camera"]), timestamp_ns=int(row["timestamp_ns"]),
        track_id=None, what="", before=float(row["share_before"]), after=float(row["share_after"]), iou_before=None,
        iou_after=None,
    )  # fmt: skip


def _detections(rows: pd.DataFrame) -> NDArray[np.int64]:
    """The counts of `_COUNTED`."""
    flags = [rows["detected_before"], rows["detected_after"], rows["change"] == "gained", rows["change"] == "lost"]
    return np.array([len(rows), *(int(flag.sum()) for flag in flags)], dtype=np.int64)


def _kinds(rows: pd.DataFrame) -> dict[Kind, pd.Series[bool]]:
    difference = rows["coverage_after"] - rows["coverage_before"]
    both = rows["change"] == "both"
    return {
        Kind.LOST: rows["change"] == "lost",
        Kind.GAINED: rows["change"] == "gained",
        Kind.FELL: both & (difference < 0),
        Kind.ROSE: both & (difference > 0),
    }


def _largest(parts: Sequence[pd.DataFrame], *, limit: int) -> pd.DataFrame:
    """The largest changes, one of each track; of equals the largest object, then the first."""
    rows = pd.concat(
        [part.astype(dict.fromkeys(_WORDS, object)) for part in (_candidates(rows, limit=limit) for rows in parts)]
    )
    size = (rows["coverage_after"] - rows["coverage_before"]).abs()
    order = rows.assign(size=size).sort_values(
        ["size", "region_px", *IMAGE, "track_id"], ascending=[False, False, *[True] * 4]
    )
    return order.drop_duplicates(["recording", "track_id"]).head(limit).drop(columns="size")


def _candidates(rows: pd.DataFrame, *, limit: int) -> pd.DataFrame:
    """The same of one part, whose rows are in canonical order, without sorting its strings."""
    size = (rows["coverage_after"] - rows["coverage_before"]).abs()
    order = np.lexsort([-rows["region_px"].to_numpy(), -size.to_numpy()])  # stable: of equals the first
    first = rows.iloc[order].drop_duplicates(["recording", "track_id"])
    return first.head(limit)


def _object_frame(kind: Kind, row: Mapping[Hashable, Any]) -> ChangedFrame:
    category = str(row["category"]).replace("_", " ")
    return ChangedFrame(
        kind=kind,
        recording=str(row["recording"]),
        camera=str(row["camera"]),
        timestamp_ns=int(row["timestamp_ns"]),
        track_id=str(row["track_id"]),
        what=f"{row['object_class']} '{row['track_id']}', {category}, {float(row['range_m']):.1f} m",
        before=float(row["coverage_before"]),
        after=float(row["coverage_after"]),
        iou_before=float(row["iou_before"]),
        iou_after=float(row["iou_after"]),
    )


def _false_shares(run: StoredRun, recordings: Sequence[str]) -> pd.DataFrame:
    table = run.frames.read(recordings, [*IMAGE, "status", "width", "height", "fp_px"])
    frames: pd.DataFrame = table.to_pandas().astype(dict.fromkeys(IMAGE[:2], object))
    scored = frames[frames["status"] == "evaluated"]
    return scored[IMAGE].assign(share=scored["fp_px"] / (scored["width"] * scored["height"]))

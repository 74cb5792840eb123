"""Which object-frames a run gained and lost against another, and which frames show it best."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd

from bench.errors import DataError
from bench.evaluation.score_sheet import object_changes
from bench.evaluation.slices import ALL_MOVING, IMAGE
from bench.reporting.compare.stored_runs import StoredRun

LISTED = 10  # of each kind, one per track


class Kind(StrEnum):
    """Why a frame is worth a look."""

    LOST = "newly missed"
    GAINED = "newly detected"
    FELL = "coverage fell"
    ROSE = "coverage rose"
    MORE_FALSE = "more false positives"
    FEWER_FALSE = "fewer false positives"


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


def paired_objects(before: StoredRun, after: StoredRun) -> pd.DataFrame:
    """The evaluated object-frames of both runs, one per row, as `object_changes` sets them side by side.

    Raises:
        DataError: the runs did not evaluate the same object-frames, though their summaries say so.
    """
    rows: pd.DataFrame = object_changes(before.objects, after.objects).to_pandas()
    alone = rows[~rows["change"].isin(["gained", "lost", "both", "neither"])]
    if len(alone):
        first = " ".join(str(alone.iloc[0][name]) for name in (*IMAGE, "track_id"))
        raise DataError(
            after.folder / "objects.parquet",
            wanted=f"the object-frames of {before.folder}, whose reference has the same fingerprint",
            came=f"{len(alone)} that only one has, first {first}",
            do="run again what was changed by hand",
        )
    return rows


def count_detections(rows: pd.DataFrame, *, categories: tuple[str, ...]) -> list[DetectionCounts]:
    """Gained and lost detections by category, then of all moving objects."""
    slices = {name: rows[rows["category"] == name] for name in categories} | {ALL_MOVING: rows}
    return [
        DetectionCounts(
            name=name,
            object_frames=len(part),
            before=int(part["detected_before"].sum()),
            after=int(part["detected_after"].sum()),
            gained=int((part["change"] == "gained").sum()),
            lost=int((part["change"] == "lost").sum()),
        )
        for name, part in slices.items()
    ]


def changed_objects(rows: pd.DataFrame, *, limit: int = LISTED) -> list[ChangedFrame]:
    """The object-frames that changed most, at most one of each track and kind, largest change of coverage first."""
    difference = rows["coverage_after"] - rows["coverage_before"]
    both = rows["change"] == "both"
    kinds = {
        Kind.LOST: rows["change"] == "lost",
        Kind.GAINED: rows["change"] == "gained",
        Kind.FELL: both & (difference < 0),
        Kind.ROSE: both & (difference > 0),
    }
    found = []
    for kind, where in kinds.items():
        part = rows[where].assign(size=difference[where].abs())
        part = part.sort_values(["size", "region_px", *IMAGE, "track_id"], ascending=[False, False, *[True] * 4])
        part = part.drop_duplicates(["recording", "track_id"]).head(limit)
        found += [_object_frame(kind, row) for row in part.to_dict("records")]
    return found


def changed_images(before: StoredRun, after: StoredRun) -> list[ChangedFrame]:
    """The image with most more and the one with most fewer false positives; none where nothing changed."""
    shares = [_false_shares(run) for run in (before, after)]
    rows = shares[0].merge(shares[1], on=IMAGE, suffixes=("_before", "_after")).sort_values(IMAGE, ignore_index=True)
    difference = (rows["share_after"] - rows["share_before"]).to_numpy()
    found = []
    for kind, sign in ((Kind.MORE_FALSE, 1), (Kind.FEWER_FALSE, -1)):
        if len(rows) and (sign * difference).max() > 0:
            row = rows.iloc[int(np.argmax(sign * difference))]
            found.append(
                ChangedFrame(
                    kind=kind, recording=str(row["recording"]), camera=str(row["camera"]),
                    timestamp_ns=int(row["timestamp_ns"]), track_id=None, what="",
                    before=float(row["share_before"]), after=float(row["share_after"]), iou_before=None, iou_after=None,
                )
            )  # fmt: skip
    return found


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


def _false_shares(run: StoredRun) -> pd.DataFrame:
    frames: pd.DataFrame = run.frames.select([*IMAGE, "status", "width", "height", "fp_px"]).to_pandas()
    scored = frames[frames["status"] == "evaluated"]
    return scored[IMAGE].assign(share=scored["fp_px"] / (scored["width"] * scored["height"]))

"""What changed from one run to another: metrics by row with what may be said of them, and object-frames."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import DataError
from bench.evaluation import Protocol, changes_in_parts
from bench.evaluation.intervals import FEWEST_RECORDINGS
from bench.evaluation.recording_sums import PairedChange, holm, paired_change, recording_sums_of
from bench.evaluation.row_source import IMAGE, group_recordings
from bench.evaluation.slices import ALL_MOVING, FRAMES
from bench.evaluation.summary import Metric, Summary, summary_of
from bench.evaluation.sums import RunSums
from bench.reporting.compare.runs import StoredRun

SIGNIFICANCE = 0.05


class Verdict(StrEnum):
    """A change in words."""

    BETTER = "better"
    WORSE = "worse"
    NOT_SHOWN = "no difference that the data can show"
    THE_SAME = "the same"
    TOO_FEW = "too few recordings for a verdict"
    NO_CASES = "no cases in one of the runs"


def judge(change: PairedChange, *, p_holm: float | None, lower_is_better: bool) -> Verdict:
    """Say what a change shows.

    Args:
        change: of a metric.
        p_holm: its p-value, corrected for the rows of the metric.
        lower_is_better: of the metric.

    Returns:
        Better or worse only if the 95 % interval excludes 0 and the corrected p-value is at most 5 %; neither is there
        for fewer than six recordings.
    """
    if math.isnan(change.difference):
        return Verdict.NO_CASES
    if change.difference == 0 and change.ci95 is None:
        return Verdict.THE_SAME
    if change.ci95 is None or p_holm is None:
        return Verdict.TOO_FEW
    low, high = change.ci95
    if low <= 0 <= high or p_holm > SIGNIFICANCE:
        return Verdict.NOT_SHOWN
    return Verdict.BETTER if (change.difference < 0) == lower_is_better else Verdict.WORSE


def verdict_text(verdict: Verdict, change: PairedChange) -> str:
    """A verdict for people, for example "better" or "too few recordings for a verdict: 4, needs 6"."""
    if verdict is Verdict.TOO_FEW:
        return f"{verdict.value}: {change.recordings}, needs {FEWEST_RECORDINGS}"
    return verdict.value


FALSE_POSITIVE_COVERAGE = "false_positive_coverage"
# The metrics that are judged, and the only ones whose p-values are corrected.
HEADLINES = {
    "detection_rate": "Detection rate",
    "tpr": "TPR, detected",
    "iou_detected": "IoU, detected",
    FALSE_POSITIVE_COVERAGE: "False-positive coverage",
}
_OF_FRAMES = (FALSE_POSITIVE_COVERAGE, "false_positive_coverage_valid", "false_positive_frame_rate", "segmentation_iou",
              "precision", "recall")  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricChange:
    """One metric of one row.

    Attributes:
        change: before, after, and the paired interval.
        p_holm: p-value corrected over the rows of the metric; None for metrics that are not headlines, and where there
            is no p-value.
        verdict: None for metrics that are not headlines.
        chance: chance level before and after; None where the metric has none.
    """

    change: PairedChange
    p_holm: float | None
    verdict: Verdict | None
    chance: tuple[Metric, Metric] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RowChange:
    """One row of the table.

    Attributes:
        name: category, "all_moving" or "frames".
        label: for tables.
        frames: object-frames, in the last row image-frames.
        recordings: that hold them.
        metrics: by name.
    """

    name: str
    label: str
    frames: int
    recordings: int
    metrics: Mapping[str, MetricChange]


def row_changes(sums_before: RunSums, sums_after: RunSums, *, rules: Protocol) -> list[RowChange]:
    """Compare the categories, all moving objects, and the false positives.

    Holm's correction runs over the rows of one headline metric that have a p-value: the categories and the row of all
    moving objects. False-positive coverage has one row, so that its p-value stays as it is. A row without a p-value
    (cases of both in fewer than six recordings) does not count.

    Args:
        sums_before: of the run compared against.
        sums_after: of the other run.
        rules: their protocol.
    """
    before, after = (recording_sums_of(sums, protocol=rules) for sums in (sums_before, sums_after))
    summaries = summary_of(sums_before, protocol=rules), summary_of(sums_after, protocol=rules)
    of_objects = [*(str(category) for category in rules.reference.categories), ALL_MOVING]
    names = {row: [name for name in before.slices[row] if name not in _OF_FRAMES] for row in of_objects}
    names[FRAMES] = list(_OF_FRAMES)
    sums = {(row, m): (before.slices[row][m], after.slices[row][m]) for row, metrics in names.items() for m in metrics}
    changes = {key: paired_change(*pair) for key, pair in sums.items()}
    corrected = _corrected({key: change.p_value for key, change in changes.items()})

    def metric_change(row: str, metric: str) -> MetricChange:
        key = row, metric
        verdict = None
        if metric in HEADLINES:
            lower = metric == FALSE_POSITIVE_COVERAGE
            verdict = judge(changes[key], p_holm=corrected[key], lower_is_better=lower)
        return MetricChange(
            change=changes[key],
            p_holm=corrected.get(key),
            verdict=verdict,
            chance=_chance(row, metric, summaries),
        )

    return [
        RowChange(
            name=row,
            label=_label(row),
            frames=before.counts[row]["evaluated" if row == FRAMES else "object_frames"],
            recordings=len(sums[row, metrics[0]][0].denominators),
            metrics={metric: metric_change(row, metric) for metric in metrics},
        )
        for row, metrics in names.items()
    ]


def headline_changes(rows: list[RowChange]) -> list[tuple[str, MetricChange]]:
    """The headline metrics over everything: all moving objects, and the false positives of all images."""
    by_name = {row.name: row for row in rows}
    return [(m, by_name[FRAMES if m == FALSE_POSITIVE_COVERAGE else ALL_MOVING].metrics[m]) for m in HEADLINES]


def _corrected(p_values: Mapping[tuple[str, str], float | None]) -> dict[tuple[str, str], float | None]:
    corrected: dict[tuple[str, str], float | None] = {}
    for metric in HEADLINES:
        keys = [key for key in p_values if key[1] == metric]
        corrected |= dict(zip(keys, holm([p_values[key] for key in keys]), strict=True))
    return corrected


def _chance(row: str, metric: str, summaries: tuple[Summary, Summary]) -> tuple[Metric, Metric] | None:
    if not metric.startswith("detection_rate"):
        return None
    name = metric.replace("detection_rate", "chance")
    before, after = (s.all_moving if row == ALL_MOVING else s.categories[row] for s in summaries)
    return before.metric(name), after.metric(name)


def _label(row: str) -> str:
    return "False positives" if row == FRAMES else row.replace("_", " ").capitalize()


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

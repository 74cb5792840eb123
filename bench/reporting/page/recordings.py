"""The recordings of a run, the worst first, each with a link to its object-frames and to its worst case."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pandas as pd

from bench.evaluation import sum_run
from bench.evaluation.sums import ALL_MOVING, FRAMES
from bench.reporting.page.worst import WorstCases
from bench.reporting.stored_run import StoredRun

LISTED_RECORDINGS = 200
NOTHING = 0, math.nan  # cases and value


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingRow:
    """One recording; metrics are NaN without cases.

    Attributes:
        name: of the recording.
        images: scored ones.
        object_frames: evaluated ones.
        iou: over all object-frames.
        tpr_all: over all object-frames.
        coverage: share of the image that is wrongly marked.
        card: element of its worst case; empty where the page has none of it.
    """

    name: str
    images: int
    object_frames: int
    iou: float
    tpr_all: float
    coverage: float
    card: str


def recording_rows(run: StoredRun, worst: WorstCases) -> tuple[list[RecordingRow], int]:
    """The recordings with the lowest IoU first, those without object-frames last.

    Returns:
        rows: at most `LISTED_RECORDINGS`.
        total: how many recordings there are.
    """
    sums = sum_run(run.objects, run.frames, protocol=run.protocol)
    images = _by_recording(sums, FRAMES, "false_positive_coverage")
    objects = {name: _by_recording(sums, ALL_MOVING, name) for name in ("iou", "tpr_all")}
    cards = [*(card for some in worst.objects.values() for card in some), *worst.images]
    first = {card.key[0]: card.element for card in reversed(cards)}
    names = sorted({*images, *objects["iou"]})
    rows = [
        RecordingRow(
            name=name,
            images=images.get(name, NOTHING)[0],
            object_frames=objects["iou"].get(name, NOTHING)[0],
            iou=objects["iou"].get(name, NOTHING)[1],
            tpr_all=objects["tpr_all"].get(name, NOTHING)[1],
            coverage=images.get(name, NOTHING)[1],
            card=first.get(name, ""),
        )
        for name in names
    ]
    rows.sort(key=lambda row: (math.isnan(row.iou), row.iou, row.name))
    return rows[:LISTED_RECORDINGS], len(rows)


def _by_recording(sums: pd.DataFrame, breakdown: str, metric: str) -> dict[str, tuple[int, float]]:
    """Cases and value of each recording."""
    rows = sums[(sums["breakdown"] == breakdown) & (sums["metric"] == metric)]
    values = rows["numerator"] / rows["denominator"]
    return dict(zip(rows["recording"], zip(rows["denominator"].astype(int), values, strict=True), strict=True))

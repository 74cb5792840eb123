"""The recordings of a run, the worst first, each with a link to its object-frames and to its worst case."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.evaluation.paired import MetricSums, recording_sums
from bench.evaluation.slices import ALL_MOVING, FRAMES
from bench.reporting.page.worst import WorstCases
from bench.reporting.stored_run import StoredRun

LISTED_RECORDINGS = 200
NOTHING = MetricSums(numerators={}, denominators={})


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
    slices = recording_sums(run.objects, run.frames, protocol=run.protocol).slices
    objects, frames = slices.get(ALL_MOVING, {}), slices.get(FRAMES, {})
    iou, tpr_all = (objects.get(name, NOTHING) for name in ("iou", "tpr_all"))
    coverage = frames.get("false_positive_coverage", NOTHING)
    cards = [*(card for some in worst.objects.values() for card in some), *worst.images]
    first = {card.key[0]: card.element for card in reversed(cards)}
    rows = [
        RecordingRow(
            name=name,
            images=int(coverage.denominators.get(name, 0)),
            object_frames=int(iou.denominators.get(name, 0)),
            iou=_ratio(iou, name),
            tpr_all=_ratio(tpr_all, name),
            coverage=_ratio(coverage, name),
            card=first.get(name, ""),
        )
        for name in sorted(iou.denominators.keys() | coverage.denominators.keys())
    ]
    rows.sort(key=lambda row: (math.isnan(row.iou), row.iou, row.name))
    return rows[:LISTED_RECORDINGS], len(rows)


def _ratio(sums: MetricSums, name: str) -> float:
    return sums.numerators[name] / sums.denominators[name] if name in sums.denominators else math.nan

"""The sums behind every figure, by recording: what a gate or a comparison needs to judge a change in pairs.

A summary's figures cannot be compared in pairs, as their sums are gone. A score sheet keeps them, by slice, metric and
recording, small enough to be committed as a baseline. `paired_change` then leaves whole recordings out, the same
before and after, so that what makes a recording hard cancels out.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict

from bench.evaluation.changes import object_changes
from bench.evaluation.metric_sums import MetricSums, frame_metrics, metric_sums, object_metrics
from bench.evaluation.paired import PairedChange, holm, paired_change
from bench.evaluation.protocol import Protocol
from bench.evaluation.row_source import Rows
from bench.evaluation.run_sums import RunSums, sum_run
from bench.evaluation.slices import ALL_MOVING, FRAMES, slice_name

__all__ = ["MetricSums", "PairedChange", "ScoreSheet", "holm", "object_changes", "paired_change", "score_sheet"]


class ScoreSheet(BaseModel):
    """All metrics of a run with their sums.

    Attributes:
        slices: slice -> metric -> sums. Slices are the categories, "all_moving", "frames" (the image-frames), and
            "<breakdown>=<bin or name>" for the breakdowns of the summary, for example "range_m=[0, 2)".
        counts: slice -> name -> how many. "object_frames", "tracks" and "recordings" for slices of objects;
            "all_moving" also has "annotated", "static", "ignored"; "frames" has "images", "evaluated", "failed",
            "skipped".
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    slices: dict[str, dict[str, MetricSums]]
    counts: dict[str, dict[str, int]]


def score_sheet(objects: Rows, frames: Rows, *, protocol: Protocol, rows_at_once: int | None = None) -> ScoreSheet:
    """Reduce the tables of a run to sums, whatever the order of their rows.

    Args:
        objects: of `OBJECTS_SCHEMA`, in memory or stored.
        frames: of `FRAMES_SCHEMA`, in memory or stored.
        protocol: that the run was made with.
        rows_at_once: most rows in memory, unless one recording has more; changes no bit of the sums.
    """
    return sheet_of(sum_run(objects, frames, protocol=protocol, rows_at_once=rows_at_once), protocol=protocol)


def sheet_of(sums: RunSums, *, protocol: Protocol) -> ScoreSheet:
    """The score sheet of a run from its sums."""
    of_objects, of_frames = object_metrics(protocol.scoring.detection_levels), frame_metrics()
    slices: dict[str, dict[str, MetricSums]] = {}
    counts: dict[str, dict[str, int]] = {}
    for split, part in sums.objects.items():
        for place, name in enumerate(part.names):
            called = slice_name(split, name)
            slices[called] = metric_sums(part, place, of_objects, recordings=sums.recordings)
            counts[called] = {
                "object_frames": int(part.rows[:, place].sum()),
                "tracks": int(part.tracks[:, place].sum()),
                "recordings": int(np.count_nonzero(part.rows[:, place])),
            }
    for split, part in sums.frames.items():
        for place, name in enumerate(part.names):
            called = slice_name(split, name)
            # A breakdown that images have too, for example "camera=front", holds the metrics of both.
            of_images = metric_sums(part, place, of_frames, recordings=sums.recordings)
            slices[called] = slices.get(called, {}) | of_images
            counts[called] = counts.get(called, {}) | {"frames": int(part.rows[:, place].sum())}
    objects, images = sums.object_ledger, sums.frame_ledger
    counts[ALL_MOVING] |= {"annotated": objects.rows} | {k: objects.statuses[k] for k in ("static", "ignored")}
    counts[FRAMES] |= {"images": images.rows} | {k: images.statuses[k] for k in ("evaluated", "failed", "skipped")}
    return ScoreSheet(slices=slices, counts=counts)

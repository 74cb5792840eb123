"""The sums behind every figure, by recording: what a gate or a comparison needs to judge a change in pairs.

A summary's figures cannot be compared in pairs, as their sums are gone. A score sheet keeps them, by slice, metric and
recording, small enough to be committed as a baseline. `paired_change` then resamples whole recordings, with the same
weights before and after, so that what makes a recording hard cancels out.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
from pydantic import BaseModel, ConfigDict

from bench.evaluation.changes import object_changes
from bench.evaluation.metric_sums import MetricSums, by_recording, frame_metrics, object_metrics
from bench.evaluation.paired import PairedChange, holm, paired_change
from bench.evaluation.protocol import Protocol
from bench.evaluation.slices import ALL_MOVING, FRAMES, IMAGE, frame_slices, object_slices, read_rows
from bench.reference.records import Status

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


def score_sheet(objects: pa.Table, frames: pa.Table, *, protocol: Protocol) -> ScoreSheet:
    """Reduce the tables of a run to sums, whatever the order of their rows.

    Args:
        objects: of `OBJECTS_SCHEMA`.
        frames: of `FRAMES_SCHEMA`.
        protocol: that the run was made with.
    """
    annotated, images = read_rows(objects, key=[*IMAGE, "track_id"]), read_rows(frames, key=IMAGE)
    evaluated = annotated[annotated["status"] == Status.EVALUATED.value].reset_index(drop=True)
    scored = images[images["status"] == "evaluated"].reset_index(drop=True)
    cameras = sorted(set(images["camera"]))
    of_objects = object_slices(evaluated, protocol=protocol, cameras=cameras)
    of_frames = frame_slices(scored, protocol=protocol, cameras=cameras)

    object_sums = by_recording(evaluated, object_metrics(evaluated, protocol))
    frame_sums = by_recording(scored, frame_metrics(scored))
    slices = {name: object_sums(where) for name, where in of_objects.items()}
    counts = {name: _object_counts(evaluated[where]) for name, where in of_objects.items()}
    for name, where in of_frames.items():
        # A breakdown that images have too, for example "camera=front", holds the metrics of both.
        slices[name] = slices.get(name, {}) | frame_sums(where)
        counts[name] = counts.get(name, {}) | {"frames": int(np.count_nonzero(where))}
    counts[ALL_MOVING] |= {"annotated": len(annotated)} | _by_status(annotated, ("static", "ignored"))
    counts[FRAMES] |= {"images": len(images)} | _by_status(images, ("evaluated", "failed", "skipped"))
    return ScoreSheet(slices=slices, counts=counts)


def _object_counts(rows: pd.DataFrame) -> dict[str, int]:
    return {
        "object_frames": len(rows),
        "tracks": len(rows[["recording", "track_id"]].drop_duplicates()),
        "recordings": int(rows["recording"].nunique()),
    }


def _by_status(rows: pd.DataFrame, names: tuple[str, ...]) -> dict[str, int]:
    return {name: int((rows["status"] == name).sum()) for name in names}

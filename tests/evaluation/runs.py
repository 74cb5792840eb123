"""Small runs to reduce: tables from drawings, and random tables."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.rows import FRAME_COUNTS, FRAMES_SCHEMA, IMAGE, OBJECTS_SCHEMA, to_frame
from bench.evaluation.scorer import SequenceScorer
from bench.evaluation.summary import Summary
from bench.evaluation.sums import sum_run
from bench.records.reference import Direction, IgnoreReason, ReferenceFrame, Status
from bench.records.segmentation import Segmentation
from tests.support.result_rows import summarise

PAPER = load_protocol("paper-v1")
COUNTS = (*FRAME_COUNTS, "undefined_px")
PLACES = {"range_m": (0, 8), "x_m": (-8, 11), "y_m": (-8, 8), "speed_mps": (0, 5)}


def scored(
    pairs: Sequence[tuple[ReferenceFrame, NDArray[np.bool_]]], *, protocol: Protocol = PAPER
) -> tuple[pa.Table, pa.Table]:
    """The tables of one sequence."""
    scorer = SequenceScorer(protocol)
    for frame, detected in pairs:
        scorer.add(frame, Segmentation(cell_size_px=1, mask=detected))
    return scorer.finish()


def summary_of(tables: tuple[pa.Table, pa.Table]) -> Summary:
    return summarise(*tables, protocol=PAPER)


def joined(tables: Sequence[tuple[pa.Table, pa.Table]]) -> tuple[pa.Table, pa.Table]:
    """The tables of several sequences as one run."""
    return pa.concat_tables([t[0] for t in tables]), pa.concat_tables([t[1] for t in tables])


@cache
def random_sums(seed: int, *, recordings: int = 6, images: int = 12) -> pd.DataFrame:
    """The sums of a random run; nobody changes them."""
    objects, frames = map(to_frame, random_run(seed, recordings=recordings, images=images))
    return sum_run([objects], [frames], protocol=PAPER)


@cache
def random_run(seed: int, *, recordings: int = 6, images: int = 12) -> tuple[pa.Table, pa.Table]:
    """A run with every status, category, class and camera, and rows that fit no reality."""
    draw = np.random.default_rng(seed)
    frames = [
        _frame_row(draw, f"drive-{r}", camera, n * 66_000_000)
        for r in range(recordings)
        for camera in ("front", "left")
        for n in range(images)
    ]
    objects = [
        _object_row(draw, frame, f"track-{k}")
        for frame in frames
        for k in range(draw.integers(0, 5))
        if frame["status"] == "evaluated"
    ]
    return pa.Table.from_pylist(objects, schema=OBJECTS_SCHEMA), pa.Table.from_pylist(frames, schema=FRAMES_SCHEMA)


def shuffled(table: pa.Table, seed: int) -> pa.Table:
    return table.take(pa.array(np.random.default_rng(seed).permutation(len(table))))


def _frame_row(draw: np.random.Generator, recording: str, camera: str, timestamp_ns: int) -> dict[str, object]:
    image = dict(zip(IMAGE, (recording, camera, timestamp_ns), strict=True)) | {"ego_speed_mps": draw.uniform(0, 12)}
    if draw.random() < 0.1:
        return image | dict.fromkeys(COUNTS, 0) | {"status": "failed", "problem": "truncated image", "fp_by_cause": []}
    counts = {name: int(draw.integers(1, 200)) for name in COUNTS} | {"width": 20, "height": 20, "valid_px": 300}
    depth = counts["fp_px"] // 3
    causes = [("depth", depth), ("epipolar", counts["fp_px"] - depth)]
    return image | counts | {"status": "evaluated", "problem": None, "fp_by_cause": causes}


def _object_row(draw: np.random.Generator, frame: dict[str, object], track_id: str) -> dict[str, object]:
    status = draw.choice(list(Status))
    evaluated = status == Status.EVALUATED
    region, fp = (int(draw.integers(1, 500)), int(draw.integers(0, 90))) if evaluated else (0, 0)
    tp = int(draw.integers(0, region + 1)) if draw.random() < 0.8 else 0
    return {
        **{key: frame[key] for key in (*IMAGE, "ego_speed_mps")},
        "track_id": track_id,
        "object_class": draw.choice(PAPER.reference.classes),
        "status": str(status),
        "reason": str(draw.choice(list(IgnoreReason))) if status == Status.IGNORED else None,
        "category": None if status == Status.STATIC else str(draw.choice(PAPER.reference.categories)),
        "direction": str(draw.choice(list(Direction))) if draw.random() < 0.9 else None,
        **{name: draw.uniform(*ends) for name, ends in PLACES.items()},
        "points": int(draw.integers(10, 2000)),
        "polygon_px": region,
        "region_px": region,
        "tp": tp,
        "fn": region - tp,
        "fp": fp,
        "unknown_px": 0,
        "chance_tp": int(draw.integers(0, region + 1)) if evaluated and draw.random() < 0.8 else None,
    }

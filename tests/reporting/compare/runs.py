"""Stored runs whose differences a reader can count."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pandas as pd
import pyarrow as pa

from bench.evaluation import (
    FRAMES_SCHEMA,
    OBJECTS_SCHEMA,
    Summary,
    load_protocol,
    sum_run,
    summary_of,
    write_sums,
)
from bench.harness import stored
from bench.harness.manifest import ANSWERS_MANIFEST, write_manifest
from bench.harness.stored import SUMS
from tests.support.counts import write_counts
from tests.support.manifests import manifest, provenance
from tests.support.result_rows import NO_COUNTS, TableRows

RECORDINGS, IMAGES = 8, 4
REGION_PX, IMAGE_PX = 100, 640 * 480

# (recording, image, category) -> detected pixels of the one object of that kind
Detected = dict[tuple[int, int, str], int]


def drawn(px: int, *, categories: tuple[str, ...] = ("crossing", "preceding")) -> Detected:
    """Every object of every image with the same number of detected pixels; preceding ones in three recordings only."""
    return {
        (r, n, category): px
        for r in range(RECORDINGS)
        for n in range(IMAGES)
        for category in categories
        if category != "preceding" or r < 3
    }


def write_run(
    folder: Path,
    detected: Detected,
    *,
    fp_px: int = 3072,
    protocol: str = "paper-v1",
    dataset: str = "demo",
    split: str | None = None,
    method: str = "nothing",
    settings: dict[str, object] | None = None,
    region_px: int = REGION_PX,
) -> Path:
    """Store a run; all of its reference comes from the keys of `detected` and from `region_px`."""
    results = folder / protocol
    rules = load_protocol(protocol)
    objects, frames, sums, metrics = _counted(tuple(detected.items()), fp_px, region_px, protocol)
    write_counts(results, objects, frames)
    write_sums(sums, results / SUMS)
    own = manifest(
        dataset=dataset, card="nowhere.yaml", split=split, method=method, settings=settings, protocol=rules,
        commit="0123456789+",
    )  # fmt: skip
    write_manifest(folder / ANSWERS_MANIFEST, own)
    stored.write_run(
        results, metrics, protocol=rules, manifest=own,
        provenance=provenance(images=len(frames)),
        vehicle_outline_m=((-1.0, -0.9), (3.8, -0.9), (3.8, 0.9), (-1.0, 0.9)),
    )  # fmt: skip
    return folder


@cache
def _counted(
    detected: tuple[tuple[tuple[int, int, str], int], ...], fp_px: int, region_px: int, protocol: str
) -> tuple[pa.Table, pa.Table, pd.DataFrame, Summary]:
    """Objects and frames, their sums and metrics; tests draw the same few runs again and again."""
    rules = load_protocol(protocol)
    objects = pa.Table.from_pylist([_object(*key, px, region_px) for key, px in detected], OBJECTS_SCHEMA)
    images = sorted({key[:2] for key, _ in detected})
    frames = pa.Table.from_pylist([_frame(*image, fp_px, region_px) for image in images], FRAMES_SCHEMA)
    sums = sum_run(TableRows(objects), TableRows(frames), protocol=rules)
    return objects, frames, sums, summary_of(sums, protocol=rules)


def _object(recording: int, image: int, category: str, px: int, region_px: int) -> dict[str, object]:
    return {
        **NO_COUNTS, **_key(recording, image), "track_id": category, "object_class": "vehicle", "status": "evaluated",
        "reason": None, "category": category, "direction": "lateral", "range_m": 4.0, "x_m": 5.5, "y_m": 2.5,
        "speed_mps": 2.0, "points": 50, "polygon_px": region_px, "region_px": region_px, "tp": px,
        "fn": region_px - px, "fp": 10, "unknown_px": 0, "chance_tp": 5,
    }  # fmt: skip


def _frame(recording: int, image: int, fp_px: int, region_px: int) -> dict[str, object]:
    counts = {field.name: 0 for field in FRAMES_SCHEMA if field.type == pa.int64()}
    size = {"width": 640, "height": 480, "valid_px": 300_000, "fp_px": fp_px, "reference_px": region_px}
    return counts | _key(recording, image) | size | {"status": "evaluated", "problem": None, "fp_by_cause": []}


def _key(recording: int, image: int) -> dict[str, object]:
    times = {"timestamp_ns": image * 100_000_000, "ego_speed_mps": 1.0}
    return {"recording": f"drive-{recording}", "camera": "front"} | times

"""Stored runs whose differences a reader can count."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pyarrow as pa

from bench.evaluation.protocol import load_protocol
from bench.harness.manifest import ANSWERS_MANIFEST, write_manifest
from bench.harness.stored import write_results
from tests.support.counts import write_counts
from tests.support.manifests import manifest, provenance
from tests.support.result_rows import frame_row, frames_table, object_row, objects_table
from tests.support.tiny import OUTLINE_M

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
    region_px: int = REGION_PX,
    **of_run: object,
) -> Path:
    """Store a run; all of its reference comes from `detected` and `region_px`, what else its manifest has `of_run`."""
    results = folder / protocol
    rules = load_protocol(protocol)
    objects, frames = _counted(tuple(detected.items()), fp_px, region_px)
    write_counts(results, objects, frames)
    own = manifest(card="nowhere.yaml", protocol=rules, commit="0123456789+", **of_run)
    write_manifest(folder / ANSWERS_MANIFEST, own)
    how = provenance(images=len(frames))
    write_results(results, protocol=rules, manifest=own, provenance=how, vehicle_outline_m=OUTLINE_M.tolist())
    return folder


@cache
def _counted(
    detected: tuple[tuple[tuple[int, int, str], int], ...], fp_px: int, region_px: int
) -> tuple[pa.Table, pa.Table]:
    """Objects and frames; tests draw the same few runs again and again."""
    objects = objects_table([_object(*key, px, region_px) for key, px in detected])
    images = sorted({key[:2] for key, _ in detected})
    return objects, frames_table([_frame(*image, fp_px, region_px) for image in images])


def _object(recording: int, image: int, category: str, px: int, region_px: int) -> dict[str, object]:
    what = {"track_id": category, "category": category, "region_px": region_px, "tp": px, "fn": region_px - px}
    return object_row(0) | _key(recording, image) | what


def _frame(recording: int, image: int, fp_px: int, region_px: int) -> dict[str, object]:
    return frame_row(0) | _key(recording, image) | {"fp_px": fp_px, "reference_px": region_px}


def _key(recording: int, image: int) -> dict[str, object]:
    return {"recording": f"drive-{recording}", "timestamp_ns": image * 100_000_000}

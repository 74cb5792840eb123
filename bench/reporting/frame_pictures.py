"""The pictures of one frame: panels, areas, overlay, and the lidar cluster of each object."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa

from bench.evaluation import Rows
from bench.evaluation.row_source import Columns, as_source
from bench.harness import FramePipeline, ProcessedFrame
from bench.recordings.atomic import write_bytes
from bench.reference import Category, ReferenceObject, Status
from bench.reporting.canvas import figure_bytes
from bench.reporting.cluster_view import ClusterView, draw_cluster
from bench.reporting.count_view import draw_counts
from bench.reporting.overlay import overlay_frame
from bench.reporting.panels import PanelColumn, draw_panels

FrameKey = tuple[str, str, int]
_ORDER = {category: number for number, category in enumerate(Category)}


def write_frame_pictures(processed: ProcessedFrame, pipeline: FramePipeline, folder: Path) -> tuple[Path, ...]:
    """Write `panels.png`, `areas.png`, `overlay.png` and `cluster-<track>.png` of the evaluated objects.

    Args:
        processed: the frame.
        pipeline: that processed it.
        folder: is made.

    Returns:
        The files.
    """
    height, width = processed.reference.valid.shape
    detected = processed.segmentation.mask_at(width, height) & processed.reference.valid
    column = PanelColumn(image=processed.pixels, segmentation=processed.segmentation, reference=processed.reference)
    overlay = overlay_frame(processed.pixels, reference=processed.reference, detected=detected)
    pictures = {
        "panels": figure_bytes(draw_panels(column), "png"),
        "areas": figure_bytes(draw_counts(processed.pixels, reference=processed.reference, detected=detected), "png"),
        "overlay": cv2.imencode(".png", overlay)[1].tobytes(),
    }
    for found in processed.reference.objects:
        if found.status is Status.EVALUATED and processed.image.moving_path is None:
            view = _cluster_view(found, processed, pipeline)
            pictures[f"cluster-{_file_name(found.track_id)}"] = figure_bytes(draw_cluster(view), "png")
    for name, content in pictures.items():
        write_bytes(folder / f"{name}.png", content)
    return tuple(folder / f"{name}.png" for name in pictures)


def telling_frames(objects: Rows) -> dict[Category, FrameKey]:
    """For every category the frame in which an object of it fills most pixels: recording, camera, timestamp_ns.

    Args:
        objects: of `OBJECTS_SCHEMA`, in memory or stored.
    """
    largest: dict[Category, tuple[int, str, int, str]] = {}
    for batch in as_source(objects).batches(("recording", "camera", "timestamp_ns", "status", "category", "region_px")):
        rows = Columns(pa.table(batch))
        evaluated = rows.is_word("status", Status.EVALUATED.value)
        for category in Category:
            of_kind = rows.take(evaluated & rows.is_word("category", category.value))
            if len(of_kind):
                (recording, names), (camera, cameras) = of_kind.words("recording"), of_kind.words("camera")
                region, times_ns = of_kind.integers("region_px"), of_kind.integers("timestamp_ns")
                row = int(np.lexsort([times_ns, recording, -region])[0])
                found = -int(region[row]), names[recording[row]], int(times_ns[row]), cameras[camera[row]]
                largest[category] = min(largest.get(category, found), found)
    return {
        category: (recording, camera, timestamp_ns)
        for category, (_, recording, timestamp_ns, camera) in sorted(largest.items(), key=lambda i: _ORDER[i[0]])
    }


def _file_name(track_id: str) -> str:
    """The track id as part of a file name; ids come from data files and may hold anything."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", track_id)[:80]


def _cluster_view(found: ReferenceObject, processed: ProcessedFrame, pipeline: FramePipeline) -> ClusterView:
    assert found.polygon is not None, "an evaluated object has a polygon"
    return ClusterView(
        geometry=pipeline.references.geometry(found.track_id, processed.image),
        image=processed.pixels,
        polygon=found.polygon,
        vehicle_outline_m=pipeline.recording.vehicle_outline_m,
        title=f"{found.object_class} {found.track_id}, {found.category}, {found.range_m:.1f} m, {found.points} points",
    )

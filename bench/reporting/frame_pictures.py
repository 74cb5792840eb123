"""The pictures of one frame: panels, areas, overlay, and the lidar cluster of each object."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import pyarrow as pa
import pyarrow.compute as pc

from bench.harness import FramePipeline, ProcessedFrame
from bench.recordings.atomic import write_bytes
from bench.reference import Category, ReferenceObject, Status
from bench.reporting.canvas import figure_bytes
from bench.reporting.cluster_view import ClusterView, draw_cluster
from bench.reporting.count_view import draw_counts
from bench.reporting.overlay import overlay_frame
from bench.reporting.panels import PanelColumn, draw_panels

FrameKey = tuple[str, str, int]


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


def telling_frames(objects: pa.Table) -> dict[Category, FrameKey]:
    """For every category the frame in which an object of it fills most pixels: recording, camera, timestamp_ns.

    Args:
        objects: of `OBJECTS_SCHEMA`.
    """
    found: dict[Category, FrameKey] = {}
    for category in Category:
        rows = objects.filter((pc.field("status") == "evaluated") & (pc.field("category") == category.value))
        if rows.num_rows:
            order = [("region_px", "descending"), ("recording", "ascending"), ("timestamp_ns", "ascending")]
            first = rows.sort_by(order).slice(0, 1).to_pylist()[0]
            found[category] = first["recording"], first["camera"], first["timestamp_ns"]
    return found


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

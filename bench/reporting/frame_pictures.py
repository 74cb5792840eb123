"""The pictures of one frame: panels, areas, overlay, and each object's lidar cluster from above and in the image."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from bench.atomic import write_bytes
from bench.errors import BenchError
from bench.evaluation import Rows
from bench.evaluation.rows import EVALUATED, IMAGE, pick, read_parts
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.frames import UnscorableFrame
from bench.harness.replay import StoredFrames
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.recordings import DatasetCard, ImageRef, read_image
from bench.records.reference import ObjectGeometry, Outline, ReferenceFrame
from bench.reference import Category
from bench.reporting import canvas, formats
from bench.reporting.formats import file_name, frame_name
from bench.reporting.overlay import draw_outline, outlined
from bench.reporting.panels import draw_panels
from bench.reporting.side_by_side import ImageKey, Side, draw_side_by_side
from bench.reporting.video import draw_frame, draw_reference

_WIDTH_IN, _LEFT_IN, _BOTTOM_IN, _TOP_IN, _GAP_IN, _RIGHT_IN = 7.0, 0.42, 0.36, 0.22, 0.12, 0.04
_SURROUNDINGS_M = 3.0
_CLOUD = "#777777"
_DOT_SHARE, _DOT_SIZES = 0.3, (0.05, 3.0)
_INSET_SHARE = 0.42
_INSET_BELOW = 0.35  # an object that fills less than this share of the image is shown larger in a corner


@canvas.styled
def draw_cluster(
    geometry: ObjectGeometry,
    *,
    image: NDArray[np.uint8],
    polygon: Outline,
    vehicle_outline_m: NDArray[np.float64],
    title: str = "fisheye image",
    image_name: str = "",
) -> Figure:
    """Draw the point cloud from above on the left and the image on the right.

    Args:
        geometry: the object's points and annotated shape at exposure.
        image: (H, W) grey or (H, W, 3) BGR uint8.
        polygon: the reference polygon in pixels.
        vehicle_outline_m: (L, 2) float64, the ego vehicle from above, vehicle frame, m.
        title: names the object.
        image_name: says which image it is.

    Source:
        Mariotti and Eising 2020, the figure on ground truth generation.
    """
    height, width = image.shape[:2]
    # The square plan and the image share one height and fill the width.
    side_in = (_WIDTH_IN - _LEFT_IN - _GAP_IN - _RIGHT_IN) / (1 + width / height)
    full_in = side_in + _BOTTOM_IN + _TOP_IN
    figure = canvas.new_figure(_WIDTH_IN, full_in)
    plan = canvas.axes_at(figure, _LEFT_IN, _BOTTOM_IN, side_in, side_in)
    picture = canvas.axes_at(figure, _LEFT_IN + side_in + _GAP_IN, _BOTTOM_IN, side_in * width / height, side_in)
    _draw_plan(plan, geometry, vehicle_outline_m)
    canvas.show_image(picture, image)
    _draw_cluster_pixels(picture, geometry, polygon)
    u_min, v_min, u_max, v_max = polygon.bounds
    if max((u_max - u_min) / width, (v_max - v_min) / height) < _INSET_BELOW:
        _draw_cluster_pixels(_inset(picture, polygon, image), geometry, polygon)
    plan.set_title("(a) point cloud from above", pad=3)
    picture.set_title(f"(b) {title}", pad=3)
    figure.text(1 - _RIGHT_IN / _WIDTH_IN, 0.03, image_name, ha="right", va="bottom")
    return figure


def _draw_plan(axes: Axes, found: ObjectGeometry, vehicle_outline_m: NDArray[np.float64]) -> None:
    around, cluster, outline_m = found.surroundings_vehicle, found.cluster_vehicle, found.outline_m
    axes.scatter(around[:, 1], around[:, 0], s=0.4, c=_CLOUD, linewidths=0, rasterized=True)
    axes.scatter(cluster[:, 1], cluster[:, 0], s=2.5, c=canvas.SKY_BLUE, linewidths=0, zorder=4.5, rasterized=True)
    if len(outline_m):
        axes.add_patch(PolygonPatch(outline_m[:, ::-1], fill=False, edgecolor=canvas.ORANGE, linewidth=1.3, zorder=4))
    canvas.draw_vehicle(axes, vehicle_outline_m)
    corners = np.concatenate([part for part in (cluster[:, :2], outline_m, vehicle_outline_m) if len(part)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half_m = (high - low).max() / 2 + _SURROUNDINGS_M
    (x, y) = (low + high) / 2
    canvas.plan_axes(axes, x_m=(x - half_m, x + half_m), y_m=(y - half_m, y + half_m))


def _draw_cluster_pixels(axes: Axes, found: ObjectGeometry, polygon: Outline) -> None:
    seen = found.pixels[np.isfinite(found.pixels).all(axis=1)]
    size = _dot_size(axes, polygon, len(seen))
    axes.scatter(seen[:, 0], seen[:, 1], s=size, c=canvas.SKY_BLUE, linewidths=0, zorder=3, rasterized=True)
    draw_outline(axes, polygon, colour=canvas.VERMILION, width=1.1).set_zorder(3.5)


def _dot_size(axes: Axes, polygon: Outline, dots: int) -> float:
    """Area of a dot, points squared, so that the dots leave most of the object to be seen."""
    origin, corner = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    points_per_px = abs(corner[0] - origin[0]) * 72.0 / canvas.DPI
    return float(np.clip(_DOT_SHARE * polygon.area * points_per_px**2 / max(dots, 1), *_DOT_SIZES))


def _inset(axes: Axes, polygon: Outline, image: NDArray[np.uint8]) -> Axes:
    """The object enlarged, in the upper or lower corner that is farther from it."""
    height, width = image.shape[:2]
    u_min, v_min, u_max, v_max = polygon.bounds
    u, v = (u_min + u_max) / 2, (v_min + v_max) / 2
    half_v = 0.65 * max(v_max - v_min, (u_max - u_min) * height / width, 8.0)
    half_u = half_v * width / height
    left = 0.01 if u > width / 2 else 0.99 - _INSET_SHARE
    bottom = 0.01 if v < height / 2 else 0.99 - _INSET_SHARE
    inset = axes.inset_axes((left, bottom, _INSET_SHARE, _INSET_SHARE))
    canvas.show_image(inset, image)
    inset.set(xlim=(u - half_u, u + half_u), ylim=(v + half_v, v - half_v))
    corner = (u - half_u, v - half_v)
    axes.add_patch(Rectangle(corner, 2 * half_u, 2 * half_v, edgecolor="white", linewidth=0.8, fill=False, zorder=2.5))
    for spine in inset.spines.values():
        spine.set(edgecolor="white", linewidth=0.8)
    return inset


def write_frame_pictures(
    processed: ProcessedFrame, pipeline: FramePipeline, folder: Path, *, made_by: str
) -> tuple[Path, ...]:
    """Write `panels.png`, `areas.png`, `overlay.png` and `cluster-<track>.png` of the evaluated objects.

    Args:
        processed: the frame.
        pipeline: that processed it.
        folder: is made.
        made_by: method and protocol, as `made_by` says them.

    Returns:
        The files.
    """
    reference = processed.reference
    panels = draw_panels(processed.pixels, segmentation=processed.segmentation, reference=reference, made_by=made_by)
    areas = draw_side_by_side([Side(processed=processed, label=made_by)])
    overlay = draw_frame(processed, f"{frame_name(reference)}; {made_by}")
    pictures = {
        "panels": canvas.figure_bytes(panels, "png"),
        "areas": canvas.figure_bytes(areas, "png"),
        "overlay": cv2.imencode(".png", overlay)[1].tobytes(),
    }
    return _written(pictures | _cluster_pictures(reference, processed.image, processed.pixels, pipeline), folder)


def write_reference_pictures(pipeline: FramePipeline, index: int, folder: Path, *, made_by: str) -> tuple[Path, ...]:
    """Write `reference.png` and `cluster-<track>.png` of the evaluated objects of an image, without any method.

    Args:
        pipeline: of the camera.
        index: of the image.
        folder: is made.
        made_by: the protocol.

    Returns:
        The files.

    Raises:
        DataError: the image, its sweep or ego-motion cannot be used.
    """
    image, reference = pipeline.images[index], pipeline.reference(index)
    pixels = read_image(image, pipeline.camera, colour=True)
    drawn = draw_reference(pixels, reference, f"{frame_name(reference)}; {made_by}")
    pictures = {"reference": cv2.imencode(".png", drawn)[1].tobytes()}
    return _written(pictures | _cluster_pictures(reference, image, pixels, pipeline), folder)


def _cluster_pictures(
    reference: ReferenceFrame, image: ImageRef, pixels: NDArray[np.uint8], pipeline: FramePipeline
) -> dict[str, bytes]:
    pictures = {}
    for found, polygon in outlined(reference.objects):
        if image.moving_path is None:
            cluster = draw_cluster(
                pipeline.references.geometry(found.track_id, image),
                image=pixels,
                polygon=polygon,
                vehicle_outline_m=pipeline.recording.vehicle_outline_m,
                title=f"{found.object_class} {found.track_id}, {found.category}, {found.range_m:.1f} m, "
                f"{found.points} points",
                image_name=frame_name(reference),
            )
            pictures[f"cluster-{file_name(found.track_id)}"] = canvas.figure_bytes(cluster, "png")
    return pictures


def _written(pictures: Mapping[str, bytes], folder: Path) -> tuple[Path, ...]:
    for name, content in pictures.items():
        write_bytes(folder / f"{name}.png", content)
    return tuple(folder / f"{name}.png" for name in pictures)


def example_frames(objects: Rows) -> dict[Category, ImageKey]:
    """For every category the frame in which an object of it fills most pixels.

    Args:
        objects: of `OBJECTS_SCHEMA`, in memory or stored.
    """

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        evaluated = rows[rows["status"] == EVALUATED].sort_values(IMAGE)
        return evaluated.sort_values("region_px", ascending=False, kind="stable").drop_duplicates("category")

    found = pick(read_parts(objects, [*IMAGE, "status", "category", "region_px"]), largest).set_index("category")[IMAGE]
    keys = {str(kind): (str(r.recording), str(r.camera), int(r.timestamp_ns)) for kind, r in found.iterrows()}
    return {kind: keys[kind] for kind in Category if kind in keys}


def write_example_pictures(
    run: StoredRun, *, card: DatasetCard | None, progress: Progress
) -> tuple[list[Path], list[str]]:
    """Write, as it was scored, the frame of every category in which an object fills most pixels, into `pictures`.

    Returns:
        The files, and a line for every reason why a picture could not be made.
    """
    files, remarks = list[Path](), list[str]()
    try:
        stored = StoredFrames(run, card=card)
    except BenchError as error:
        return [], [str(error)]
    frames = example_frames(run.objects)
    made = formats.made_by(run.manifest.method.name, run.protocol.name)
    for number, (category, key) in enumerate(frames.items(), start=1):
        try:
            folder = run.folder / "pictures" / category.value
            pipeline = stored.pipeline(*key[:2])
            files += write_frame_pictures(stored.process(*key), pipeline, folder, made_by=made)
        except (BenchError, UnscorableFrame) as error:
            remarks.append(str(error))
        progress(number, len(frames))
    return files, remarks

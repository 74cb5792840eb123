"""The pictures of single frames: what a method saw, each object's lidar cluster, and the frames that show a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon as PolygonPatch
from numpy.typing import NDArray

from bench.errors import BenchError
from bench.evaluation import Rows
from bench.evaluation.rows import EVALUATED, IMAGE, pick, read_parts
from bench.harness import FramePipeline, ProcessedFrame
from bench.harness.datasets import StoredFrames
from bench.harness.frames import UnscorableFrame
from bench.harness.stages import Progress
from bench.harness.stored import StoredRun
from bench.recordings import DatasetCard, ImageRef, read_image
from bench.records.reference import Category, ObjectGeometry, Outline, ReferenceFrame, Status
from bench.records.segmentation import Segmentation
from bench.reporting import figures
from bench.reporting.formats import file_name, frame_name, made_by
from bench.reporting.frame import (
    LEGEND_IN,
    add_legend,
    draw_frames,
    draw_layers,
    draw_outline,
    faded,
    fit_text,
    reference_layers,
    scored_layers,
    show_image,
    zoom_on,
)

LIKELIHOOD_SATURATION = 0.02  # the paper's figure 6
SCORE_SATURATION = 1.0
DEVIATION_SATURATION = 0.05  # a deviation of weight 1 that makes a likelihood of 0.02 by itself is 0.048
FLOW_SATURATION_PX = 16.0
ARROWS_ACROSS = 24
COLOUR_MAP = "inferno"
FLOW_COLOUR_MAP = "viridis"
DEVIATIONS = {
    "epipolar": "epipolar",
    "positive_depth": "positive depth",
    "positive_height": "positive height",
    "anti_parallel": "anti-parallel",
    "three_view": "three views",
}
_NUMERALS = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
_PANEL_IN, _LEFT_IN, _RIGHT_IN, _TOP_IN, _GAP_IN = 2.6, 0.26, 0.62, 0.22, 0.06
_LINE_IN = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Panel:
    label: str
    draw: Callable[[Axes], None]
    saturation: float | None = None
    colour_map: str = COLOUR_MAP
    unit: str = ""


@figures.styled
def draw_panels(processed: ProcessedFrame, *, made_by: str = "") -> Figure:
    """Draw a frame as a column of panels, one for everything that the method shows of its work, its areas last.

    Args:
        processed: the frame; panels appear for the `parts` that the method's answer has.
        made_by: method and protocol, below the name of the image; empty where they are said beside the picture.

    Source:
        Mariotti and Eising 2020, figure 6.
    """
    panels = list(_panels(processed))
    height, width = processed.reference.valid.shape
    height_in, top_in = _PANEL_IN * height / width, _TOP_IN + bool(made_by) * _LINE_IN
    full_in = top_in + len(panels) * (height_in + _GAP_IN) + LEGEND_IN
    figure = figures.new_figure(_LEFT_IN + _PANEL_IN + _RIGHT_IN, full_in)
    for number, (panel, numeral) in enumerate(zip(panels, _NUMERALS, strict=False)):
        bottom_in = full_in - top_in - height_in - number * (height_in + _GAP_IN)
        axes = figures.axes_at(figure, _LEFT_IN, bottom_in, _PANEL_IN, height_in)
        panel.draw(axes)
        axes.set_ylabel(f"({numeral}) {panel.label}", fontsize=7, labelpad=3)
        if panel.saturation is not None:
            _draw_colour_bar(axes, panel, panel.saturation)
    heading = f"{frame_name(processed.reference)}\n{made_by}".rstrip()
    fit_text(figure.axes[0].set_title(heading, pad=3, fontsize=6), _PANEL_IN + 2 * _LEFT_IN)
    add_legend(figure, results=True, sweep=False)
    return figure


def _draw_colour_bar(axes: Axes, panel: _Panel, saturation: float) -> None:
    scale = ScalarMappable(norm=Normalize(vmin=0.0, vmax=saturation), cmap=panel.colour_map)
    beside = axes.inset_axes((1.023, 0.05, 0.035, 0.9))
    bar = axes.figure.colorbar(scale, cax=beside, extend="max", ticks=[0.0, saturation / 2, saturation])
    bar.ax.tick_params(labelsize=6, length=2, pad=1.5)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.set_label(panel.unit, fontsize=6)
    bar.ax.yaxis.set_label_coords(4.6, 0.5)  # one line for all bars, whatever their numbers' width


def _panels(processed: ProcessedFrame) -> Iterator[_Panel]:
    segmentation, reference = processed.segmentation, processed.reference
    parts = segmentation.parts or {}
    cells = partial(_draw_cells, segmentation=segmentation, valid=reference.valid)
    if "flow_u" in parts and "flow_v" in parts:
        flow = partial(_draw_flow, image=processed.pixels, segmentation=segmentation, valid=reference.valid)
        yield _Panel(label="flow", draw=flow, saturation=FLOW_SATURATION_PX, colour_map=FLOW_COLOUR_MAP,
                     unit="px per frame")  # fmt: skip
    for name, label in DEVIATIONS.items():
        if name in parts:
            draw = partial(cells, values=parts[name], saturation=DEVIATION_SATURATION)
            yield _Panel(label=label, draw=draw, saturation=DEVIATION_SATURATION, unit="deviation")
    if segmentation.likelihood is not None:
        is_score = segmentation.likelihood_is_score
        label, saturation = ("score", SCORE_SATURATION) if is_score else ("likelihood", LIKELIHOOD_SATURATION)
        draw = partial(cells, values=segmentation.likelihood, saturation=saturation)
        yield _Panel(label=label, draw=draw, saturation=saturation, unit=label)
    yield _Panel(label="segmentation", draw=partial(draw_layers, layers=scored_layers(processed)))


def _draw_flow(axes: Axes, *, image: NDArray[np.uint8], segmentation: Segmentation, valid: NDArray[np.bool_]) -> None:
    """Draw arrows from where the pixel was in the previous image to where it is now, on an even grid."""
    parts, cell = segmentation.parts, segmentation.cell_size_px
    assert parts is not None
    flow_u, flow_v = parts["flow_u"], parts["flow_v"]
    show_image(axes, faded(image, 0.45))
    step = max(1, flow_u.shape[1] // ARROWS_ACROSS)
    picked = np.s_[step // 2 :: step, step // 2 :: step]
    v, u = (np.mgrid[: flow_u.shape[0], : flow_u.shape[1]] * cell + (cell - 1) / 2)[:, *picked]
    inside = (u < image.shape[1]) & (v < image.shape[0])
    seen = inside & valid[np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)]
    back_u, back_v = flow_u[picked][seen], flow_v[picked][seen]
    axes.quiver(
        u[seen], v[seen], -back_u, -back_v, np.hypot(back_u, back_v),
        angles="xy", scale_units="xy", scale=1.0, pivot="tip", width=0.0045, headwidth=4.0, headlength=4.5,
        minlength=0.6, cmap=FLOW_COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=FLOW_SATURATION_PX, clip=True),
    )  # fmt: skip


def _draw_cells(
    axes: Axes,
    *,
    segmentation: Segmentation,
    valid: NDArray[np.bool_],
    values: NDArray[np.float32],
    saturation: float,
) -> None:
    """Colour the cells; light grey where the lens or the method sees nothing."""
    (height, width), (rows, columns) = valid.shape, values.shape
    cell = segmentation.cell_size_px
    middle = cell // 2
    seen = valid[middle::cell, middle::cell]
    hidden = ~np.pad(seen, ((0, rows - seen.shape[0]), (0, columns - seen.shape[1])), mode="edge")
    if segmentation.undefined is not None:
        hidden |= segmentation.undefined
    shown = np.ma.masked_array(values, mask=hidden | ~np.isfinite(values))
    axes.set_facecolor(figures.LIGHT_GREY)
    axes.imshow(
        shown, cmap=COLOUR_MAP, norm=Normalize(vmin=0.0, vmax=saturation, clip=True), interpolation="nearest",
        extent=(-0.5, columns * cell - 0.5, rows * cell - 0.5, -0.5),
    )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])


_CLUSTER_IN, _PLAN_LEFT_IN, _PLAN_BOTTOM_IN, _TITLE_IN, _BETWEEN_IN, _EDGE_IN = 7.0, 0.42, 0.36, 0.22, 0.12, 0.04
_SURROUNDINGS_M = 3.0
_CLOUD = "#777777"
_DOT_SIZE = 0.8  # points squared


@figures.styled
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
    side_in = (_CLUSTER_IN - _PLAN_LEFT_IN - _BETWEEN_IN - _EDGE_IN) / (1 + width / height)
    full_in = side_in + _PLAN_BOTTOM_IN + _TITLE_IN
    figure = figures.new_figure(_CLUSTER_IN, full_in)
    plan = figures.axes_at(figure, _PLAN_LEFT_IN, _PLAN_BOTTOM_IN, side_in, side_in)
    picture = figures.axes_at(
        figure, _PLAN_LEFT_IN + side_in + _BETWEEN_IN, _PLAN_BOTTOM_IN, side_in * width / height, side_in
    )
    _draw_plan(plan, geometry, vehicle_outline_m)
    show_image(picture, image)
    zoom_on(picture, polygon, size=(width, height), aspect=width / height)
    _draw_cluster_pixels(picture, geometry, polygon)
    plan.set_title("(a) point cloud from above", pad=3)
    picture.set_title(f"(b) {title}", pad=3)
    figure.text(1 - _EDGE_IN / _CLUSTER_IN, 0.03, image_name, ha="right", va="bottom")
    return figure


def _draw_plan(axes: Axes, geometry: ObjectGeometry, vehicle_outline_m: NDArray[np.float64]) -> None:
    around, cluster, outline_m = geometry.surroundings_vehicle, geometry.cluster_vehicle, geometry.outline_m
    axes.scatter(around[:, 1], around[:, 0], s=0.4, c=_CLOUD, linewidths=0, rasterized=True)
    axes.scatter(cluster[:, 1], cluster[:, 0], s=2.5, c=figures.SKY_BLUE, linewidths=0, zorder=4.5, rasterized=True)
    if len(outline_m):
        axes.add_patch(PolygonPatch(outline_m[:, ::-1], fill=False, edgecolor=figures.ORANGE, linewidth=1.3, zorder=4))
    figures.draw_vehicle(axes, vehicle_outline_m)
    corners = np.concatenate([part for part in (cluster[:, :2], outline_m, vehicle_outline_m) if len(part)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half_m = (high - low).max() / 2 + _SURROUNDINGS_M
    (x, y) = (low + high) / 2
    figures.plan_axes(axes, x_m=(x - half_m, x + half_m), y_m=(y - half_m, y + half_m))


def _draw_cluster_pixels(axes: Axes, geometry: ObjectGeometry, polygon: Outline) -> None:
    seen = geometry.pixels[np.isfinite(geometry.pixels).all(axis=1)]
    axes.scatter(seen[:, 0], seen[:, 1], s=_DOT_SIZE, c=figures.SKY_BLUE, linewidths=0, zorder=3, rasterized=True)
    draw_outline(axes, polygon, colour=figures.VERMILION, width=1.1).set_zorder(3.5)


def write_frame_pictures(
    processed: ProcessedFrame, pipeline: FramePipeline, folder: Path, *, made_by: str
) -> tuple[Path, ...]:
    """Write `panels.png`, `areas.png` and `cluster-<track>.png` of the evaluated objects.

    Args:
        processed: the frame.
        pipeline: that processed it.
        folder: is made.
        made_by: method and protocol, as `made_by` says them.

    Returns:
        The files.
    """
    areas = draw_frames([scored_layers(processed, label=made_by)], name=frame_name(processed.reference))
    drawn = {"panels": draw_panels(processed, made_by=made_by), "areas": areas}
    drawn |= _clusters(processed.reference, processed.image, processed.pixels, pipeline)
    return _write(drawn, folder)


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
    drawn = draw_frames([reference_layers(pixels, reference, label=made_by)], name=frame_name(reference))
    return _write({"reference": drawn} | _clusters(reference, image, pixels, pipeline), folder)


def _clusters(
    reference: ReferenceFrame, image: ImageRef, pixels: NDArray[np.uint8], pipeline: FramePipeline
) -> dict[str, Figure]:
    """The evaluated objects of which lidar points are known, by name of file."""
    shown = [target for target in reference.objects if target.status is Status.EVALUATED]
    return {
        f"cluster-{file_name(target.track_id)}": draw_cluster(
            pipeline.references.geometry(target.track_id, image),
            image=pixels,
            polygon=target.polygon,
            vehicle_outline_m=pipeline.recording.vehicle_outline_m,
            title=f"{target.object_class} {target.track_id}, {target.category}, {target.range_m:.1f} m, "
            f"{target.points} points",
            image_name=frame_name(reference),
        )
        for target in shown
        if target.polygon is not None and image.moving_path is None
    }


def _write(drawn: Mapping[str, Figure], folder: Path) -> tuple[Path, ...]:
    return tuple(
        file for name, figure in drawn.items() for file in figures.write_picture(folder / name, figure, formats=["png"])
    )


ImageKey = tuple[str, str, int]  # recording, camera, timestamp_ns


def example_frames(objects: Rows) -> dict[Category, ImageKey]:
    """For every category the frame in which an object of it fills most pixels.

    Args:
        objects: of `OBJECTS_SCHEMA`, in memory or stored.
    """

    def largest(rows: pd.DataFrame) -> pd.DataFrame:
        evaluated = rows[rows["status"] == EVALUATED].sort_values(IMAGE)
        return evaluated.sort_values("region_px", ascending=False, kind="stable").drop_duplicates("category")

    rows = pick(read_parts(objects, [*IMAGE, "status", "category", "region_px"]), largest).set_index("category")[IMAGE]
    keys = {str(kind): (str(r.recording), str(r.camera), int(r.timestamp_ns)) for kind, r in rows.iterrows()}
    return {kind: keys[kind] for kind in Category if kind in keys}


Drawn = TypeVar("Drawn")


def draw_images(
    runs: Sequence[StoredRun],
    images: Iterable[ImageKey],
    draw: Callable[[ImageKey, Sequence[ProcessedFrame], FramePipeline], Drawn],
    *,
    card: DatasetCard | None = None,
    progress: Progress | None = None,
) -> tuple[dict[ImageKey, Drawn], list[str]]:
    """Draw images as runs were scored on them, from the data set that they name.

    Args:
        runs: of the same data set.
        images: in any order, also several times.
        draw: called with an image, the frame of every run, and the pipeline of the first.
        card: of the data set; None for that which each run names.
        progress: called with the images done and their number.

    Returns:
        drawn: of the images that could be processed.
        problems: why others could not, one line each: a run holds no masks or did not score them, the data set is not
            there, or code or data have changed since.
    """
    keys, drawn, problems = sorted(set(images)), dict[ImageKey, Drawn](), dict[str, None]()  # a recording at a time
    try:
        stored = [StoredFrames(run, card=card) for run in runs if keys]
    except BenchError as error:
        return {}, [str(error)]
    for number, key in enumerate(keys, start=1):
        try:
            frames = [frames_of_run.process(*key) for frames_of_run in stored]
            drawn[key] = draw(key, frames, stored[0].pipeline(*key[:2]))
        except (BenchError, UnscorableFrame) as error:
            problems[str(error)] = None
        if progress is not None:
            progress(number, len(keys))
    return drawn, list(problems)


def write_example_pictures(
    run: StoredRun, *, card: DatasetCard | None, progress: Progress
) -> tuple[list[Path], list[str]]:
    """Write, as it was scored, the frame of every category in which an object fills most pixels, into `pictures`.

    Returns:
        The files, and a line for every reason why a picture could not be made.
    """
    made = made_by(run.manifest.method.name, run.protocol.name)
    categories: dict[ImageKey, list[str]] = {}
    for category, key in example_frames(run.objects).items():
        categories.setdefault(key, []).append(category.value)

    def write(key: ImageKey, frames: Sequence[ProcessedFrame], pipeline: FramePipeline) -> list[Path]:
        folders = [run.folder / "pictures" / name for name in categories[key]]
        return [f for folder in folders for f in write_frame_pictures(frames[0], pipeline, folder, made_by=made)]

    written, problems = draw_images([run], categories, write, card=card, progress=progress)
    return [file for files in written.values() for file in files], problems

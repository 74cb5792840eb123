"""One drawing of a frame for pages, pictures, videos and logs: its areas, outlines, objects and lidar points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from shapely import box, get_parts, get_rings

from bench.errors import ShapeError
from bench.evaluation.counts import ObjectCounts, count_frame
from bench.harness import ProcessedFrame
from bench.plain_text import plain
from bench.recordings import ImageRef, MountedCamera, Recording
from bench.records.reference import Category, IgnoreReason, Outline, ReferenceFrame, ReferenceObject, Status
from bench.reference.exposure import Readout
from bench.reference.sweeps import SweepCache
from bench.reporting import figures

# An image on axes.

_LABEL_SIZES = 4.5, 6.0  # points, in a picture of 1.8 inches and less, of 2.4 inches and more
_LABEL_GAP_PX = 3.0


def faded(image: NDArray[np.uint8], strength: float) -> NDArray[np.uint8]:
    """An image, (H, W) grey or (H, W, 3) BGR, in grey mixed with white; `strength` 1 keeps its contrast, 0 is white."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(255.0 - strength * (255.0 - grey), dtype=np.uint8)


def overlay_areas(
    image: NDArray[np.uint8], areas: Mapping[str, NDArray[np.bool_]], *, strength: float = 0.5
) -> NDArray[np.uint8]:
    """Tint areas of an image.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        areas: (H, W) bool, by colour "#rrggbb".
        strength: 0 leaves the image, 1 paints it over.

    Returns:
        (H, W, 3) BGR uint8, a new image.

    Raises:
        ShapeError: an area and the image differ in size.
    """
    tinted = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    for colour, area in areas.items():
        if area.shape != image.shape[:2]:
            raise ShapeError(f"mask: expected {image.shape[:2]}, got {area.shape}")
        painted = np.round(255 * np.array(to_rgb(colour)[::-1]))
        tinted[area] = ((1 - strength) * tinted[area] + strength * painted).astype(np.uint8)
    return np.asarray(tinted, dtype=np.uint8)


def show_image(axes: Axes, image: NDArray[np.uint8]) -> None:
    """Draw an image, (H, W) grey or (H, W, 3) BGR, so that data coordinates are its pixels (u, v); no ticks."""
    height, width = image.shape[:2]
    shown = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
    axes.imshow(shown, interpolation="antialiased")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])


def zoom_on(axes: Axes, polygon: Outline, *, size: tuple[int, int], aspect: float) -> None:
    """Show of an image a polygon with as much around it as it is large, inside the image.

    Args:
        axes: of the image.
        polygon: in pixels; what is outside of the image is left out.
        size: width and height of the image.
        aspect: width over height of what is shown.
    """
    width, height = size
    u_min, v_min, u_max, v_max = polygon.intersection(box(0, 0, width - 1, height - 1)).bounds
    half_v = min(max(v_max - v_min, (u_max - u_min) / aspect, 24.0), height / 2, width / 2 / aspect)
    u = float(np.clip((u_min + u_max) / 2, half_v * aspect - 0.5, width - 0.5 - half_v * aspect))
    v = float(np.clip((v_min + v_max) / 2, half_v - 0.5, height - 0.5 - half_v))
    axes.set(xlim=(u - half_v * aspect, u + half_v * aspect), ylim=(v + half_v, v - half_v))


def draw_outline(axes: Axes, polygon: Outline, *, colour: str, style: str = "-", width: float = 1.0) -> PathPatch:
    """Outline a polygon with its holes; a thin dark rim keeps it visible on any background."""
    rings = [Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in get_rings(get_parts(polygon))]
    path = Path.make_compound_path(*rings)
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=width, linestyle=style)
    patch.set_path_effects([withStroke(linewidth=width + 0.8, foreground="black")])
    axes.add_patch(patch)
    return patch


def fit_text(text: Text, width_in: float) -> None:
    """Make a text as small as it must be to be no wider."""
    while (
        share := width_in * figures.DPI / max(text.get_window_extent().width, 1.0)
    ) < 1.0:  # hinted letters shrink in steps
        text.set_fontsize(float(text.get_fontsize()) * min(share, 0.97))


def place_labels(axes: Axes, polygons: Sequence[Outline], texts: Sequence[str]) -> None:
    """Write each text beside its polygon, inside the axes and off the labels already there.

    Above the polygon where there is room, else below it, else further up and down; amid it last.
    """
    taken: list[Bbox] = []
    (left, right), (top, bottom) = sorted(axes.get_xlim()), sorted(axes.get_ylim())  # v grows downwards
    figure_width_in = axes.figure.get_figure(root=True).get_figwidth()
    size = float(np.clip(2.5 * figure_width_in * axes.get_position().width, *_LABEL_SIZES))
    for polygon, text in zip(polygons, texts, strict=True):
        label = axes.text(0, 0, plain(text), fontsize=size, color="white", ha="left", va="bottom", zorder=10)
        label.set_path_effects([effect(linewidth=1.4, foreground="black") for effect in (Stroke, withStroke)])
        extent = label.get_window_extent().transformed(axes.transData.inverted())
        width, height = abs(extent.width), abs(extent.height)
        u_min, v_min, u_max, v_max = polygon.bounds
        u = float(np.clip((u_min + u_max - width) / 2, left + _LABEL_GAP_PX, right - width - _LABEL_GAP_PX))
        above, below = v_min - _LABEL_GAP_PX, v_max + _LABEL_GAP_PX + height
        levels = [v for k in range(6) for v in (above - k * height, below + k * height)]
        inside = [v for v in levels if top + height <= v <= bottom]
        amid = float(np.clip((v_min + v_max + height) / 2, top + height, bottom))
        places = [Bbox.from_extents(u, v - height, u + width, v) for v in (*inside, amid)]
        free = (place for place in places if not any(place.overlaps(other) for other in taken))
        taken.append(next(free, places[-1]))
        label.set_position((u, taken[-1].y1))


# A frame.


class PixelClass(IntEnum):
    """Classes of pixels; every pixel is of exactly one."""

    OUTSIDE = 0  # not in V
    BACKGROUND = 1  # in V, neither reference nor detection
    TRUE_POSITIVE = 2
    FALSE_NEGATIVE = 3
    FALSE_POSITIVE = 4
    UNKNOWN = 5  # in an unknown band: may be the object's, counts neither way
    IGNORED = 6  # of an object that is not evaluated
    LEFT_OUT = 7  # in an area that is not annotated


AREA_COLOURS = {
    PixelClass.TRUE_POSITIVE: figures.GREEN,
    PixelClass.FALSE_NEGATIVE: figures.SKY_BLUE,
    PixelClass.FALSE_POSITIVE: figures.VERMILION,
    PixelClass.UNKNOWN: figures.YELLOW,
    PixelClass.IGNORED: figures.LIGHT_GREY,
    PixelClass.LEFT_OUT: figures.DARK_GREY,
}
AREA_NAMES = {
    PixelClass.TRUE_POSITIVE: "found",
    PixelClass.FALSE_NEGATIVE: "missed",
    PixelClass.FALSE_POSITIVE: "wrongly marked",
    PixelClass.UNKNOWN: "unknown band",
    PixelClass.IGNORED: "ignored object",
    PixelClass.LEFT_OUT: "not annotated",
}
RESULTS = (PixelClass.TRUE_POSITIVE, PixelClass.FALSE_NEGATIVE, PixelClass.FALSE_POSITIVE)
HATCHES = {PixelClass.IGNORED: "//////", PixelClass.LEFT_OUT: "..."}
HATCH_COLOUR, OUTSIDE_COLOUR = "#202020", "#404040"
_FADE, _OUTSIDE_FADE, _TINT = 0.8, 0.3, 0.6
NEAREST_M, FARTHEST_M = 1.0, 50.0  # of the colours of lidar points


def pixel_classes(reference: ReferenceFrame, *, detected: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Say of every pixel what it counts as.

    Args:
        reference: the frame's reference.
        detected: (H, W) bool; the method's mask at every pixel.

    Returns:
        (H, W) uint8 of `PixelClass`.

    Raises:
        ShapeError: `detected` has another size than the reference.
    """
    if detected.shape != reference.labels.shape:
        raise ShapeError(f"detected: expected {reference.labels.shape}, got {detected.shape}")
    region = reference.labels > 0
    classes = np.full(region.shape, PixelClass.BACKGROUND, dtype=np.uint8)
    classes[detected] = PixelClass.FALSE_POSITIVE
    classes[reference.ignored] = PixelClass.IGNORED
    classes[reference.left_out] = PixelClass.LEFT_OUT
    classes[reference.unknown] = PixelClass.UNKNOWN
    classes[region & detected] = PixelClass.TRUE_POSITIVE
    classes[region & ~detected] = PixelClass.FALSE_NEGATIVE
    classes[~reference.valid] = PixelClass.OUTSIDE
    return classes


def detected_pixels(processed: ProcessedFrame) -> NDArray[np.bool_]:
    """(H, W) bool, where the method marks motion in a processed frame, within V."""
    height, width = processed.reference.valid.shape
    return processed.segmentation.mask_at(width, height) & processed.reference.valid


def false_positive_text(processed: ProcessedFrame) -> str:
    """For example "false positives 12.3 % of the image"."""
    frame, _ = count_frame(processed.reference, detected_pixels(processed), component_size_px=0)
    return f"false positives {100 * frame.fp_px / (frame.width * frame.height):.1f} % of the image"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenSweep:
    """A sweep at an exposure.

    Attributes:
        points_world: (N, 3) float64, m.
        pixels: (K, 2) float64, px, of the points in the image.
        range_m: (K,) float64, m, of these points from the camera.
    """

    points_world: NDArray[np.float64]
    pixels: NDArray[np.float64]
    range_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layers:
    """Layers of a picture of an image.

    Attributes:
        pixels: (H, W) grey or (H, W, 3) BGR uint8; drawn in grey, so that whatever has a colour means something.
        reference: None where it has none.
        detected: (H, W) bool, what a method marks; None for the reference alone.
        sweep: the lidar's points; None for none.
        label: names the method; empty where it is named beside the picture.
        note: a line of values.
    """

    pixels: NDArray[np.uint8]
    reference: ReferenceFrame | None
    detected: NDArray[np.bool_] | None = None
    sweep: SeenSweep | None = None
    label: str = ""
    note: str = ""


def scored_layers(
    processed: ProcessedFrame, *, label: str = "", note: str = "", sweep: SeenSweep | None = None
) -> Layers:
    """Return the layers of a frame as it was scored; without a note, that of the false positives of the image."""
    return Layers(
        pixels=processed.pixels,
        reference=processed.reference,
        detected=detected_pixels(processed),
        sweep=sweep,
        label=label,
        note=note or false_positive_text(processed),
    )


def reference_layers(
    pixels: NDArray[np.uint8], reference: ReferenceFrame, *, label: str, sweep: SeenSweep | None = None
) -> Layers:
    """Return the layers of the reference alone, with a note of how many annotated objects are evaluated."""
    evaluated = sum(target.status is Status.EVALUATED for target in reference.objects)
    note = f"{evaluated} of {len(reference.objects)} annotated objects evaluated"
    return Layers(pixels=pixels, reference=reference, sweep=sweep, label=label, note=note)


def draw_layers(axes: Axes, layers: Layers, *, names: bool = True) -> None:
    """Draw an image with its layers onto axes.

    Args:
        axes: data coordinates become pixels (u, v).
        layers: of the image.
        names: name the annotated objects, evaluated ones with their values and ignored ones with the reason.
    """
    image, reference = faded(layers.pixels, _FADE), layers.reference
    if reference is None:
        show_image(axes, image)
        return
    detected = reference.labels > 0 if layers.detected is None else layers.detected
    classes = pixel_classes(reference, detected=detected)
    image = np.where(classes == PixelClass.OUTSIDE, (_OUTSIDE_FADE * image).astype(np.uint8), image)
    areas = {colour: classes == kind for kind, colour in AREA_COLOURS.items()}
    show_image(axes, overlay_areas(image, areas, strength=_TINT))
    for kind, hatch in HATCHES.items():
        if (classes == kind).any():
            filled = axes.contourf((classes == kind).astype(float), levels=[0.5, 1.5], colors="none", hatches=[hatch])
            filled.set(edgecolor=HATCH_COLOUR, linewidth=0.0)
    if layers.sweep is not None:
        draw_points(axes, layers.sweep)
    _, counts = count_frame(reference, detected, component_size_px=0)
    polygons, texts = [], []
    for target, of_target in zip(reference.objects, counts, strict=True):
        polygon = target.polygon
        if target.status is Status.STATIC or polygon is None or polygon.is_empty:
            continue
        polygons.append(polygon)
        texts.append(object_text(target, None if layers.detected is None else of_target))
        if target.status is Status.EVALUATED and not target.unknown_px:  # an outline would hide the unknown band
            draw_outline(axes, polygon, colour="white", style="--", width=0.9)
    if names:
        place_labels(axes, polygons, texts)


def object_text(target: ReferenceObject, counts: ObjectCounts | None) -> str:
    """Return "walker: TPR 85 %, IoU 50 %", without counts "walker: crossing", of an ignored one "van: beyond range"."""
    if target.reason is not None:
        return f"{target.track_id}: {_words(target.reason)}"
    if counts is None:
        return f"{target.track_id}: {_words(target.category or Category.MOVING)}"
    tpr, iou = counts.tp / (counts.tp + counts.fn), counts.tp / (counts.tp + counts.fp + counts.fn)
    return f"{target.track_id}: TPR {100 * tpr:.0f} %, IoU {100 * iou:.0f} %"


def _words(kind: Category | IgnoreReason) -> str:
    return kind.value.replace("_", " ")


def draw_points(axes: Axes, sweep: SeenSweep, *, size: float = 0.12) -> None:
    """Draw lidar points in the colour of their range, yellow near and dark far, near ones over far ones.

    Args:
        axes: of the image.
        sweep: at the exposure.
        size: of a point, points squared; the default is a pixel of the picture.
    """
    far_first = np.argsort(-sweep.range_m)
    u, v = sweep.pixels[far_first].T
    norm = LogNorm(NEAREST_M, FARTHEST_M)
    axes.scatter(
        u, v, c=sweep.range_m[far_first], norm=norm, cmap="viridis_r", s=size, linewidths=0, rasterized=True, zorder=2
    )


def add_legend(figure: Figure, *, results: bool, sweep: bool) -> None:
    """Add the one legend of all frames below them, in the lowest `LEGEND_IN` of the figure.

    Args:
        figure: with frames.
        results: they show what a method marks, not the reference alone.
        sweep: they show lidar points.
    """
    names = (
        AREA_NAMES
        if results
        else {PixelClass.TRUE_POSITIVE: "reference"}
        | {kind: name for kind, name in AREA_NAMES.items() if kind not in RESULTS}
    )
    handles: list[Artist] = [
        Patch(facecolor=AREA_COLOURS[kind], edgecolor=HATCH_COLOUR, hatch=HATCHES.get(kind), linewidth=0, label=name)
        for kind, name in names.items()
    ]
    handles.append(Patch(color=OUTSIDE_COLOUR, label="not evaluated"))
    if sweep:
        handles.append(Line2D([], [], color="#7ad151", marker=".", linestyle="", label="lidar point"))
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False, fontsize=6, handlelength=1.4,
                  handletextpad=0.5, labelspacing=0.3, columnspacing=0.6, borderaxespad=0.1)  # fmt: skip


COLUMNS = 2
LEGEND_IN, LEAST_WIDTH_IN = 0.36, 3.2  # at most two rows; a column of a paper
_MARGIN_IN, _LINE_IN, _NAME_IN = 0.04, 0.13, 0.18


@figures.styled
def draw_frames(layers: Sequence[Layers], *, name: str, title: str = "") -> Figure:
    """Draw an image with one or several sets of layers, two in a row, under one name and above one legend.

    Args:
        layers: at least one, of the same image.
        name: of the image.
        title: a line above all; empty for none.

    Returns:
        A figure whose size depends only on the size of the image and on which texts are there. A pixel of the image
        becomes a whole number of pixels.

    Source:
        Mariotti and Eising 2020, the figure that explains the detection rates.
    """
    columns = min(COLUMNS, len(layers))
    rows = -(-len(layers) // columns)
    height, width = layers[0].pixels.shape[:2]
    scale = -(-int(LEAST_WIDTH_IN * figures.DPI) // width)
    width_in, height_in = scale * width / figures.DPI, scale * height / figures.DPI
    head_in = any(side.label for side in layers) * _LINE_IN + any(side.note for side in layers) * _LINE_IN + _MARGIN_IN
    full_in = _NAME_IN * (1 + bool(title)) + rows * (head_in + height_in) + LEGEND_IN
    across_in = columns * (width_in + _MARGIN_IN) + _MARGIN_IN
    figure = figures.new_figure(across_in, full_in)
    for number, line in enumerate(filter(None, (title, name))):
        at_in = full_in - 0.03 - number * _NAME_IN
        text = figure.text(0.5, at_in / full_in, line, ha="center", va="top", fontsize=8)
        fit_text(text, across_in - 2 * _MARGIN_IN)
    for number, side in enumerate(layers):
        row, column = divmod(number, columns)
        bottom_in = LEGEND_IN + (rows - 1 - row) * (head_in + height_in)
        left_in = _MARGIN_IN + column * (width_in + _MARGIN_IN)
        axes = figures.axes_at(figure, left_in, bottom_in, width_in, height_in)
        draw_layers(axes, side)
        axes.set_title("\n".join(filter(None, (side.label, side.note))), pad=2, fontsize=7)
        fit_text(axes.title, width_in)
    add_legend(
        figure,
        results=any(side.detected is not None for side in layers),
        sweep=any(side.sweep is not None for side in layers),
    )
    return figure


CLOSE_UP_IN = 2.4, 1.8


@figures.styled
def draw_close_up(layers: Layers, target: ReferenceObject, *, name: str) -> Figure:
    """Draw an evaluated object with as much around it as it is large, above the name of the image."""
    assert target.polygon is not None, "an evaluated object has a polygon"
    width_in, height_in = CLOSE_UP_IN
    figure = figures.new_figure(width_in, height_in + _LINE_IN)
    axes = figures.axes_at(figure, 0.0, _LINE_IN, width_in, height_in)
    draw_layers(axes, layers, names=False)
    height, width = layers.pixels.shape[:2]
    zoom_on(axes, target.polygon, size=(width, height), aspect=width_in / height_in)
    fit_text(figure.text(0.5, 0.02, name, ha="center", va="bottom", fontsize=6.5), width_in - 2 * _MARGIN_IN)
    return figure


FARTHEST_SWEEP_NS = 100_000_000


class SweepViewer:
    """Projects the sweep nearest to an exposure.

    Args:
        recording: the drive.
        camera: whose images the sweeps are projected into.
    """

    def __init__(self, recording: Recording, camera: MountedCamera) -> None:
        self._recording, self._camera = recording, camera
        self._sweeps = SweepCache(recording, FARTHEST_SWEEP_NS)

    def see(self, image: ImageRef, *, compensated: bool = True) -> SeenSweep | None:
        """The sweep at an exposure; None where there is none within 100 ms, or no ego-motion.

        Args:
            image: the exposure.
            compensated: False for points as they were measured, as if nothing moved meanwhile.

        Raises:
            DataError: the sweep's file cannot be read.
        """
        placed = self._sweeps.nearest(None, image.timestamp_ns)
        if placed is None:
            return None
        world_from_vehicle = self._recording.trajectory.world_from_vehicle(image.timestamp_ns)
        if compensated:
            points_world = placed.points_world()
            points_vehicle = world_from_vehicle.inverse().apply(points_world)
            readout = Readout.at(image.timestamp_ns, trajectory=self._recording.trajectory, camera=self._camera)
        else:
            points_vehicle = self._recording.vehicle_from_lidar.apply(placed.sweep.points_lidar.astype(np.float64))
            points_world, readout = world_from_vehicle.apply(points_vehicle), None
        points_camera = self._camera.vehicle_from_camera.inverse().apply(points_vehicle)
        shown = points_camera if readout is None else readout.seen(points_camera, self._camera.model)
        pixels, valid = self._camera.model.project(shown)
        seen = valid & self._camera.model.contains(pixels)
        return SeenSweep(
            points_world=points_world,
            pixels=pixels[seen],
            range_m=np.linalg.norm(points_camera[seen], axis=1),
        )

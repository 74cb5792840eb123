"""One drawing of a frame for pages, pictures, videos and logs: its areas, outlines, objects and lidar points.

Beside it the panels of what a method saw, and an object's lidar cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

import cv2
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from shapely import box, get_parts, get_rings

from bench.evaluation.counts import ObjectCounts, count_frame
from bench.harness.frames import ProcessedFrame
from bench.plain_text import counted, plain
from bench.records.reference import (
    Category,
    IgnoreReason,
    ObjectGeometry,
    Outline,
    ReferenceFrame,
    ReferenceObject,
    Status,
)
from bench.reporting import figures
from bench.reporting.formats import frame_name

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
    """
    tinted = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()
    for colour, area in areas.items():
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


def draw_outline(axes: Axes, polygon: Outline, *, colour: str, style: str = "-", width: float = 1.0) -> None:
    """Outline a polygon with its holes, above points; a thin dark rim keeps it visible on any background."""
    rings = [Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in get_rings(get_parts(polygon))]
    path = Path.make_compound_path(*rings)
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=width, linestyle=style, zorder=3.5)
    patch.set_path_effects([withStroke(linewidth=width + 0.8, foreground="black")])
    axes.add_patch(patch)


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


@dataclass(frozen=True, slots=True)
class AreaStyle:
    """How the pixels of a class are drawn; without a hatch in their colour alone."""

    name: str
    colour: str
    hatch: str | None = None


AREAS = {
    PixelClass.TRUE_POSITIVE: AreaStyle("found", figures.GREEN),
    PixelClass.FALSE_NEGATIVE: AreaStyle("missed", figures.SKY_BLUE),
    PixelClass.FALSE_POSITIVE: AreaStyle("wrongly marked", figures.VERMILION),
    PixelClass.UNKNOWN: AreaStyle("unknown band", figures.YELLOW),
    PixelClass.IGNORED: AreaStyle("ignored object", figures.LIGHT_GREY, "//////"),
    PixelClass.LEFT_OUT: AreaStyle("not annotated", figures.DARK_GREY, "..."),
}
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
    """
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


def scored_layers(processed: ProcessedFrame, *, label: str = "", sweep: SeenSweep | None = None) -> Layers:
    """Return the layers of a frame as it was scored, with a note of the false positives of the image."""
    reference = processed.reference
    height, width = reference.valid.shape
    detected = processed.segmentation.mask_at(width, height) & reference.valid
    frame, _ = count_frame(reference, detected, component_size_px=0)
    note = f"false positives {100 * frame.fp_px / (frame.width * frame.height):.1f} % of the image"
    return Layers(pixels=processed.pixels, reference=reference, detected=detected, sweep=sweep, label=label, note=note)


def reference_layers(
    pixels: NDArray[np.uint8], reference: ReferenceFrame, *, label: str, sweep: SeenSweep | None = None
) -> Layers:
    """Return the layers of the reference alone, with a note of how many annotated objects are evaluated."""
    evaluated = sum(target.status is Status.EVALUATED for target in reference.objects)
    note = f"{evaluated} of {counted(len(reference.objects), 'annotated object')} evaluated"
    return Layers(pixels=pixels, reference=reference, sweep=sweep, label=label, note=note)


def draw_layers(axes: Axes, layers: Layers) -> None:
    """Draw an image with its layers onto axes, whose data coordinates become pixels (u, v).

    Objects are named: evaluated ones with their values, ignored ones with the reason.
    """
    image, reference = faded(layers.pixels, _FADE), layers.reference
    if reference is None:
        show_image(axes, image)
        return
    detected = reference.labels > 0 if layers.detected is None else layers.detected
    classes = pixel_classes(reference, detected=detected)
    image = np.where(classes == PixelClass.OUTSIDE, (_OUTSIDE_FADE * image).astype(np.uint8), image)
    areas = {style.colour: classes == kind for kind, style in AREAS.items()}
    show_image(axes, overlay_areas(image, areas, strength=_TINT))
    for style in AREAS.values():
        if style.hatch and areas[style.colour].any():
            area = areas[style.colour].astype(float)
            filled = axes.contourf(area, levels=[0.5, 1.5], colors="none", hatches=[style.hatch])
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
    names = {kind: style.name for kind, style in AREAS.items()}
    if not results:
        names |= {PixelClass.TRUE_POSITIVE: "reference"}
        del names[PixelClass.FALSE_NEGATIVE], names[PixelClass.FALSE_POSITIVE]
    handles: list[Artist] = [
        Patch(facecolor=AREAS[kind].colour, edgecolor=HATCH_COLOUR, hatch=AREAS[kind].hatch, linewidth=0, label=name)
        for kind, name in names.items()
    ]
    handles.append(Patch(color=OUTSIDE_COLOUR, label="not evaluated"))
    if sweep:
        handles.append(Line2D([], [], color="#7ad151", marker=".", linestyle="", label="lidar point"))
    figure.legend(handles=handles, loc="lower center", ncols=4, frameon=False, fontsize=6, handlelength=1.4,
                  handletextpad=0.5, labelspacing=0.3, columnspacing=0.6, borderaxespad=0.1)  # fmt: skip


LEGEND_IN, LEAST_WIDTH_IN = 0.36, 3.2  # at most two rows; a column of a paper
_MARGIN_IN, _LINE_IN, _NAME_IN = 0.04, 0.13, 0.18


@figures.styled
def draw_frames(layers: Sequence[Layers], *, name: str) -> Figure:
    """Draw an image with one or several sets of layers beside each other, under one name and above one legend.

    Args:
        layers: at least one, of the same image.
        name: of the image.

    Returns:
        A figure whose size depends only on the size of the image and on which texts are there. A pixel of the image
        becomes a whole number of pixels.

    Source:
        Mariotti and Eising 2020, the figure that explains the detection rates.
    """
    height, width = layers[0].pixels.shape[:2]
    scale = -(-int(LEAST_WIDTH_IN * figures.DPI) // width)
    width_in, height_in = scale * width / figures.DPI, scale * height / figures.DPI
    head_in = any(side.label for side in layers) * _LINE_IN + any(side.note for side in layers) * _LINE_IN + _MARGIN_IN
    full_in = _NAME_IN + head_in + height_in + LEGEND_IN
    across_in = len(layers) * (width_in + _MARGIN_IN) + _MARGIN_IN
    figure = figures.new_figure(across_in, full_in)
    text = figure.text(0.5, 1 - 0.03 / full_in, name, ha="center", va="top", fontsize=8)
    fit_text(text, across_in - 2 * _MARGIN_IN)
    for number, side in enumerate(layers):
        left_in = _MARGIN_IN + number * (width_in + _MARGIN_IN)
        axes = figures.axes_at(figure, left_in, LEGEND_IN, width_in, height_in)
        draw_layers(axes, side)
        axes.set_title("\n".join(filter(None, (side.label, side.note))), pad=2, fontsize=7)
        fit_text(axes.title, width_in)
    add_legend(
        figure,
        results=any(side.detected is not None for side in layers),
        sweep=any(side.sweep is not None for side in layers),
    )
    return figure


# What a method saw.

LIKELIHOOD_SATURATION, SCORE_SATURATION = 0.02, 1.0  # the paper's figure 6
DEVIATION_SATURATION = 0.05  # a deviation of weight 1 that makes a likelihood of 0.02 by itself is 0.048
FLOW_SATURATION_PX = 16.0
ARROWS_ACROSS = 24
DEVIATIONS = {
    "epipolar": "epipolar",
    "positive_depth": "positive depth",
    "positive_height": "positive height",
    "anti_parallel": "anti-parallel",
    "three_view": "three views",
}
_NUMERALS = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
_PANEL_IN, _LEFT_IN, _RIGHT_IN, _TOP_IN, _GAP_IN, _SECOND_LINE_IN = 2.6, 0.26, 0.62, 0.22, 0.06, 0.1


_Draw = Callable[[Axes], ScalarMappable | None]  # draws a panel and returns what has its colours, if anything


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
    height_in, top_in = _PANEL_IN * height / width, _TOP_IN + bool(made_by) * _SECOND_LINE_IN
    full_in = top_in + len(panels) * (height_in + _GAP_IN) + LEGEND_IN
    figure = figures.new_figure(_LEFT_IN + _PANEL_IN + _RIGHT_IN, full_in)
    for number, ((label, unit, draw), numeral) in enumerate(zip(panels, _NUMERALS, strict=False)):
        bottom_in = full_in - top_in - height_in - number * (height_in + _GAP_IN)
        axes = figures.axes_at(figure, _LEFT_IN, bottom_in, _PANEL_IN, height_in)
        coloured = draw(axes)
        axes.set_ylabel(f"({numeral}) {label}", fontsize=7, labelpad=3)
        if coloured is not None:
            _draw_colour_bar(axes, coloured, unit)
    heading = f"{frame_name(processed.reference)}\n{made_by}".rstrip()
    fit_text(figure.axes[0].set_title(heading, pad=3, fontsize=6), _PANEL_IN + 2 * _LEFT_IN)
    add_legend(figure, results=True, sweep=False)
    return figure


def _draw_colour_bar(axes: Axes, coloured: ScalarMappable, unit: str) -> None:
    _, most = coloured.get_clim()
    assert most is not None, "each panel fixes its colours"
    beside = axes.inset_axes((1.023, 0.05, 0.035, 0.9))
    bar = axes.figure.colorbar(coloured, cax=beside, extend="max", ticks=[0.0, most / 2, most])
    bar.ax.tick_params(labelsize=6, length=2, pad=1.5)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.set_label(unit, fontsize=6)
    bar.ax.yaxis.set_label_coords(4.6, 0.5)  # one line for all bars, whatever their numbers' width


def _panels(processed: ProcessedFrame) -> Iterator[tuple[str, str, _Draw]]:
    """Each panel: its label, the unit of its colours, and what draws it."""
    segmentation, parts = processed.segmentation, processed.segmentation.parts or {}

    def of_cells(values: NDArray[np.float32], saturation: float) -> _Draw:
        return partial(_draw_cells, values=values, saturation=saturation, processed=processed)

    if "flow_u" in parts and "flow_v" in parts:
        yield ("flow", "px per frame", partial(_draw_flow, processed=processed))
    for name, label in DEVIATIONS.items():
        if name in parts:
            yield (label, "deviation", of_cells(parts[name], DEVIATION_SATURATION))
    if segmentation.likelihood is not None:
        is_score = segmentation.likelihood_is_score
        label, saturation = ("score", SCORE_SATURATION) if is_score else ("likelihood", LIKELIHOOD_SATURATION)
        yield (label, label, of_cells(segmentation.likelihood, saturation))
    yield ("segmentation", "", partial(draw_layers, layers=scored_layers(processed)))


def _draw_flow(axes: Axes, *, processed: ProcessedFrame) -> ScalarMappable:
    """Draw arrows from where the pixel was in the previous image to where it is now, on an even grid."""
    image, segmentation = processed.pixels, processed.segmentation
    assert segmentation.parts is not None
    flow_u, flow_v = segmentation.parts["flow_u"], segmentation.parts["flow_v"]
    show_image(axes, faded(image, 0.45))
    step, cell = max(1, flow_u.shape[1] // ARROWS_ACROSS), segmentation.cell_size_px
    picked = np.s_[step // 2 :: step, step // 2 :: step]
    v, u = (np.mgrid[: flow_u.shape[0], : flow_u.shape[1]] * cell + (cell - 1) / 2)[:, *picked]
    inside = (u < image.shape[1]) & (v < image.shape[0])
    at = np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)
    seen = inside & processed.reference.valid[at]
    back_u, back_v = flow_u[picked][seen], flow_v[picked][seen]
    return axes.quiver(
        u[seen], v[seen], -back_u, -back_v, np.hypot(back_u, back_v),
        angles="xy", scale_units="xy", scale=1.0, pivot="tip", width=0.0045, headwidth=4.0, headlength=4.5,
        minlength=0.6, cmap="viridis", norm=Normalize(vmin=0.0, vmax=FLOW_SATURATION_PX, clip=True),
    )  # fmt: skip


def _draw_cells(
    axes: Axes, *, values: NDArray[np.float32], saturation: float, processed: ProcessedFrame
) -> ScalarMappable:
    """Colour the cells; light grey where the lens or the method sees nothing."""
    segmentation, valid = processed.segmentation, processed.reference.valid
    (height, width), (rows, columns) = valid.shape, values.shape
    cell = segmentation.cell_size_px
    middle = cell // 2
    seen = valid[middle::cell, middle::cell]
    hidden = ~np.pad(seen, ((0, rows - seen.shape[0]), (0, columns - seen.shape[1])), mode="edge")
    if segmentation.undefined is not None:
        hidden |= segmentation.undefined
    axes.set_facecolor(figures.LIGHT_GREY)
    coloured = axes.imshow(
        np.ma.masked_array(values, mask=hidden | ~np.isfinite(values)),
        cmap="inferno", norm=Normalize(vmin=0.0, vmax=saturation, clip=True), interpolation="nearest",
        extent=(-0.5, columns * cell - 0.5, rows * cell - 0.5, -0.5),
    )  # fmt: skip
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    return coloured


# An object's lidar cluster.

_CLUSTER_IN, _TEXTS_IN, _SURROUNDINGS_M = 7.0, 0.3, 3.0


@figures.styled
def draw_cluster(
    geometry: ObjectGeometry,
    *,
    image: NDArray[np.uint8],
    polygon: Outline,
    vehicle_outline_m: NDArray[np.float64],
    title: str,
    image_name: str,
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
    figure = figures.new_figure(_CLUSTER_IN, _CLUSTER_IN / (1 + width / height) + _TEXTS_IN, layout="constrained")
    plan, picture = figure.subplots(1, 2, width_ratios=[1, width / height])
    _draw_plan(plan, geometry, vehicle_outline_m)
    show_image(picture, image)
    zoom_on(picture, polygon, size=(width, height), aspect=width / height)
    seen = geometry.pixels[np.isfinite(geometry.pixels).all(axis=1)]
    picture.scatter(seen[:, 0], seen[:, 1], s=0.8, c=figures.SKY_BLUE, linewidths=0, zorder=3, rasterized=True)
    draw_outline(picture, polygon, colour=figures.VERMILION, width=1.1)
    plan.set_title("(a) point cloud from above", pad=3)
    picture.set_title(f"(b) {title}", pad=3)
    picture.set_xlabel(image_name)
    return figure


def _draw_plan(axes: Axes, geometry: ObjectGeometry, vehicle_outline_m: NDArray[np.float64]) -> None:
    around, cluster, outline_m = geometry.surroundings_vehicle, geometry.cluster_vehicle, geometry.outline_m
    axes.scatter(around[:, 1], around[:, 0], s=0.4, c="#777777", linewidths=0, rasterized=True)
    axes.scatter(cluster[:, 1], cluster[:, 0], s=2.5, c=figures.SKY_BLUE, linewidths=0, zorder=4.5, rasterized=True)
    if len(outline_m):
        axes.add_patch(PolygonPatch(outline_m[:, ::-1], fill=False, edgecolor=figures.ORANGE, linewidth=1.3, zorder=4))
    figures.draw_vehicle(axes, vehicle_outline_m)
    corners = np.concatenate([part for part in (cluster[:, :2], outline_m, vehicle_outline_m) if len(part)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    half_m = (high - low).max() / 2 + _SURROUNDINGS_M
    (x, y) = (low + high) / 2
    figures.plan_axes(axes, x_m=(x - half_m, x + half_m), y_m=(y - half_m, y + half_m))
    axes.set_xlabel("y (m), left of the ego vehicle", labelpad=1.5)
    axes.set_ylabel("x (m), ahead of the ego vehicle", labelpad=1.5)

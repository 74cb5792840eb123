"""The picture that explains true positive, false negative and false positive areas of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.evaluation.counts import ObjectCounts, count_frame
from bench.harness import ProcessedFrame
from bench.records.reference import ReferenceFrame
from bench.reporting import canvas
from bench.reporting.formats import frame_name
from bench.reporting.overlay import draw_outline, outlined, overlay_mask, place_labels, unknown_bands

WIDTH_IN = 3.5
MARGIN_IN = 0.04
_LEGEND_IN, _BAND_LEGEND_IN, _TITLE_LINE_IN = 0.36, 0.15, 0.16
_BACKGROUND_STRENGTH, _OUTSIDE_STRENGTH, _TINT = 0.8, 0.3, 0.62


class PixelClass(IntEnum):
    """Class that a pixel counts as; every pixel has exactly one."""

    OUTSIDE = 0  # not in V
    BACKGROUND = 1  # in V, neither reference nor detection
    TRUE_POSITIVE = 2
    FALSE_NEGATIVE = 3
    FALSE_POSITIVE = 4
    IGNORED = 5
    UNKNOWN = 6  # in an unknown band: may be the object's, counts neither way


AREA_COLOURS = {
    PixelClass.TRUE_POSITIVE: canvas.GREEN,
    PixelClass.FALSE_NEGATIVE: canvas.SKY_BLUE,
    PixelClass.FALSE_POSITIVE: canvas.VERMILION,
    PixelClass.UNKNOWN: canvas.YELLOW,
}


def detected_pixels(processed: ProcessedFrame) -> NDArray[np.bool_]:
    """(H, W) bool, where the method marks motion in a processed frame, within V."""
    height, width = processed.reference.valid.shape
    return processed.segmentation.mask_at(width, height) & processed.reference.valid


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
    classes[unknown_bands(reference) > 0] = PixelClass.UNKNOWN
    classes[region & detected] = PixelClass.TRUE_POSITIVE
    classes[region & ~detected] = PixelClass.FALSE_NEGATIVE
    classes[~reference.valid] = PixelClass.OUTSIDE
    return classes


def overlay_counts(processed: ProcessedFrame) -> NDArray[np.uint8]:
    """The image of a processed frame with the areas that it is scored by tinted, (H, W, 3) BGR uint8."""
    classes = pixel_classes(processed.reference, detected=detected_pixels(processed))
    tinted = processed.pixels
    for kind, colour in AREA_COLOURS.items():
        tinted = overlay_mask(tinted, mask=classes == kind, colour=colour, strength=0.45)
    return tinted


@canvas.styled
def draw_counts(
    image: NDArray[np.uint8],
    *,
    reference: ReferenceFrame,
    detected: NDArray[np.bool_],
    made_by: str = "",
) -> Figure:
    """Draw the areas that a frame is scored by.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        reference: the frame's reference.
        detected: (H, W) bool; the method's mask at every pixel.
        made_by: method and protocol, below the name of the image; empty where they are said beside the picture.

    Returns:
        One picture at the width of a paper's column, with its legend, which image it is, and the frame's coverage.

    Source:
        Mariotti and Eising 2020, the figure that explains the detection rates.
    """
    has_bands = bool(unknown_bands(reference).any())
    legend_in = legend_height_in(has_bands)
    height_in = picture_height_in(reference)
    title = [frame_name(reference), *([made_by] if made_by else []), false_positive_text(reference, detected=detected)]
    figure = canvas.new_figure(WIDTH_IN, len(title) * _TITLE_LINE_IN + height_in + legend_in)
    axes = canvas.axes_at(figure, MARGIN_IN, legend_in, WIDTH_IN - 2 * MARGIN_IN, height_in)
    draw_areas(axes, image, reference=reference, detected=detected)
    axes.set_title("\n".join(title), pad=3, fontsize=7)
    draw_legend(figure, has_bands=has_bands)
    return figure


def picture_height_in(reference: ReferenceFrame) -> float:
    """Height of an image that fills the width of a paper's column."""
    height, width = reference.valid.shape
    return float((WIDTH_IN - 2 * MARGIN_IN) * height / width)


def legend_height_in(has_bands: bool) -> float:
    """Height of the legend of areas."""
    return _LEGEND_IN + has_bands * _BAND_LEGEND_IN


def draw_areas(axes: Axes, image: NDArray[np.uint8], *, reference: ReferenceFrame, detected: NDArray[np.bool_]) -> None:
    """The areas of a frame and the name, TPR and IoU of each object, on axes of their own."""
    classes = pixel_classes(reference, detected=detected)
    canvas.show_image(axes, _tinted(canvas.rgb_image(image), classes))
    _hatch_ignored(axes, classes)
    _, objects = count_frame(reference, detected, component_size_px=0)
    _name_objects(axes, reference, objects, outline=not (classes == PixelClass.UNKNOWN).any())


def false_positive_text(reference: ReferenceFrame, *, detected: NDArray[np.bool_]) -> str:
    """For example "false positives 12.3 % of the image"."""
    frame, _ = count_frame(reference, detected, component_size_px=0)
    return f"false positives {100 * frame.fp_px / (frame.width * frame.height):.1f} % of the image"


def draw_legend(figure: Figure, *, has_bands: bool) -> None:
    """Draw what the colours of the areas mean, at the foot of a figure."""
    style: dict[str, Any] = {
        "loc": "lower center",
        "frameon": False,
        "fontsize": 6.5,
        "handlelength": 1.6,
        "labelspacing": 0.3,
    }
    figure.legend(handles=_legend(has_bands), ncols=3, columnspacing=1.2, borderaxespad=0.1, **style,
                  bbox_to_anchor=(0.0, has_bands * _BAND_LEGEND_IN / figure.get_figheight(), 1.0, 1.0))  # fmt: skip
    if has_bands:
        band = Patch(color=canvas.YELLOW, label="unknown band around the core of each object: counts neither way")
        figure.legend(handles=[band], borderaxespad=0.1, **style)


def _tinted(image_rgb: NDArray[np.uint8], classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    grey = canvas.faded(image_rgb, _BACKGROUND_STRENGTH).astype(np.float32)
    grey[classes == PixelClass.OUTSIDE] *= _OUTSIDE_STRENGTH
    for kind, colour in AREA_COLOURS.items():
        canvas.tint(grey, classes == kind, colour, _TINT)
    return grey.astype(np.uint8)


def _hatch_ignored(axes: Axes, classes: NDArray[np.uint8]) -> None:
    ignored = classes == PixelClass.IGNORED
    if ignored.any():
        filled = axes.contourf(ignored.astype(float), levels=[0.5, 1.5], colors=[(1, 1, 1, 0.35)], hatches=["//////"])
        filled.set_edgecolor("#404040")
        filled.set_linewidth(0.0)


def _name_objects(axes: Axes, reference: ReferenceFrame, counts: Sequence[ObjectCounts], *, outline: bool) -> None:
    """Label the evaluated objects; their outlines would hide unknown bands."""
    polygons, texts = [], []
    for target, count in zip(reference.objects, counts, strict=True):
        for _, polygon in outlined([target]):
            if outline:
                draw_outline(axes, polygon, colour="white", style="--", width=0.9)
            polygons.append(polygon)
            texts.append(_label(target.track_id, count))
    place_labels(axes, polygons, texts)


def _label(track_id: str, count: ObjectCounts) -> str:
    """Track, coverage and IoU of an evaluated object, whose region is never empty."""
    coverage = count.tp / (count.tp + count.fn)
    iou = count.tp / (count.tp + count.fp + count.fn)
    return f"{track_id}: TPR {100 * coverage:.0f} %, IoU {100 * iou:.0f} %"


def _legend(has_bands: bool) -> list[Patch | Line2D]:
    polygon = Line2D([], [], color=canvas.GREY, linestyle="--", linewidth=1.2, label="reference polygon")
    return [
        Patch(color=canvas.GREEN, label="TP, true positive"),
        Patch(color=canvas.SKY_BLUE, label="FN, false negative"),
        Patch(color=canvas.VERMILION, label="FP, false positive"),
        *([] if has_bands else [polygon]),
        Patch(facecolor="white", edgecolor="#404040", hatch="//////", linewidth=0.4, label="ignored"),
        Patch(color="#404040", label="not evaluated"),
    ]

"""Masks and polygons over an image, and the areas that it is scored by: what each pixel counts as, in its colour.

Fast pictures are drawn by OpenCV, outlines with labels on matplotlib's axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, NoNorm
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from shapely import LinearRing, get_parts, get_rings

from bench.errors import ShapeError
from bench.evaluation.counts import count_frame
from bench.harness import ProcessedFrame
from bench.plain_text import plain
from bench.records.reference import Outline, ReferenceFrame, ReferenceObject, Status
from bench.reporting.canvas import BLACK, GREEN, GREY, SKY_BLUE, VERMILION, YELLOW, category_colour, rgb

_SHIFT = 4  # fractional bits of OpenCV's drawing coordinates
_LABEL_SIZES = 4.5, 6.0  # points, in a picture of 1.8 inches and less, of 2.4 inches and more
_LABEL_GAP_PX = 3.0


def bgr_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A copy of an image, (H, W) grey or (H, W, 3) BGR, as (H, W, 3) BGR."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy(), dtype=np.uint8)


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
    tinted = bgr_image(image)
    for colour, area in areas.items():
        if area.shape != image.shape[:2]:
            raise ShapeError(f"mask: expected {image.shape[:2]}, got {area.shape}")
        tinted[area] = ((1 - strength) * tinted[area] + strength * np.array(rgb(colour)[::-1])).astype(np.uint8)
    return tinted


def overlay_polygons(
    image: NDArray[np.uint8], *, polygons: Sequence[Outline], colours: Sequence[str], thickness: int = 1
) -> NDArray[np.uint8]:
    """Outline polygons, given in pixels with the first pixel's centre at (0, 0), to a sixteenth of a pixel.

    Returns:
        (H, W, 3) BGR uint8, a new image.
    """
    drawn = bgr_image(image)
    for polygon, colour in zip(polygons, colours, strict=True):
        rings = [_fixed_point(ring) for ring in get_rings(get_parts(polygon)) if not ring.is_empty]
        cv2.polylines(drawn, rings, True, rgb(colour)[::-1], thickness, cv2.LINE_AA, _SHIFT)
    return drawn


LINE_PX = 22
_TEXT_SCALE, _INDENT_PX = 0.5, 6
Legend = Sequence[tuple[str, str]]  # colours and what they mean


def kind_legend(reference: ReferenceFrame) -> Legend:
    """Legend of the colours of outlines, for the kinds of motion that the image holds."""
    kinds = dict.fromkeys(target.category for target, _ in outlined(reference.objects))
    named = [(category_colour(kind), "moving" if kind is None else kind.value.replace("_", " ")) for kind in kinds]
    return [(colour, f"reference, {name}") for colour, name in named]


def captioned(picture: NDArray[np.uint8], lines: Sequence[str], *, legend: Legend = ()) -> NDArray[np.uint8]:
    """A picture with lines of text and a legend below it, as small as they must be to fit.

    Returns:
        (H, W, 3) BGR uint8 of even sides, as codecs of videos need them.
    """
    height, width = picture.shape[:2]
    below = LINE_PX * (len(lines) + bool(legend))
    framed = np.zeros((height + below + (height + below) % 2, width + width % 2, 3), dtype=np.uint8)
    framed[:height, :width] = picture
    for number, line in enumerate(lines, start=1):
        shown = "".join(c if c.isascii() and c.isprintable() else "?" for c in line)
        _put_text(framed, shown, left=_INDENT_PX, base=height + number * LINE_PX - 6, scale=_fitting(shown, width))
    words = "".join(f"   {word}  " for _, word in legend)
    scale, left = _fitting(words, width), _INDENT_PX
    side = round(20 * scale)
    for colour, word in legend:
        base = height + below - 6
        cv2.rectangle(framed, (left, base - side), (left + side, base), rgb(colour)[::-1], cv2.FILLED)
        left += side + 4
        left += _put_text(framed, word, left=left, base=base, scale=scale) + round(28 * scale)
    return framed


def _put_text(image: NDArray[np.uint8], text: str, *, left: int, base: int, scale: float) -> int:
    """Write in white; how wide it is."""
    cv2.putText(image, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return _width_px(text, scale)


def _width_px(text: str, scale: float) -> int:
    return int(cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0])


def _fitting(text: str, width_px: int) -> float:
    wide = _width_px(text, _TEXT_SCALE)
    return _TEXT_SCALE * min(1.0, (width_px - 2 * _INDENT_PX) / max(wide, 1))


def unknown_bands(reference: ReferenceFrame) -> NDArray[np.int32]:
    """Divide the unknown bands among the evaluated objects: each pixel is of the nearest core.

    Returns:
        (H, W) int32; k + 1 in the band of `objects[k]`, 0 elsewhere; all 0 under a protocol without bands.
    """
    if not reference.unknown.any():
        return np.zeros_like(reference.labels)
    rows, columns = distance_transform_edt(reference.labels == 0, return_distances=False, return_indices=True)
    return np.where(reference.unknown, reference.labels[rows, columns], 0)


def outlined(objects: Sequence[ReferenceObject]) -> list[tuple[ReferenceObject, Outline]]:
    """The evaluated objects with their polygons."""
    return [(o, o.polygon) for o in objects if o.status is Status.EVALUATED and o.polygon is not None]


def _fixed_point(ring: LinearRing) -> NDArray[np.int32]:
    corners: NDArray[np.float64] = np.asarray(ring.coords)[:, :2]
    fixed: NDArray[np.int32] = np.round(corners * 2**_SHIFT).astype(np.int32)
    return fixed


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
    PixelClass.TRUE_POSITIVE: GREEN,
    PixelClass.FALSE_NEGATIVE: SKY_BLUE,
    PixelClass.FALSE_POSITIVE: VERMILION,
    PixelClass.UNKNOWN: YELLOW,
}
UNSCORED_COLOURS = {PixelClass.IGNORED: GREY, PixelClass.OUTSIDE: BLACK}
AREA_NAMES = {
    PixelClass.TRUE_POSITIVE: "found",
    PixelClass.FALSE_NEGATIVE: "missed",
    PixelClass.FALSE_POSITIVE: "wrongly marked",
    PixelClass.UNKNOWN: "unknown band, counts neither way",
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


def areas_of(classes: NDArray[np.uint8]) -> dict[str, NDArray[np.bool_]]:
    """The areas that a frame is scored by, (H, W) bool, by their colour."""
    return {colour: classes == kind for kind, colour in AREA_COLOURS.items()}


def overlay_counts(processed: ProcessedFrame) -> NDArray[np.uint8]:
    """The image of a processed frame with the areas that it is scored by tinted, (H, W, 3) BGR uint8."""
    classes = pixel_classes(processed.reference, detected=detected_pixels(processed))
    unscored = {colour: classes == kind for kind, colour in UNSCORED_COLOURS.items()}
    return overlay_areas(processed.pixels, areas_of(classes) | unscored, strength=0.45)


def false_positive_text(processed: ProcessedFrame) -> str:
    """For example "false positives 12.3 % of the image"."""
    frame, _ = count_frame(processed.reference, detected_pixels(processed), component_size_px=0)
    return f"false positives {100 * frame.fp_px / (frame.width * frame.height):.1f} % of the image"


def draw_outline(axes: Axes, polygon: Outline, *, colour: str, style: str = "-", width: float = 1.0) -> PathPatch:
    """Outline a polygon with its holes; a thin dark rim keeps it visible on any background."""
    rings = [Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in get_rings(get_parts(polygon))]
    path = Path.make_compound_path(*rings)
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=width, linestyle=style)
    patch.set_path_effects([withStroke(linewidth=width + 0.8, foreground="black")])
    axes.add_patch(patch)
    return patch


def draw_references(axes: Axes, reference: ReferenceFrame) -> None:
    """Show the evaluated objects in the colour of their kind of motion, each with category and track.

    Outlines; where there are unknown bands, these.
    """
    shown = [(target, polygon) for target, polygon in outlined(reference.objects) if not polygon.is_empty]
    bands = unknown_bands(reference)
    if bands.any():
        colours = ["none", *(category_colour(target.category) for target in reference.objects)]
        axes.imshow(bands, cmap=ListedColormap(colours), norm=NoNorm(), interpolation="nearest")
    else:
        for target, polygon in shown:
            draw_outline(axes, polygon, colour=category_colour(target.category))
    words = ["moving" if o.category is None else o.category.value.replace("_", " ") for o, _ in shown]
    texts = [f"{word} {target.track_id}" for word, (target, _) in zip(words, shown, strict=True)]
    place_labels(axes, [polygon for _, polygon in shown], texts)


def place_labels(axes: Axes, polygons: Sequence[Outline], texts: Sequence[str]) -> list[Text]:
    """Write each text beside its polygon, inside the axes and off the labels already there.

    Above the polygon where there is room, else below it, else further up and down; off the other polygons if it can.
    """
    placed: list[Bbox] = []
    labels = []
    figure_width_in = axes.figure.get_figure(root=True).get_figwidth()
    size = float(np.clip(2.5 * figure_width_in * axes.get_position().width, *_LABEL_SIZES))
    for polygon, text in zip(polygons, texts, strict=True):
        label = axes.text(0, 0, plain(text), fontsize=size, color="white", ha="left", va="bottom", zorder=10)
        label.set_path_effects([effect(linewidth=1.4, foreground="black") for effect in (Stroke, withStroke)])
        others = [Bbox.from_extents(*other.bounds) for other in polygons if other is not polygon]
        placed.append(_place_label(axes, label, polygon, taken=placed, avoided=others))
        labels.append(label)
    return labels


def _place_label(axes: Axes, label: Text, polygon: Outline, *, taken: Sequence[Bbox], avoided: Sequence[Bbox]) -> Bbox:
    """Move the label to the first free position and return the box it covers, in data coordinates."""
    extent = label.get_window_extent().transformed(axes.transData.inverted())
    width, height = abs(extent.width), abs(extent.height)
    left, right = sorted(axes.get_xlim())
    top, bottom = sorted(axes.get_ylim())  # v grows downwards
    u_min, v_min, u_max, v_max = polygon.bounds
    above, below = v_min - _LABEL_GAP_PX, v_max + _LABEL_GAP_PX + height
    levels = [above, below, *(above - k * height for k in range(1, 6)), *(below + k * height for k in range(1, 6))]
    sides = np.clip(
        [(u_min + u_max - width) / 2, u_min, u_max - width], left + _LABEL_GAP_PX, right - width - _LABEL_GAP_PX
    )
    tries = [(u, v) for v in levels if top + height <= v <= bottom for u in sides]
    boxes = [Bbox.from_extents(u, v - height, u + width, v) for u, v in tries]
    v = float(np.clip((v_min + v_max + height) / 2, top + height, bottom))
    inside = Bbox.from_extents(sides[0], v - height, sides[0] + width, v)
    free = [box for box in boxes if not any(box.overlaps(other) for other in taken)]
    clear = (box for box in free if not any(box.overlaps(other) for other in avoided))
    chosen = next(clear, free[0] if free else inside)
    label.set_position((chosen.x0, chosen.y1))
    return chosen

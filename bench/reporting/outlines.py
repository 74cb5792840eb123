"""Reference polygons and their labels, drawn over an image."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import Stroke, withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from shapely import Polygon

from bench.plain_text import plain
from bench.reference.records import ReferenceObject, Status
from bench.reporting.canvas import category_colour

_LABEL_SIZES = 4.5, 6.0  # points, in a picture of 1.8 inches and less, of 2.4 inches and more
_LABEL_GAP_PX = 3.0


def polygon_path(polygon: Polygon) -> Path:
    """The polygon with its holes as one closed path, in the polygon's own coordinates."""
    rings = [polygon.exterior, *polygon.interiors]
    return Path.make_compound_path(*(Path(np.asarray(ring.coords)[:, :2], closed=True) for ring in rings))


def draw_outline(axes: Axes, polygon: Polygon, *, colour: str, style: str = "-", width: float = 1.0) -> PathPatch:
    """Outline a polygon; a thin dark rim keeps it visible on any background."""
    patch = PathPatch(polygon_path(polygon), fill=False, edgecolor=colour, linewidth=width, linestyle=style)
    patch.set_path_effects([withStroke(linewidth=width + 0.8, foreground="black")])
    axes.add_patch(patch)
    return patch


def draw_references(axes: Axes, objects: Sequence[ReferenceObject], *, labels: bool = True) -> None:
    """Outline the evaluated objects in the colour of their kind of motion, each with category and track."""
    shown = [o for o in objects if o.status is Status.EVALUATED and o.polygon is not None and not o.polygon.is_empty]
    for reference in shown:
        assert reference.polygon is not None
        draw_outline(axes, reference.polygon, colour=category_colour(reference.category))
    if labels:
        texts = [f"{_words(o)} {o.track_id}" for o in shown]
        place_labels(axes, [o.polygon for o in shown if o.polygon is not None], texts)


def place_labels(axes: Axes, polygons: Sequence[Polygon], texts: Sequence[str]) -> list[Text]:
    """Write each text beside its polygon, inside the axes and off the labels already there.

    Above the polygon where there is room, else below it, else further up and down; off the other polygons if it can.
    """
    placed: list[Bbox] = []
    labels = []
    figure_width_in = axes.figure.get_figure(root=True).get_figwidth()
    size = float(np.clip(2.5 * figure_width_in * axes.get_position().width, *_LABEL_SIZES))
    for polygon, text in zip(polygons, texts, strict=True):
        label = axes.text(0, 0, plain(text), fontsize=size, color="white", ha="left", va="bottom", zorder=10)
        label.set_path_effects(
            [Stroke(linewidth=1.4, foreground="black"), withStroke(linewidth=1.4, foreground="black")]
        )
        others = [Bbox.from_extents(*other.bounds) for other in polygons if other is not polygon]
        placed.append(_settle(axes, label, polygon, taken=placed, shunned=others))
        labels.append(label)
    return labels


def _settle(axes: Axes, label: Text, polygon: Polygon, *, taken: Sequence[Bbox], shunned: Sequence[Bbox]) -> Bbox:
    """Move the label to the first free place and return the box it covers, in data coordinates."""
    width, height = _size_in_data(axes, label)
    left, right = sorted(axes.get_xlim())
    top, bottom = sorted(axes.get_ylim())  # v grows downwards
    u_min, v_min, u_max, v_max = polygon.bounds
    above, below = v_min - _LABEL_GAP_PX, v_max + _LABEL_GAP_PX + height
    levels = [above, below, *(above - k * height for k in range(1, 6)), *(below + k * height for k in range(1, 6))]
    sides = np.clip(
        [(u_min + u_max - width) / 2, u_min, u_max - width], left + _LABEL_GAP_PX, right - width - _LABEL_GAP_PX
    )
    tries = [(float(u), v) for v in levels if top + height <= v <= bottom for u in sides]
    inside = float(sides[0]), float(np.clip((v_min + v_max + height) / 2, top + height, bottom))
    free = [place for place in tries if not _hits(*place, width, height, taken)]
    clear = (place for place in free if not _hits(*place, width, height, shunned))
    u, v = next(clear, free[0] if free else inside)
    label.set_position((u, v))
    return Bbox.from_extents(u, v - height, u + width, v)


def _hits(u: float, v: float, width: float, height: float, taken: Sequence[Bbox]) -> bool:
    box = Bbox.from_extents(u, v - height, u + width, v)
    return any(box.overlaps(other) for other in taken)


def _size_in_data(axes: Axes, label: Text) -> tuple[float, float]:
    extent = label.get_window_extent().transformed(axes.transData.inverted())
    return abs(extent.width), abs(extent.height)


def _words(reference: ReferenceObject) -> str:
    return "moving" if reference.category is None else reference.category.value.replace("_", " ")

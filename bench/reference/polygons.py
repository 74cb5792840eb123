"""From projected points to a polygon, and from pixels to the polygon around them."""

from __future__ import annotations

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from bench.errors import UsageError
from bench.records.reference import Outline


def bounding_polygon(
    pixels: NDArray[np.float64], *, kind: str, concave_ratio: float, width: int, height: int
) -> Polygon | None:
    """The polygon around projected points.

    Args:
        pixels: (N, 2) float64, px, (u, v), finite; may lie outside the image.
        kind: "convex", the paper's bounding polygon, or "concave", the tighter hull.
        concave_ratio: tightness of the concave hull, 0 to 1.
        width: of the image, px.
        height: of the image, px.

    Returns:
        The polygon, cut off one image size beyond the border; None for fewer than three points or points on a line.

    Raises:
        UsageError: another kind.
    """
    if len(pixels) < 3:
        return None
    if kind not in {"convex", "concave"}:
        raise UsageError(f"polygon kind: expected 'convex' or 'concave', got {kind!r}")
    row = shapely.linestrings(pixels)  # the hulls take its corners; far faster to build than a MultiPoint
    hull = shapely.convex_hull(row) if kind == "convex" else shapely.concave_hull(row, ratio=concave_ratio)
    frame = (-width, -height, 2 * width, 2 * height)
    left, top, right, bottom = shapely.bounds(hull).tolist()
    if left < frame[0] or top < frame[1] or right > frame[2] or bottom > frame[3]:  # never for an empty one, all NaN
        hull = max(shapely.get_parts(shapely.clip_by_rect(hull, *frame)), key=lambda part: part.area, default=hull)
    return hull if isinstance(hull, Polygon) and not hull.is_empty else None


def trace_polygon(covered: NDArray[np.bool_], corner: NDArray[np.int64]) -> Outline | None:
    """The polygon around covered pixels, a quarter of a pixel outside of their centres; of several parts where they do
    not touch.

    Args:
        covered: (rows, columns) bool, of a window.
        corner: (2,) int64, (u, v) of the window's first pixel.

    Returns:
        None where no pixel is covered.
    """
    fine = np.repeat(np.repeat(_without_touching_corners(covered), 2, axis=0), 2, axis=1).view(np.uint8)
    rings, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if not len(rings):
        return None
    outlines = [ring[:, 0] / 2 - 0.25 + corner for ring in rings]
    parents = tree[0, :, 3].tolist()
    parts = [
        Polygon(outline, [outlines[hole] for hole, parent in enumerate(parents) if parent == number])
        for number, outline in enumerate(outlines)
        if parents[number] < 0
    ]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _without_touching_corners(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill the upper one of two gaps where pixels meet at a corner only: there the outline would touch itself."""
    joined = covered.copy()
    upper_left, upper_right = joined[:-1, :-1], joined[:-1, 1:]
    lower_left, lower_right = joined[1:, :-1], joined[1:, 1:]
    while True:
        falling = upper_left & lower_right & ~upper_right & ~lower_left
        rising = upper_right & lower_left & ~upper_left & ~lower_right
        if not (falling.any() or rising.any()):
            return joined
        upper_right |= falling
        upper_left |= rising

"""From pixels to the polygon around them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from bench.records.reference import Outline


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
    outlines: list[Any] = [shapely.linearrings(ring[:, 0] / 2 - 0.25 + corner) for ring in rings]
    parents = tree[0, :, 3].tolist()
    parts: list[Polygon] = [
        shapely.polygons(outline, [outlines[hole] for hole, parent in enumerate(parents) if parent == number] or None)
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

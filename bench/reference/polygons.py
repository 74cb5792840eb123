"""From a polygon to pixels, and from pixels to a polygon."""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from bench.records.reference import Outline

FROM, TO = slice(None, -1), slice(1, None)  # the ends of a ring's edges


class Raster(NamedTuple):
    """Pixels of an image.

    Attributes:
        window: rows and columns of the image that hold them all; may be empty.
        covered: (rows, columns) bool, of the window.
    """

    window: tuple[slice, slice]
    covered: NDArray[np.bool_]


def rasterise(polygon: Outline, *, width: int, height: int) -> Raster:
    """Pixels whose centre lies in a polygon.

    Exact, by the crossings of every row of pixel centres with the polygon's edges. OpenCV's `fillPoly` adds the outline
    and is off by a pixel where edges are cut by the border.

    Args:
        polygon: in pixels (u, v); holes stay open.
        width: of the image, px.
        height: of the image, px.
    """
    left, top, right, bottom = polygon.bounds
    u0, u1 = max(ceil(left), 0), min(floor(right) + 1, width)
    v0, v1 = max(ceil(top), 0), min(floor(bottom) + 1, height)
    columns, rows = max(u1 - u0, 0), max(v1 - v0, 0)
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(polygon))]
    (start_u, start_v), (end_u, end_v) = (np.concatenate([ring[part] for ring in rings]).T for part in (FROM, TO))
    u, v = np.arange(u0, u0 + columns, dtype=np.float64), np.arange(v0, v0 + rows)[:, None]
    row, edge = np.nonzero((v >= start_v) != (v >= end_v))
    share = (row + v0 - start_v[edge]) / (end_v[edge] - start_v[edge])
    crossings_u = start_u[edge] + share * (end_u[edge] - start_u[edge])
    covered = np.zeros((rows, columns), dtype=bool)
    for crossing_u in _by_order(crossings_u, row, rows):
        covered ^= u >= crossing_u[:, None]  # inside, right of an odd number of them
    return Raster((slice(v0, v0 + rows), slice(u0, u0 + columns)), covered)


def _by_order(values: NDArray[np.float64], row: NDArray[np.intp], rows: int) -> NDArray[np.float64]:
    """(most, rows): the first value of every row, the second, and so on, for rows that ascend; infinite where none."""
    order = np.arange(len(row)) - np.searchsorted(row, row)
    table = np.full((order.max(initial=-1) + 1, rows), np.inf)
    table[order, row] = values
    return table


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

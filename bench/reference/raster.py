"""From a polygon to the pixels of an image."""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

FROM, TO = slice(None, -1), slice(1, None)  # the ends of a ring's edges


class Raster(NamedTuple):
    """Pixels of an image.

    Attributes:
        window: rows and columns of the image that hold them all; may be empty.
        covered: (rows, columns) bool, of the window.
    """

    window: tuple[slice, slice]
    covered: NDArray[np.bool_]


def rasterise(polygon: Polygon | MultiPolygon, *, width: int, height: int) -> Raster:
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

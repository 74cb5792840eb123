"""From projected points to a polygon, and from a polygon to pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from bench.errors import UsageError

FROM, TO = slice(None, -1), slice(1, None)  # the ends of a ring's edges


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
        raise UsageError(f"polygon kind: wanted 'convex' or 'concave', came {kind!r}")
    row = LineString(pixels)  # the hulls take its corners; ten times faster to build than a MultiPoint
    hull = row.convex_hull if kind == "convex" else shapely.concave_hull(row, ratio=concave_ratio)
    frame = (-width, -height, 2 * width, 2 * height)
    if not hull.is_empty and not shapely.box(*frame).contains(hull):
        hull = max(shapely.get_parts(shapely.clip_by_rect(hull, *frame)), key=lambda part: part.area, default=hull)
    return hull if isinstance(hull, Polygon) and not hull.is_empty else None


class Raster(NamedTuple):
    """Pixels of an image.

    Attributes:
        window: rows and columns of the image that hold them all; may be empty.
        covered: (rows, columns) bool, of the window.
    """

    window: tuple[slice, slice]
    covered: NDArray[np.bool_]


def rasterise(polygon: Polygon, *, width: int, height: int) -> Raster:
    """Pixels whose centre lies in a polygon.

    Exact, by the crossings of every row of pixel centres with the polygon's edges. OpenCV's `fillPoly` adds the outline
    and is off by a pixel where edges are cut by the border.

    Args:
        polygon: in pixels (u, v); holes stay open.
        width: of the image, px.
        height: of the image, px.
    """
    left, top, right, bottom = polygon.bounds
    u0, u1 = max(int(np.ceil(left)), 0), min(int(np.floor(right)) + 1, width)
    v0, v1 = max(int(np.ceil(top)), 0), min(int(np.floor(bottom)) + 1, height)
    columns, rows = max(u1 - u0, 0), max(v1 - v0, 0)
    rings = [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
    (start_u, start_v), (end_u, end_v) = (np.concatenate([ring[part] for ring in rings]).T for part in (FROM, TO))
    v = np.arange(v0, v0 + rows)[:, None]
    row, edge = np.nonzero((v >= start_v) != (v >= end_v))
    share = (row + v0 - start_v[edge]) / (end_v[edge] - start_v[edge])
    crossing_u = start_u[edge] + share * (end_u[edge] - start_u[edge])
    first = np.clip(np.ceil(crossing_u) - u0, 0, columns).astype(np.int64)  # corners may lie very far off
    switches = np.bincount(row * (columns + 1) + first, minlength=rows * (columns + 1)).reshape(rows, columns + 1)
    covered = np.cumsum(switches, axis=1)[:, :columns] % 2 == 1
    return Raster((slice(v0, v0 + rows), slice(u0, u0 + columns)), covered)

"""The union of surface patches in the image, as one polygon."""

from __future__ import annotations

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

SLIT = np.ones((3, 3), dtype=np.uint8)  # closes what is a pixel wide: finer than a beam's own footprint
HAIR_PX = 1e-3  # width of the link between parts that the lidar sees apart, so that a reference is one polygon
MARGIN_PX = 4


def footprint_polygon(
    patches_px: NDArray[np.float64], *, width: int, height: int, solid: bool = False
) -> Polygon | None:
    """The polygon of all pixels whose centre lies in a patch.

    Separate parts (the head over a parked car and the feet under it) are linked by a hair.

    Args:
        patches_px: (N, 4, 2) float64, px, corners of each patch in order, finite.
        width: of the image, px.
        height: of the image, px.
        solid: close holes, for bodies that cannot be looked through, whose windows and dark paint send nothing back;
            else they stay open.

    Returns:
        The polygon, which may reach a few pixels beyond the image; None where no pixel is
        covered.
    """
    if not len(patches_px):
        return None
    covered, corner = patch_pixels(patches_px, width=width, height=height)
    closed = cv2.morphologyEx(np.pad(covered, 1).view(np.uint8), cv2.MORPH_CLOSE, SLIT)
    polygon = traced_polygon(closed > 0, corner - 1)
    return Polygon(polygon.exterior) if solid and polygon is not None else polygon


def patch_pixels(
    patches_px: NDArray[np.float64], *, width: int, height: int
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Pixels whose centre lies in any of many convex patches, in one pass over all edges.

    Every edge adds one to the pixels right of it where it runs down and takes one away where it runs up; with all
    patches turned the same way round, what is not zero is inside of one.

    Args:
        patches_px: (N, 4, 2) float64, px, N >= 1.
        width: of the image, px.
        height: of the image, px.

    Returns:
        covered: (rows, columns) bool, of a window.
        corner: (2,) int64, (u, v) of the window's first pixel.
    """
    beyond = np.array([width, height]) + MARGIN_PX
    u, v = patches_px[:, :, 0], patches_px[:, :, 1]
    low = np.clip(np.floor([u.min(), v.min()]), -MARGIN_PX, beyond).astype(np.int64)
    high = np.clip(np.ceil([u.max(), v.max()]) + 1, -MARGIN_PX, beyond).astype(np.int64)
    columns, rows = (high - low).tolist()
    start_u, start_v = (u - low[0]).ravel(), (v - low[1]).ravel()
    end_u, end_v = ((np.roll(side, -1, axis=1) - first).ravel() for side, first in ((u, low[0]), (v, low[1])))
    turn = np.sign((u[:, 2] - u[:, 0]) * (v[:, 3] - v[:, 1]) - (v[:, 2] - v[:, 0]) * (u[:, 3] - u[:, 1]))
    first = np.clip(np.ceil(np.minimum(start_v, end_v)), 0, rows).astype(np.int64)
    count = np.clip(np.ceil(np.maximum(start_v, end_v)), 0, rows).astype(np.int64) - first
    edge = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    share = (row - start_v[edge]) / (end_v[edge] - start_v[edge])
    crossing_u = start_u[edge] + share * (end_u[edge] - start_u[edge])
    column = np.clip(np.ceil(crossing_u), 0, columns).astype(np.int64)
    sign = np.where(end_v > start_v, 1.0, -1.0) * np.repeat(turn, 4)
    changes = np.bincount(row * (columns + 1) + column, weights=sign[edge], minlength=rows * (columns + 1))
    depth = np.cumsum(changes.reshape(rows, columns + 1), axis=1)[:, :columns]
    return np.abs(depth) > 0.5, low


def traced_polygon(covered: NDArray[np.bool_], corner: NDArray[np.int64]) -> Polygon | None:
    """The polygon around covered pixels, a quarter of a pixel outside of their centres; its parts linked by a hair.

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
    return _linked(sorted(parts, key=lambda part: -part.area))


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


def _linked(parts: list[Polygon]) -> Polygon:
    """One polygon of several, the largest first."""
    whole = parts[0]
    for part in parts[1:]:
        hair = shapely.shortest_line(whole, part).buffer(HAIR_PX, quad_segs=1)
        united = shapely.union_all([whole, part, hair])
        whole = united if isinstance(united, Polygon) else whole
    return whole

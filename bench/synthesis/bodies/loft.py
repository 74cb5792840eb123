"""Closed surfaces through a row of rings: limbs, trunks, car bodies, tyres."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.geometry import cross, dot
from bench.synthesis.mesh import Mesh, Surface, surfaced

Paint = tuple[slice, slice, Surface]  # cells of a loft: steps between rings, steps along a ring, what they look like
UP = np.array([0.0, 0.0, 1.0])
SMALLEST_M2 = 1e-10  # a triangle below it has two corners in one place


def loft(rings_m: ArrayLike, surface: Surface, *, paint: Sequence[Paint] = (), loop: bool = False) -> Mesh:
    """A surface through rings, closed at both ends.

    Args:
        rings_m: (R, K, 3), m; every ring runs the same way round. Neighbours may coincide.
        surface: of every cell that is not painted otherwise, and of the ends.
        paint: cells that look different; the last one that holds a cell decides.
        loop: the last ring leads back to the first, as in a tyre.
    """
    rings = np.asarray(rings_m, dtype=np.float64)
    count, around, _ = rings.shape
    wearing = np.zeros((count if loop else count - 1, around), dtype=np.intp)
    for number, (steps, along, _) in enumerate(paint, start=1):
        wearing[steps, along] = number
    worn = np.append(np.repeat(wearing.ravel(), 2), np.zeros(0 if loop else 2 * around, dtype=np.intp))
    middles = rings[[0, -1]].mean(axis=1)
    corners = np.concatenate([rings.reshape(-1, 3), middles])[_faces(count, around, loop)]
    kept = _doubled_areas_m2(corners) > SMALLEST_M2
    corners, worn = corners[kept], worn[kept]
    if dot(corners[:, 0], cross(corners[:, 1], corners[:, 2])).sum() < 0:
        corners = corners[:, ::-1]
    return surfaced(corners, [surface, *(looks for _, _, looks in paint)], worn)


@cache
def _faces(count: int, around: int, loop: bool) -> NDArray[np.intp]:
    """Corners of the triangles, (T, 3) rows of all rings in order, then of the middles of the first and the last."""
    rows = np.arange(count * around).reshape(count, around)
    near, far = (rows, np.roll(rows, -1, axis=0)) if loop else (rows[:-1], rows[1:])
    near_next, far_next = np.roll(near, -1, axis=1), np.roll(far, -1, axis=1)
    faces = np.stack([near, near_next, far_next, near, far_next, far], axis=2).reshape(-1, 3)
    if loop:
        return faces
    ends = ((rows[0][::-1], rows.size), (rows[-1], rows.size + 1))
    fans = [np.stack([np.full(around, middle), rim, np.roll(rim, -1)], axis=1) for rim, middle in ends]
    return np.concatenate([faces, *fans])


def ellipses(levels_m: ArrayLike, *, sides: int = 10) -> NDArray[np.float64]:
    """Level rings on top of each other, for `loft`.

    Args:
        levels_m: (R, 5), m: middle (x, y, z), half depth along x, half width along y.
        sides: corners of a ring.

    Returns:
        (R, sides, 3) float64, m.
    """
    levels = np.asarray(levels_m, dtype=np.float64)
    angles = (np.arange(sides) + 0.5) * (2 * np.pi / sides)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    flat = levels[:, None, :2] + ring * levels[:, None, 3:]
    heights = np.broadcast_to(levels[:, None, 2:3], (*flat.shape[:2], 1))
    return np.concatenate([flat, heights], axis=2)


def rounded(middle_m: ArrayLike, radii_m: ArrayLike, surface: Surface, *, sides: int = 10, rows: int = 7) -> Mesh:
    """An ellipsoid along the axes."""
    (x, y, z), (depth, width, height) = np.asarray(middle_m, dtype=np.float64), np.asarray(radii_m, dtype=np.float64)
    tilts = np.linspace(-np.pi / 2, np.pi / 2, rows + 2)[1:-1]
    levels = [(x, y, z + height * np.sin(t), depth * np.cos(t), width * np.cos(t)) for t in tilts]
    return loft(ellipses(levels, sides=sides), surface)


def limb(top_m: ArrayLike, bottom_m: ArrayLike, radii_m: Sequence[float], surface: Surface, *, sides: int = 8) -> Mesh:
    """A rounded limb that hangs down, its radii spread evenly from its top to its bottom."""
    top, bottom = np.asarray(top_m, dtype=np.float64), np.asarray(bottom_m, dtype=np.float64)
    shares = np.linspace(0, 1, len(radii_m))
    ends = [
        (top + 0.6 * radii_m[0] * UP, 0.55 * radii_m[0]),
        (bottom - 0.6 * radii_m[-1] * UP, 0.55 * radii_m[-1]),
    ]
    middle = [(top + share * (bottom - top), radius) for share, radius in zip(shares, radii_m, strict=True)]
    levels = [(*place, radius, radius) for place, radius in (ends[0], *middle, ends[1])]
    return loft(ellipses(levels, sides=sides), surface)


def ring(middle_m: ArrayLike, radius_m: float, thickness_m: float, surface: Surface, *, sides: int = 20) -> Mesh:
    """A tyre about an axis along y, to be looked through; its section is a square on its edge."""
    turns = np.arange(sides) * (2 * np.pi / sides)
    section = np.array([(radius_m, 0.0), (radius_m - thickness_m, thickness_m), (radius_m - 2 * thickness_m, 0.0),
                        (radius_m - thickness_m, -thickness_m)])  # fmt: skip
    away = np.stack([np.sin(turns), np.zeros(sides), np.cos(turns)], axis=1)
    rings = away[:, None, :] * section[None, :, :1] + section[None, :, 1:] * np.array([0.0, 1.0, 0.0])
    return loft(rings + np.asarray(middle_m, dtype=np.float64), surface, loop=True)


def _doubled_areas_m2(corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    sides = cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    return np.asarray(np.linalg.norm(sides, axis=1))

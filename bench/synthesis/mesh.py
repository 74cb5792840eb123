"""Triangles with a surface: the solids that everything is built from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from bench.geometry import RigidTransform, cross, dot, normalise

AXES_BESIDE = np.array([[1, 2], [0, 2], [0, 1]])[:, None, :]  # the two axes that are not the k-th
# The box around (-1, -1, -1) to (1, 1, 1); its faces, each anticlockwise from outside.
BOX_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
BOX_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """Appearance of a face.

    Attributes:
        albedo: mean reflectance, 0 to 1.
        contrast: standard deviation of the texture relative to the albedo.
        texel_m: size of the finest texture detail, m.
        mirror: share of the light that is reflected as by a mirror when looked at squarely; 0.04 for glass.
        glow: what it shines by itself, 1 as bright as white paper by day: lamps.
        sky: part of the sky, whose brightness the recording's light decides.
    """

    albedo: float
    contrast: float
    texel_m: float = 0.008
    mirror: float = 0.0
    glow: float = 0.0
    sky: bool = False

    @property
    def row(self) -> tuple[float, ...]:
        """Its row in `Mesh.surfaces`."""
        return self.albedo, self.contrast, self.texel_m, self.mirror, self.glow, float(self.sky)


COLUMN_OF = {field.name: column for column, field in enumerate(fields(Surface))}  # of `Mesh.surfaces`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles that share nothing, so that meshes join and move without bookkeeping.

    Attributes:
        corners_m: (T, 3, 3) float64, m, the corners of each triangle; anticlockwise seen from outside.
        texture_m: (T, 3, 2) float64, m, texture coordinates of the corners.
        surfaces: (T, 6) float64, columns as the fields of `Surface`.
    """

    corners_m: NDArray[np.float64]
    texture_m: NDArray[np.float64]
    surfaces: NDArray[np.float64]

    def moved(self, a_from_b: RigidTransform) -> Mesh:
        """Return the mesh in frame a; the texture stays on its faces."""
        moved_m = a_from_b.apply(self.corners_m.reshape(-1, 3)).reshape(-1, 3, 3)
        return Mesh(corners_m=moved_m, texture_m=self.texture_m, surfaces=self.surfaces)

    def select(self, mask: NDArray[np.bool_]) -> Mesh:
        """Some of its triangles: (T,) bool."""
        return Mesh(corners_m=self.corners_m[mask], texture_m=self.texture_m[mask], surfaces=self.surfaces[mask])

    def with_texture_shift(self, shift_m: ArrayLike) -> Mesh:
        """Return the mesh with its texture taken from elsewhere, so that two bodies look different."""
        shifted_m = self.texture_m + np.asarray(shift_m, dtype=np.float64)
        return Mesh(corners_m=self.corners_m, texture_m=shifted_m, surfaces=self.surfaces)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedMesh:
    """A mesh where it is at some time.

    Attributes:
        mesh: world frame.
        instance_id: in truth images; 0 for the static world.
    """

    mesh: Mesh
    instance_id: int = 0


def joined(*meshes: Mesh) -> Mesh:
    """All triangles of several meshes, in order; none at all if there are none."""
    if not meshes:
        return surfaced(np.empty((0, 3, 3)), Surface(albedo=0.0, contrast=0.0))
    return Mesh(
        corners_m=np.concatenate([mesh.corners_m for mesh in meshes]),
        texture_m=np.concatenate([mesh.texture_m for mesh in meshes]),
        surfaces=np.concatenate([mesh.surfaces for mesh in meshes]),
    )


def convex(points_m: ArrayLike, surface: Surface) -> Mesh:
    """The convex body around points.

    Args:
        points_m: (N, 3), m, N >= 4, not in one plane.
        surface: of all its faces.
    """
    points = np.asarray(points_m, dtype=np.float64)
    corners = points[ConvexHull(points).simplices]
    outward = dot(
        cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0] - points.mean(axis=0)
    )
    corners[outward < 0] = corners[outward < 0][:, ::-1]
    return surfaced(corners, surface)


def quads(
    corners_m: ArrayLike, surface: Surface, *, albedos: ArrayLike | None = None, shifts_m: ArrayLike | None = None
) -> Mesh:
    """Many flat patches at once.

    Args:
        corners_m: (N, 4, 3), m, each anticlockwise seen from the side that faces outwards.
        surface: of all of them.
        albedos: (N,), instead of the surface's.
        shifts_m: (N, 2), m, where each patch takes its texture from, so that all look different.
    """
    corners = np.asarray(corners_m, dtype=np.float64).reshape(-1, 4, 3)
    mesh = surfaced(corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3), surface)
    if albedos is not None:
        mesh.surfaces[:, 0] = np.repeat(np.asarray(albedos, dtype=np.float64), 2)
    if shifts_m is not None:
        mesh = mesh.with_texture_shift(np.repeat(np.asarray(shifts_m, dtype=np.float64), 2, axis=0)[:, None, :])
    return mesh


def surfaced(
    corners_m: NDArray[np.float64], surfaces: Surface | Sequence[Surface], choice: NDArray[np.intp] | None = None
) -> Mesh:
    """Triangles, the texture laid on each along the two axes that it faces least.

    Args:
        corners_m: (T, 3, 3) float64, m, anticlockwise seen from outside.
        surfaces: of all of them, or several to choose from.
        choice: (T,) row of the surface that each triangle has.
    """
    one_m, two_m = corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0]
    beside = AXES_BESIDE[np.abs(cross(one_m, two_m)).argmax(axis=1)]
    texture_m = corners_m[np.arange(len(corners_m))[:, None, None], np.arange(3)[:, None], beside]
    if isinstance(surfaces, Surface):
        rows = np.empty((len(corners_m), len(surfaces.row)))
        rows[:] = surfaces.row
    else:
        rows = np.array([surface.row for surface in surfaces])[choice]
    return Mesh(corners_m=corners_m, texture_m=texture_m, surfaces=rows)


def box(size_m: ArrayLike, centre_m: ArrayLike, surface: Surface) -> Mesh:
    """A box along the axes."""
    corners = BOX_CORNERS * (np.asarray(size_m, dtype=np.float64) / 2) + np.asarray(centre_m, dtype=np.float64)
    return quads(corners[BOX_FACES], surface)


def slab(profile_xz_m: ArrayLike, half_width_m: float | ArrayLike, surface: Surface) -> Mesh:
    """A side view drawn out to both sides; `half_width_m` may differ from point to point.

    Args:
        profile_xz_m: (N, 2), m, x and z of a convex outline.
        half_width_m: one number or (N,), m.
        surface: of all its faces.
    """
    profile = np.asarray(profile_xz_m, dtype=np.float64)
    half = np.broadcast_to(np.asarray(half_width_m, dtype=np.float64), len(profile))
    right = np.column_stack([profile[:, 0], -half, profile[:, 1]])
    left = np.column_stack([profile[:, 0], half, profile[:, 1]])
    return convex(np.concatenate([right, left]), surface)


def tube(start_m: ArrayLike, end_m: ArrayLike, radius_m: float, surface: Surface, *, sides: int = 8) -> Mesh:
    """A round bar."""
    start, end = np.asarray(start_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
    along = normalise(end - start)
    aside = normalise(cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    angles = np.arange(sides) * (2 * np.pi / sides)
    ring = radius_m * (np.outer(np.cos(angles), aside) + np.outer(np.sin(angles), cross(along, aside)))
    return prism(start + ring, end + ring, surface)


def prism(start_m: NDArray[np.float64], end_m: NDArray[np.float64], surface: Surface) -> Mesh:
    """The body between two outlines of as many corners, each convex and flat; or many such bodies.

    Args:
        start_m: (..., K, 3) float64, m, anticlockwise seen from the end.
        end_m: (..., K, 3) float64, m, each corner opposite its own of the start.
        surface: of all its faces.
    """
    corners = np.concatenate([start_m, end_m], axis=-2)[..., _prism_faces(start_m.shape[-2]), :]
    return surfaced(corners.reshape(-1, 3, 3), surface)


@cache
def _prism_faces(sides: int) -> NDArray[np.intp]:
    """Corners of a prism's triangles, (T, 3): rows of its start, then of its end."""
    low, high = np.arange(sides), np.arange(sides) + sides
    low_next, high_next = np.roll(low, -1), np.roll(high, -1)
    walls = np.stack([low, low_next, high_next, low, high_next, high], axis=1).reshape(-1, 3)
    fan = np.arange(1, sides - 1)
    lid = np.stack([np.zeros_like(fan), fan, fan + 1], axis=1)
    return np.concatenate([walls, lid[:, ::-1], sides + lid])


Paint = tuple[slice, slice, Surface]  # cells of a loft: steps between rings, steps along a ring, what they look like
UP = np.array([0.0, 0.0, 1.0])
SMALLEST_M2 = 1e-10  # a triangle below it has two corners at one point


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
    chosen = np.zeros((count if loop else count - 1, around), dtype=np.intp)
    for number, (steps, along, _) in enumerate(paint, start=1):
        chosen[steps, along] = number
    choice = np.append(np.repeat(chosen.ravel(), 2), np.zeros(0 if loop else 2 * around, dtype=np.intp))
    middles = rings[[0, -1]].mean(axis=1)
    corners = np.concatenate([rings.reshape(-1, 3), middles])[_faces(count, around, loop)]
    mask = _doubled_areas_m2(corners) > SMALLEST_M2
    corners, choice = corners[mask], choice[mask]
    if dot(corners[:, 0], cross(corners[:, 1], corners[:, 2])).sum() < 0:
        corners = corners[:, ::-1]
    return surfaced(corners, [surface, *(looks for _, _, looks in paint)], choice)


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
    levels = [(*point, radius, radius) for point, radius in (ends[0], *middle, ends[1])]
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

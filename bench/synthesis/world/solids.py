"""Materials of the street, and many simple solids at once: boxes, round posts, blobs and leaves.

Albedos are those of a picture rather than of a radiometer: 0.8 is white paint, 0.1 is rubber. Contrast is the standard
deviation of the texture at its finest level, relative to the albedo. Grey images of dry asphalt by day have a standard
deviation of 8 to 15 % of their mean once lens and pixels have averaged over several stones, of which the road at 1 to
5 m leaves about 0.8 at 640 x 480; the stones alone therefore have 0.10 to 0.17, the coarser the rougher the chippings.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from bench.synthesis.mesh import BOX_CORNERS, BOX_FACES, Mesh, Surface, joined, quads, surfaced

PAINT = Surface(albedo=0.74, contrast=0.12, texel_m=0.006)
BITUMEN = Surface(albedo=0.14, contrast=0.12, texel_m=0.006)  # sealed cracks and the rims of patches
CONCRETE = Surface(albedo=0.50, contrast=0.10, texel_m=0.006)
KERB = Surface(albedo=0.54, contrast=0.12, texel_m=0.006)
SETTS = Surface(albedo=0.36, contrast=0.18, texel_m=0.008)
CAST_IRON = Surface(albedo=0.22, contrast=0.15, texel_m=0.006)
GRASS = Surface(albedo=0.27, contrast=0.30, texel_m=0.012)
SOIL = Surface(albedo=0.22, contrast=0.25, texel_m=0.012)
BARK = Surface(albedo=0.26, contrast=0.30, texel_m=0.015)
LEAVES = Surface(albedo=0.30, contrast=0.40, texel_m=0.03)
PANE = Surface(albedo=0.12, contrast=0.35, texel_m=0.03, mirror=0.08)  # two layers of glass, 0.04 each
FRAME = Surface(albedo=0.76, contrast=0.06)
STEEL = Surface(albedo=0.44, contrast=0.10, texel_m=0.01)  # galvanised
DARK_STEEL = Surface(albedo=0.18, contrast=0.12, texel_m=0.01)
WOOD = Surface(albedo=0.38, contrast=0.25, texel_m=0.012)
SIGN_WHITE = Surface(albedo=0.86, contrast=0.03)
SIGN_RED = Surface(albedo=0.30, contrast=0.03)
SIGN_BLUE = Surface(albedo=0.26, contrast=0.03)
# Glow is in units of white paper by day, some 10,000 cd/m2: a street lamp's lens has that, a lit room's window 40.
LAMP_LENS = Surface(albedo=0.85, contrast=0.02, glow=1.0)
LIT_PANE = replace(PANE, albedo=0.30, glow=0.004)
LIT_ADVERT = Surface(albedo=0.7, contrast=0.05, glow=0.01)
SKY = Surface(albedo=0.90, contrast=0.04, texel_m=1.5, sky=True)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # corners, anticlockwise


def drawn_asphalt(rng: np.random.Generator) -> Surface:
    """Anything from a fresh dark road to an old pale one, of fine to coarse chippings (8 or 11 mm in town)."""
    return Surface(
        albedo=float(rng.uniform(0.25, 0.40)),
        contrast=float(rng.uniform(0.10, 0.17)),
        texel_m=float(rng.uniform(0.004, 0.006)),
    )


def drawn_slabs(rng: np.random.Generator) -> Surface:
    """Concrete slabs or stone of a pavement."""
    return Surface(albedo=float(rng.uniform(0.40, 0.56)), contrast=float(rng.uniform(0.08, 0.14)), texel_m=0.006)


def drawn_wall(rng: np.random.Generator) -> Surface:
    """Plaster, brick or rough stone of a house."""
    grain = float(rng.choice([0.008, 0.015, 0.03]))
    return Surface(albedo=float(rng.uniform(0.30, 0.75)), contrast=float(rng.uniform(0.08, 0.22)), texel_m=grain)


def tinted(surface: Surface, factor: float) -> Surface:
    """The same, lighter or darker."""
    return replace(surface, albedo=float(np.clip(surface.albedo * factor, 0.02, 0.95)))


def boxes(
    centres_m: ArrayLike,
    sizes_m: ArrayLike,
    surface: Surface,
    *,
    yaws_rad: ArrayLike = 0.0,
    albedos: ArrayLike | None = None,
) -> Mesh:
    """Upright boxes: (N, 3) centres, (N, 3) sizes or one for all, (N,) yaws."""
    centres = np.asarray(centres_m, dtype=np.float64).reshape(-1, 3)
    half = np.broadcast_to(np.asarray(sizes_m, dtype=np.float64), centres.shape) / 2
    yaws = np.broadcast_to(np.asarray(yaws_rad, dtype=np.float64), len(centres))
    corners = BOX_CORNERS * half[:, None]
    faces = _rotated(corners, yaws) + centres[:, None]
    repeated = None if albedos is None else np.repeat(np.asarray(albedos), len(BOX_FACES))
    return quads(faces[:, BOX_FACES].reshape(-1, 4, 3), surface, albedos=repeated)


def posts(
    feet_m: ArrayLike, heights_m: ArrayLike, radii_m: ArrayLike, surface: Surface, *, sides: int = 7, taper: float = 1.0
) -> Mesh:
    """Upright round bars with a lid: (N, 3) feet, (N,) heights and radii, or one for all."""
    feet = np.asarray(feet_m, dtype=np.float64).reshape(-1, 3)
    heights = np.broadcast_to(np.asarray(heights_m, dtype=np.float64), len(feet))
    tops = feet + heights[:, None] * np.array([0.0, 0.0, 1.0])
    return bars(feet, tops, radii_m, surface, sides=sides, taper=taper)


def bars(
    feet_m: NDArray[np.float64],
    tops_m: NDArray[np.float64],
    radii_m: ArrayLike,
    surface: Surface,
    *,
    sides: int = 7,
    taper: float = 1.0,
) -> Mesh:
    """Round bars that rise from (N, 3) feet to (N, 3) tops, cut level at both ends, with a lid."""
    radii = np.broadcast_to(np.asarray(radii_m, dtype=np.float64), len(feet_m))
    angles = np.arange(sides + 1) * (2 * np.pi / sides)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides + 1)], axis=1)
    low = feet_m[:, None] + radii[:, None, None] * ring
    high = tops_m[:, None] + taper * radii[:, None, None] * ring
    walls = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2).reshape(-1, 4, 3)
    middle = np.broadcast_to(tops_m[:, None], (len(feet_m), sides, 3))
    lids = np.stack([middle, high[:, :-1], high[:, 1:]], axis=2).reshape(-1, 3, 3)
    return joined(quads(walls, surface), surfaced(lids, surface))


def blobs(centres_m: ArrayLike, radii_m: ArrayLike, surface: Surface, rng: np.random.Generator) -> Mesh:
    """Lumps about (N, 3) centres, of (N, 3) radii give or take a fifth."""
    centres, radii = (np.asarray(a, dtype=np.float64).reshape(-1, 1, 3) for a in (centres_m, radii_m))
    points, faces = _ball()
    lumps = points * radii * rng.uniform(0.8, 1.2, (len(centres), len(points), 1)) + centres
    return surfaced(lumps[:, faces].reshape(-1, 3, 3), surface)


def leaves(
    centres_m: NDArray[np.float64],
    radii_m: NDArray[np.float64],
    surface: Surface,
    rng: np.random.Generator,
    *,
    count: int,
    size_m: float,
) -> Mesh:
    """Small patches in all directions near the skin of ellipsoids, light and dark: what makes a crown ragged."""
    which = rng.integers(len(centres_m), size=count)
    outwards = rng.standard_normal((count, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    positions = centres_m[which] + outwards * radii_m[which] * rng.uniform(0.85, 1.3, (count, 1))
    along = np.cross(outwards, rng.standard_normal((count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(outwards, along) + 0.5 * rng.standard_normal((count, 1)) * outwards
    half = 0.5 * size_m * rng.uniform(0.6, 1.4, (count, 1))
    sides = [(-along - across), (along - across), (along + across), (across - along)]
    corners = np.stack([positions + half * side for side in sides], axis=1)
    return quads(corners, surface, albedos=surface.albedo * rng.uniform(0.55, 1.35, count))


def flat(corners_xy_m: ArrayLike, height_m: float | ArrayLike) -> NDArray[np.float64]:
    """Corners on the ground (..., 2) lifted to a height: (..., 3)."""
    corners = np.asarray(corners_xy_m, dtype=np.float64)
    height = np.broadcast_to(np.asarray(height_m, dtype=np.float64), corners.shape[:-1])
    return np.concatenate([corners, height[..., None]], axis=-1)


def fans(rims_m: ArrayLike, surface: Surface, *, albedos: ArrayLike | None = None) -> Mesh:
    """Star-shaped flat patches: (N, K, 3) rims, anticlockwise from above, about their means."""
    rims = np.asarray(rims_m, dtype=np.float64)
    middle = np.broadcast_to(rims.mean(axis=1, keepdims=True), rims.shape)
    corners = np.stack([middle, rims, np.roll(rims, -1, axis=1)], axis=2)
    mesh = surfaced(corners.reshape(-1, 3, 3), surface)
    if albedos is not None:
        mesh.surfaces[:, 0] = np.repeat(np.asarray(albedos, dtype=np.float64), rims.shape[1])
    return mesh


def _rotated(corners_m: NDArray[np.float64], yaws_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    cosine, sine = np.cos(yaws_rad)[:, None], np.sin(yaws_rad)[:, None]
    x, y, z = corners_m[..., 0], corners_m[..., 1], corners_m[..., 2]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


@cache
def _ball() -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Corners of a unit ball and its faces, anticlockwise from outside."""
    latitudes, longitudes = np.meshgrid(np.radians([-45.0, 0.0, 45.0]), np.radians([0.0, 60, 120, 180, 240, 300]))
    flat_m = np.cos(latitudes).ravel()
    ring = [flat_m * np.cos(longitudes).ravel(), flat_m * np.sin(longitudes).ravel(), np.sin(latitudes).ravel()]
    points = np.concatenate([np.stack(ring, axis=1), [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    faces = ConvexHull(points).simplices.astype(np.intp)
    a, b, c = (points[faces[:, k]] for k in range(3))
    inwards = np.einsum("ni,ni->n", np.cross(b - a, c - a), a + b + c) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return points, faces

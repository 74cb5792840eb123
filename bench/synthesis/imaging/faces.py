"""Triangles with all that their grey values follow from: texture, surface and normal.

The texture is one seamless noise in all its mip levels. Each octave has the same strength, so that a surface has
something to track at every distance; the level is chosen by the size of the pixel on the surface, so that far surfaces
become smooth instead of flickering.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled, inlined
from bench.synthesis.mesh import COLUMN_OF, Mesh

Row = tuple[np.float32, np.float32, np.float32]


@inlined
def corner_weights(
    planes: NDArray[np.float32], t: int | np.integer[Any], x: np.float32, y: np.float32, z: np.float32
) -> Row:
    """Weights of a triangle's corners for a ray, see `visibility`; their sum is 1 over the distance."""
    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
    return i, j, k


@inlined
def rows_of(matrix: NDArray[np.float32]) -> tuple[Row, Row, Row]:
    """Numbers of a (3, 3) matrix, read once: a loop that writes into arrays would read them again and again."""
    return (
        (matrix[0, 0], matrix[0, 1], matrix[0, 2]),
        (matrix[1, 0], matrix[1, 1], matrix[1, 2]),
        (matrix[2, 0], matrix[2, 1], matrix[2, 2]),
    )


@inlined
def bilinear(row: np.float32, column: np.float32, values: NDArray[np.float32]) -> np.float32:
    """The value between the four cells around a point."""
    whole_row, whole_column = np.int32(row), np.int32(column)
    a, b = row - np.float32(whole_row), column - np.float32(whole_column)
    i, j = np.uintp(whole_row), np.uintp(whole_column)
    next_i, next_j = i + np.uintp(1), j + np.uintp(1)
    upper = values[i, j] + b * (values[i, next_j] - values[i, j])
    lower = values[next_i, j] + b * (values[next_i, next_j] - values[next_i, j])
    return np.float32(upper + a * (lower - upper))


@inlined
def share_below(row: np.float32, column: np.float32, limit: np.float32, values: NDArray[np.float32]) -> np.float32:
    """Bilinear share of the four cells around a point whose value is at most a limit."""
    zero, one = np.float32(0.0), np.float32(1.0)
    whole_row, whole_column = np.int32(row), np.int32(column)
    a, b = row - np.float32(whole_row), column - np.float32(whole_column)
    i, j = np.uintp(whole_row), np.uintp(whole_column)
    next_i, next_j = i + np.uintp(1), j + np.uintp(1)
    upper = (one - b if values[i, j] <= limit else zero) + (b if values[i, next_j] <= limit else zero)
    lower = (one - b if values[next_i, j] <= limit else zero) + (b if values[next_i, next_j] <= limit else zero)
    return np.float32(upper + a * (lower - upper))


SIZE = 1024  # texels along one period of the texture
LEVELS = 9  # 1024 down to 4 texels
BORDER = 2  # texels repeated around each level, so that sampling wraps
OCTAVES = (512, 256, 128, 64, 32, 16, 8)  # lattice points along one period
HIGHEST, TOP = np.float32(LEVELS - 1.001), np.float32(BORDER - 0.5)
THIRD, TWO_THIRDS = np.float32(1 / 3), np.float32(2 / 3)
COARSE_FADE = 0.25  # asphalt and plaster are grainy rather than blotched


class TextureAtlas(NamedTuple):
    """All mip levels beside each other in one image.

    Attributes:
        image: float32, mean 0, standard deviation 1 at the finest level.
        layout: (LEVELS, 2) float32: column of each level's first texel, and its texels along one period; all levels
            start in row `BORDER`.
    """

    image: NDArray[np.float32]
    layout: NDArray[np.float32]


@inlined
def quick_log2(value: np.float32) -> np.float32:
    """Logarithm of a positive number to base 2, within a hundredth: enough to choose a level."""
    bits = np.float32(value).view(np.int32)
    mantissa = np.int32((bits & 0x7FFFFF) | 0x3F800000).view(np.float32)
    return np.float32(np.int32((bits >> 23) - 128)) + (np.float32(2.0) - mantissa * THIRD) * mantissa - TWO_THIRDS


@inlined
def atlas_at(u: np.float32, v: np.float32, level: np.float32, atlas: TextureAtlas) -> np.float32:
    """The texture at one point: between four texels of each of two levels."""
    u -= np.floor(u)
    v -= np.floor(v)
    level = min(max(level, np.float32(0.0)), HIGHEST)
    whole = np.int32(level)
    share, lower = level - np.float32(whole), np.uintp(whole)
    fine = _texel(u, v, lower, atlas)
    return fine + share * (_texel(u, v, lower + np.uintp(1), atlas) - fine)


@inlined
def _texel(u: np.float32, v: np.float32, level: np.uintp, atlas: TextureAtlas) -> np.float32:
    column = u * atlas.layout[level, 1] + atlas.layout[level, 0]
    row = v * atlas.layout[level, 1] + TOP
    return bilinear(row, column, atlas.image)


@cache
def texture_atlas(seed: int) -> TextureAtlas:
    """The atlas of a seed: the same for every recording of a scenario."""
    level = _noise(np.random.default_rng(seed))
    widths = [(SIZE >> k) + 2 * BORDER for k in range(LEVELS)]
    image = np.zeros((SIZE + 2 * BORDER, sum(widths)), dtype=np.float32)
    lefts = np.concatenate([[0], np.cumsum(widths)[:-1]])
    for left in lefts:
        wrapped = np.pad(level, BORDER, mode="wrap")
        image[: wrapped.shape[0], left : left + wrapped.shape[1]] = wrapped
        level = level.reshape(level.shape[0] // 2, 2, level.shape[1] // 2, 2).mean(axis=(1, 3))
    # Texel k covers [k, k + 1) of its level: its centre lies half a texel in.
    layout = np.stack([lefts + BORDER - 0.5, SIZE / 2.0 ** np.arange(LEVELS)], axis=1).astype(np.float32)
    return TextureAtlas(image, layout)


def _noise(rng: np.random.Generator) -> NDArray[np.float32]:
    total = np.zeros((SIZE, SIZE), dtype=np.float32)
    for points in OCTAVES:
        lattice = np.pad(rng.standard_normal((points, points), dtype=np.float32), 4, mode="wrap")
        factor = SIZE // points
        fine = cv2.resize(lattice, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        octave = fine[4 * factor : -4 * factor, 4 * factor : -4 * factor]
        total += octave / octave.std(dtype=np.float64) * (points / OCTAVES[0]) ** COARSE_FADE
    return np.asarray(total / total.std(dtype=np.float64), dtype=np.float32)


# Columns of a face's row, one cache line of 16 numbers.
FIRST_U, FIRST_V, STEP_U, STEP_V, LAST_U, LAST_V = range(6)  # texture of the first corner, and steps to the others
CONTRAST, TEXEL_LOG2, ALBEDO, MIRROR, GLOW = range(6, 11)
NORMAL_X, NORMAL_Y, NORMAL_Z, PLAIN = range(11, 15)  # world; PLAIN distinguishes faces with an edge worth smoothing
COLUMNS = 16
FROM_ABOVE = (0.18, 0.11, 0.30)  # change of PLAIN with the normal: a light of no particular kind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Faces:
    """A mesh, ready to be drawn and shaded.

    Attributes:
        corners_m: (T, 3, 3) float64, m, world.
        rows: (T, 16) float32, columns as above.
    """

    corners_m: NDArray[np.float64]
    rows: NDArray[np.float32]


def faces_of(mesh: Mesh) -> Faces:
    """All faces of a mesh but those of the sky, which the light draws."""
    drawn = mesh.surfaces[:, COLUMN_OF["sky"]] == 0
    corners, surfaces = mesh.corners_m[drawn], mesh.surfaces[drawn]
    albedo, contrast, texel_m, mirror, glow, _ = surfaces.T
    texture = mesh.texture_m[drawn] / (texel_m * SIZE)[:, None, None]
    rows = np.zeros((len(corners), COLUMNS), dtype=np.float32)
    rows[:, FIRST_U : FIRST_V + 1] = texture[:, 0] - np.floor(texture[:, 0])
    rows[:, STEP_U : STEP_V + 1] = texture[:, 1] - texture[:, 0]
    rows[:, LAST_U : LAST_V + 1] = texture[:, 2] - texture[:, 0]
    rows[:, CONTRAST], rows[:, TEXEL_LOG2], rows[:, ALBEDO] = contrast, np.log2(texel_m), albedo
    rows[:, MIRROR], rows[:, GLOW] = mirror, glow
    corners = np.ascontiguousarray(corners)
    face(corners, rows)
    return Faces(corners_m=corners, rows=rows)


class FacesOfBodies:
    """The faces of bodies that move: surfaces are looked up once, normals every time.

    Args:
        lit: whether their lamps are on.
    """

    def __init__(self, *, lit: bool) -> None:
        self._lit = lit
        self._known: dict[int, tuple[Mesh, NDArray[np.float32]]] = {}

    def at(self, meshes: Sequence[Mesh]) -> list[Faces]:
        """The faces of each mesh, wherever it is."""
        return [self._faces(number, mesh) for number, mesh in enumerate(meshes)]

    def _faces(self, number: int, mesh: Mesh) -> Faces:
        known = self._known.get(number)
        if known is not None and known[0].surfaces is mesh.surfaces and known[0].texture_m is mesh.texture_m:
            faces = Faces(corners_m=np.ascontiguousarray(mesh.corners_m), rows=known[1])
        else:
            faces = faces_of(mesh)
            if not self._lit:
                faces.rows[:, GLOW] = 0.0
            self._known[number] = mesh, faces.rows
        face(faces.corners_m, faces.rows)
        return faces


@compiled
def face(corners: NDArray[np.float64], rows: NDArray[np.float32]) -> None:
    """Fill in normals and what follows from them.

    Args:
        corners: (T, 3, 3), m, world.
        rows: (T, 16), with all other columns; changed.
    """
    for t in range(len(corners)):
        x, y, z = corners[t, 0, 0], corners[t, 0, 1], corners[t, 0, 2]
        bx, by, bz = corners[t, 1, 0] - x, corners[t, 1, 1] - y, corners[t, 1, 2] - z
        cx, cy, cz = corners[t, 2, 0] - x, corners[t, 2, 1] - y, corners[t, 2, 2] - z
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        if size > 0.0:
            nx, ny, nz = nx / size, ny / size, nz / size
        rows[t, NORMAL_X], rows[t, NORMAL_Y], rows[t, NORMAL_Z] = nx, ny, nz
        above = FROM_ABOVE[0] * nx + FROM_ABOVE[1] * ny + FROM_ABOVE[2] * nz
        rows[t, PLAIN] = rows[t, ALBEDO] * (0.7 + above) + rows[t, MIRROR] + rows[t, GLOW]

"""Triangles with all that their grey values follow from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled
from bench.synthesis.imaging.textures import SIZE
from bench.synthesis.mesh import COLUMN_OF, Mesh

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

"""Triangles with all that their grey values follow from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.textures import SIZE
from bench.synthesis.mesh import Mesh, face_normals

# Columns of a face's row, one cache line of 16 numbers.
FIRST_U, FIRST_V, STEP_U, STEP_V, LAST_U, LAST_V = range(6)  # texture of the first corner, and steps to the others
CONTRAST, TEXEL_LOG2, ALBEDO, MIRROR, GLOW = range(6, 11)
NORMAL_X, NORMAL_Y, NORMAL_Z, PLAIN = range(11, 15)  # world; PLAIN tells faces apart that are worth an edge
COLUMNS = 16
FROM_ABOVE = np.array([0.18, 0.11, 0.30])  # change of PLAIN with the normal: a light of no particular kind


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
    kept = mesh.surfaces[:, 5] == 0
    corners, surfaces = mesh.corners_m[kept], mesh.surfaces[kept]
    albedo, contrast, texel_m, mirror, glow, _ = surfaces.T
    texture = mesh.texture_m[kept] / (texel_m * SIZE)[:, None, None]
    rows = np.zeros((len(corners), COLUMNS), dtype=np.float32)
    rows[:, FIRST_U : FIRST_V + 1] = texture[:, 0] - np.floor(texture[:, 0])
    rows[:, STEP_U : STEP_V + 1] = texture[:, 1] - texture[:, 0]
    rows[:, LAST_U : LAST_V + 1] = texture[:, 2] - texture[:, 0]
    rows[:, CONTRAST], rows[:, TEXEL_LOG2], rows[:, ALBEDO] = contrast, np.log2(texel_m), albedo
    rows[:, MIRROR], rows[:, GLOW] = mirror, glow
    normals = face_normals(corners)
    rows[:, NORMAL_X : NORMAL_Z + 1] = normals
    rows[:, PLAIN] = albedo * (0.7 + normals @ FROM_ABOVE) + mirror + glow
    return Faces(corners_m=np.ascontiguousarray(corners), rows=rows)

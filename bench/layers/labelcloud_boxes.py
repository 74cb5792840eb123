"""The boxes of labelCloud in its three ways of writing them.

`centroid_abs` tells angles in degrees from 0 to 360, `centroid_rel` in radians from -pi to pi; both turn about x first,
then about the fixed y, then about the fixed z. `vertices` tells eight corners: 0 to 3 below and 4 to 7 above them, from
the corner of smallest x and y against the length (x), along the width (y): 0 (-, -), 1 (-, +), 2 (+, +), 3 (+, -).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.layers.tool_model import Length, ToolModel, Vector

Way = Literal["centroid_rel", "centroid_abs", "vertices"]
WAYS: tuple[Way, ...] = ("centroid_rel", "centroid_abs", "vertices")
CORNERS = np.array(
    [[-1, -1, -1], [-1, 1, -1], [1, 1, -1], [1, -1, -1], [-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]],
    dtype=np.float64,
)
LARGEST_SLANT = 1e-3  # of the edges of a box: labelCloud rounds to as few as three decimals where it is told to


class Dimensions(ToolModel):
    """Full sizes, m."""

    length: Length = Field(gt=0)
    width: Length = Field(gt=0)
    height: Length = Field(gt=0)


class CentroidObject(ToolModel):
    """A box by its middle, sizes and angles."""

    name: str = Field(min_length=1)
    centroid: Vector
    dimensions: Dimensions
    rotations: Vector


class VerticesObject(ToolModel):
    """A box by its corners."""

    name: str = Field(min_length=1)
    vertices: tuple[tuple[Length, Length, Length], ...] = Field(min_length=8, max_length=8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CloudBox:
    """A box in the frame of the points.

    Attributes:
        cloud_from_object: pose of its centre; x along the length, z up.
        size_m: (3,) float64, full length, width and height, m.
    """

    cloud_from_object: RigidTransform
    size_m: NDArray[np.float64]


def box_of_centroid(found: CentroidObject, *, degrees: bool) -> CloudBox:
    """A box from its middle, sizes and angles.

    Raises:
        ShapeError: angles beyond what radians from -pi to pi, or degrees from 0 to 360, can be.
    """
    angles = found.rotations.numbers()
    if degrees and not all(-1e-9 <= angle <= 360 + 1e-9 for angle in angles):
        raise ShapeError(f"rotations: expected degrees from 0 to 360, got {angles}")
    if not degrees and max(map(abs, angles)) > np.pi + 1e-6:
        raise ShapeError(f"rotations: expected radians from -pi to pi, got {angles}")
    rotation = Rotation.from_euler("xyz", angles, degrees=degrees).as_matrix()
    sizes = found.dimensions
    return CloudBox(
        cloud_from_object=RigidTransform(rotation, np.array(found.centroid.numbers())),
        size_m=np.array([sizes.length, sizes.width, sizes.height]),
    )


def box_of_vertices(found: VerticesObject) -> CloudBox:
    """A box from its corners.

    Raises:
        ShapeError: the corners are not those of a box.
    """
    corners = np.array(found.vertices)
    centre = corners.mean(axis=0)
    edges = (CORNERS.T @ (corners - centre)) / 8  # rows: half the length, width and height as vectors
    half_m = np.linalg.norm(edges, axis=1)
    slant_m = float(np.abs(CORNERS @ edges + centre - corners).max())
    if half_m.min() <= 0 or slant_m > LARGEST_SLANT * max(1.0, half_m.max()):
        raise ShapeError(f"vertices: expected the corners of a box in labelCloud's order, got some {slant_m:.3g} m off")
    left, _, right = np.linalg.svd((edges / half_m[:, None]).T)
    rotation = left @ right
    if np.linalg.det(rotation) < 0 or np.abs(rotation.T - edges / half_m[:, None]).max() > LARGEST_SLANT * 10:
        raise ShapeError("vertices: expected the corners of a box in labelCloud's order, got mirrored or slanted ones")
    return CloudBox(cloud_from_object=RigidTransform(rotation, centre), size_m=2 * half_m)


def written(name: str, box: CloudBox, way: Way) -> dict[str, Any]:
    """A box as labelCloud writes it; numbers are not rounded."""
    pose, sizes = box.cloud_from_object, np.asarray(box.size_m, dtype=np.float64)
    if way == "vertices":
        return {"name": name, "vertices": pose.apply(CORNERS * sizes / 2).tolist()}
    degrees = way == "centroid_abs"
    angles = Rotation.from_matrix(pose.rotation).as_euler("xyz", degrees=degrees)
    if degrees:
        angles = angles % 360.0
    return {
        "name": name,
        "centroid": dict(zip("xyz", pose.translation_m.tolist(), strict=True)),
        "dimensions": dict(zip(("length", "width", "height"), sizes.tolist(), strict=True)),
        "rotations": dict(zip("xyz", angles.tolist(), strict=True)),
    }

"""Readings of files of poses: mistakes that people make with them, each undone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion import Trajectory

Array = NDArray[np.float64]
Change = Callable[[Trajectory], Trajectory]


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseReading:
    """A mistake, and what undoes it.

    Attributes:
        description: what the poses are if this is the mistake.
        hint: what to change.
        change: undoes it.
    """

    description: str
    hint: str
    change: Change


def _reordered(path: Trajectory) -> Trajectory:
    w, x, y, z = path.rotations.as_quat().T
    return replace(path, rotations=Rotation.from_quat(np.stack([x, y, z, w], axis=1)))


def _inverted(path: Trajectory) -> Trajectory:
    inverse = path.rotations.inv()
    return replace(path, rotations=inverse, positions_m=-inverse.apply(path.positions_m))


def _in_axes(matrix: Array, *, places: bool = True, rotations: bool = True) -> Change:
    """World and vehicle seen in other axes: (3, 3) orthogonal, of determinant -1 for a mirror."""

    def change(path: Trajectory) -> Trajectory:
        turned = Rotation.from_matrix(matrix @ path.rotations.as_matrix() @ matrix.T) if rotations else path.rotations
        return replace(path, rotations=turned, positions_m=path.positions_m @ matrix.T if places else path.positions_m)

    return change


FLIP_Y, TURN_OVER = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0])
VEHICLE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
XYZW = "write quaternions as qx qy qz qw"
RIGHT_HANDED = "y is positive to the left, and the yaw with it"
POSE_READINGS = (
    PoseReading(description="quaternions w, x, y, z read as x, y, z, w", hint=XYZW, change=_reordered),
    PoseReading(description="vehicle_from_world, the inverse", hint="give world_from_vehicle", change=_inverted),
    PoseReading(description="poses of left-handed axes, y to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y)),
    PoseReading(
        description="positions with y to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y, rotations=False)
    ),
    PoseReading(description="rotations to the right", hint=RIGHT_HANDED, change=_in_axes(FLIP_Y, places=False)),
    PoseReading(
        description="poses with y to the right and z down",
        hint="give poses of axes x forward, y left, z up, in a world with z up",
        change=_in_axes(TURN_OVER),
    ),
    PoseReading(
        description="poses of a camera's axes, z forward",
        hint="give poses of axes x forward, y left, z up, in a world with z up",
        change=_in_axes(VEHICLE_FROM_OPTICAL),
    ),
)


def pose_readings(path: Trajectory) -> Iterator[tuple[PoseReading, Trajectory]]:
    """The path in every reading; none of a path of bus signals, which has no poses."""
    x, y, _, _ = path.rotations.as_quat().T
    level = not (x.any() or y.any() or path.positions_m[:, 2].any())
    if not level or Path(path.source).name == "poses.csv":
        yield from ((reading, reading.change(path)) for reading in POSE_READINGS)

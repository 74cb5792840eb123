"""Cuboids of OpenLABEL: nine values or ten, in axes of any kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.layers.tool_model import finite_number

EULER, QUATERNION = 9, 10


def read_box(val: object, file: Path, field: str) -> tuple[RigidTransform, NDArray[np.float64]]:
    """Pose and size of a cuboid.

    Args:
        val: nine values, with angles about the fixed x, y and z in turn, or ten, with a quaternion x, y, z, w.
        file: for messages.
        field: where the values stand.

    Raises:
        DataError: another number of values, a size that is not above 0, a quaternion of another length than 1.
    """
    numbers = [finite_number(number) for number in val] if isinstance(val, list | tuple) else []
    if len(numbers) not in {EULER, QUATERNION} or None in numbers:
        raise DataError(file, field=f"{field}.val", expected="9 or 10 finite numbers", got=repr(val)[:80])
    values = np.array(numbers, dtype=np.float64)
    place_m, size_m = values[:3], values[-3:]
    if size_m.min() <= 0:
        got = str(size_m.tolist())
        raise DataError(file, field=f"{field}.val", expected="a box of sizes above 0", got=got)
    if len(values) == EULER:
        return RigidTransform(Rotation.from_euler("xyz", values[3:6]).as_matrix(), place_m), size_m
    x, y, z, w = values[3:7].tolist()
    if abs(float(np.linalg.norm(values[3:7])) - 1.0) > 1e-3:
        got = str([x, y, z, w])
        raise DataError(file, field=f"{field}.val", expected="a quaternion x, y, z, w of length 1", got=got)
    return RigidTransform.from_quaternion((w, x, y, z), place_m), size_m


def upright(
    vehicle_from_box: RigidTransform, size_m: NDArray[np.float64]
) -> tuple[RigidTransform, NDArray[np.float64]]:
    """The same box with z up and x forward; tools that label in camera axes have its height along y."""
    up = vehicle_from_box.rotation[2]
    height = int(np.argmax(np.abs(up)))
    if height == 2 and up[2] > 0:
        return vehicle_from_box, size_m
    z_axis = np.eye(3)[height] * np.sign(up[height])
    x_axis = np.eye(3)[1 if height == 0 else 0]
    box_from_upright = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    turned = RigidTransform(vehicle_from_box.rotation @ box_from_upright, vehicle_from_box.translation_m)
    return turned, np.abs(box_from_upright.T) @ size_m

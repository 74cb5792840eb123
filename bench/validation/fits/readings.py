"""What people confuse, each with what undoes it: readings of boxes, poses, the lidar's mounting and cameras.

A check tries the data in every reading, and names the one that fits clearly better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.angular import KannalaBrandtCamera
from bench.cameras.model import CameraModel
from bench.cameras.pinhole import PinholeCamera
from bench.egomotion.trajectory import Trajectory
from bench.errors import ShapeError
from bench.geometry import RigidTransform
from bench.recordings import Cuboid, MountedCamera, Recording

Array = NDArray[np.float64]
Undo = TypeVar("Undo")
DEGREE = float(np.pi / 180)
FLIP_Y, TURN_OVER = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0])
VEHICLE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading(Generic[Undo]):
    """A mistake, and what undoes it.

    Attributes:
        description: what the data are if this is the mistake.
        field: of the data.
        hint: what to change.
        undo: the data as they were meant, or a function from the stated ones to them.
        elsewhere: boxes move so far that other beams meet them; images are to be mirrored.
    """

    description: str
    field: str = ""
    hint: str = ""
    undo: Undo
    elsewhere: bool = False


# ---------------------------------------------------------------- boxes

BoxChange = Callable[[Cuboid, RigidTransform], Cuboid]  # of a box and world_from_vehicle at its time


def _sized(*order: int, factor: float = 1.0) -> BoxChange:
    return lambda box, _: replace(box, size_m=box.size_m[list(order)] * factor)


def _raised(heights: float) -> BoxChange:
    def change(box: Cuboid, _: RigidTransform) -> Cuboid:
        raised_m = np.array([0.0, 0.0, heights * float(box.size_m[2])])
        pose = box.vehicle_from_object
        return replace(box, vehicle_from_object=RigidTransform(pose.rotation, pose.translation_m + raised_m))

    return change


def _mirrored(centre: bool, rotation: bool, frame: RigidTransform | None = None) -> BoxChange:
    """Mirrored in y, of the vehicle or of another frame."""
    vehicle_from_frame = frame or RigidTransform.identity()

    def change(box: Cuboid, _: RigidTransform) -> Cuboid:
        pose = vehicle_from_frame.inverse() @ box.vehicle_from_object
        turned = FLIP_Y @ pose.rotation @ FLIP_Y if rotation else pose.rotation
        place_m = FLIP_Y @ pose.translation_m if centre else pose.translation_m
        return replace(box, vehicle_from_object=vehicle_from_frame @ RigidTransform(turned, place_m))

    return change


def _in_frame(vehicle_from_frame: RigidTransform) -> BoxChange:
    return lambda box, _: replace(box, vehicle_from_object=vehicle_from_frame @ box.vehicle_from_object)


def _of_world(box: Cuboid, world_from_vehicle: RigidTransform) -> Cuboid:
    return _in_frame(world_from_vehicle.inverse())(box, world_from_vehicle)


def box_readings(recording: Recording) -> Iterator[Reading[BoxChange]]:
    """Readings that the boxes of a drive are tried in; those nearby come first."""
    vehicle_from_lidar = recording.vehicle_from_lidar
    frames = {"lidar frame": vehicle_from_lidar} | {
        f"frame of the camera {name}": camera.vehicle_from_camera for name, camera in recording.cameras.items()
    }
    swap = "swap them: the order is length, width, height"
    near = [
        ("the sizes were half sizes", "sizes", _sized(0, 1, 2, factor=2.0),
         "double the sizes: length, width and height are full, from side to side"),
        ("the sizes were doubled", "sizes", _sized(0, 1, 2, factor=0.5),
         "halve the sizes: length, width and height count once, from side to side"),
        ("length and width were swapped", "sizes", _sized(1, 0, 2),
         "swap them: length is along the box's x; or turn the boxes by 90 degrees"),
        ("width and height were swapped", "sizes", _sized(0, 2, 1), swap),
        ("length and height were swapped", "sizes", _sized(2, 1, 0), swap),
        ("the sign of the yaw was reversed", "rotation", _mirrored(False, True),
         "reverse the yaw: positive is to the left, counter-clockwise seen from above"),
        ("the bottom were given for the centre", "z", _raised(0.5),
         "add half a height to z: the origin of a box is its centre"),
        ("the top were given for the centre", "z", _raised(-0.5),
         "take half a height from z: the origin of a box is its centre"),
    ]  # fmt: skip
    y_hint = "reverse y: positive is to the left; or the lidar's, if that is reversed instead"
    turns = (("y forward and x to the right", -90), ("y backward and x to the left", 90),
             ("x backward and y to the right", 180))  # fmt: skip
    elsewhere = [
        ("the sign of y was reversed", "y", _mirrored(True, True), y_hint),
        ("the sign of y was reversed, but not of the yaw", "y", _mirrored(True, False), y_hint),
        ("the sign of the lidar's y was reversed", "", _mirrored(True, True, vehicle_from_lidar),
         "the lidar's y has the wrong sign: positive is to the left"),
        *((f"they were in the {name}", "coordinate system", _in_frame(frame),
           f"move them from the {name} into the vehicle frame, by "
           + ", ".join(f"{way:+.2f}" for way in frame.translation_m) + " m and its rotation")
          for name, frame in frames.items()),
        ("they had been moved from the lidar into the vehicle frame twice", "coordinate system",
         _in_frame(vehicle_from_lidar.inverse()), "apply the lidar's mounting once"),
        *((f"their axes were {axes}", "coordinate system",
           _in_frame(RigidTransform.from_yaw(float(np.radians(degrees)))), "turn them: x is forward, y is left")
          for axes, degrees in turns),
        ("they were in the world frame", "coordinate system", _of_world,
         "move them into the vehicle frame at each time, by the inverse of the ego vehicle's pose"),
    ]  # fmt: skip
    for far, entries in ((False, near), (True, elsewhere)):
        for description, part, undo, hint in entries:
            field = f"cuboid, {part}" if part else "points of the lidar, y"
            yield Reading(description=description, field=field, hint=hint, undo=undo, elsewhere=far)


# ---------------------------------------------------------------- poses

PathChange = Callable[[Trajectory], Trajectory]


def _reordered(path: Trajectory) -> Trajectory:
    w, x, y, z = path.rotations.as_quat().T
    return replace(path, rotations=Rotation.from_quat(np.stack([x, y, z, w], axis=1)))


def _inverted(path: Trajectory) -> Trajectory:
    inverse = path.rotations.inv()
    return replace(path, rotations=inverse, positions_m=-inverse.apply(path.positions_m))


def _in_axes(matrix: Array, *, places: bool = True, rotations: bool = True) -> PathChange:
    """World and vehicle seen in other axes: (3, 3) orthogonal, of determinant -1 for a mirror."""

    def change(path: Trajectory) -> Trajectory:
        turned = Rotation.from_matrix(matrix @ path.rotations.as_matrix() @ matrix.T) if rotations else path.rotations
        return replace(path, rotations=turned, positions_m=path.positions_m @ matrix.T if places else path.positions_m)

    return change


def pose_readings(path: Trajectory) -> Iterator[Reading[Trajectory]]:
    """The path in every reading; none of a path of bus signals, which has no poses."""
    x, y, _, _ = path.rotations.as_quat().T
    level = not (x.any() or y.any() or path.positions_m[:, 2].any())
    if level and Path(path.source).name != "poses.csv":
        return
    right_handed = "y is positive to the left, and the yaw with it"
    axes = "give poses of axes x forward, y left, z up, in a world with z up"
    for description, hint, change in (
        ("quaternions w, x, y, z read as x, y, z, w", "write quaternions as qx qy qz qw", _reordered),
        ("vehicle_from_world, the inverse", "give world_from_vehicle", _inverted),
        ("poses of left-handed axes, y to the right", right_handed, _in_axes(FLIP_Y)),
        ("positions with y to the right", right_handed, _in_axes(FLIP_Y, rotations=False)),
        ("rotations to the right", right_handed, _in_axes(FLIP_Y, places=False)),
        ("poses with y to the right and z down", axes, _in_axes(TURN_OVER)),
        ("poses of a camera's axes, z forward", axes, _in_axes(VEHICLE_FROM_OPTICAL)),
    ):
        yield Reading(description=description, field="poses", hint=hint, undo=change(path))


# ---------------------------------------------------------------- the lidar's mounting

NEARER = 0.3  # share of its angle to the stated mounting that the fitted one is off from the inverse, to be called so
NAMED_RAD = 0.14  # how far a mounting may be from permuted axes to be called so


def mounting_name(stated: Array, fitted: Array) -> str:
    """Name of what is wrong with a mounting.

    Args:
        stated: (3, 3) float64, rotation of the lidar as the calibration says.
        fitted: (3, 3) float64, orthogonal: what the motion asks for.
    """
    if _angle_rad(stated.T, fitted) < min(NAMED_RAD, NEARER * _angle_rad(stated, fitted)):
        return "the inverse of vehicle_from_lidar"
    change = stated.T @ fitted
    nearest = min(signed_axes(), key=lambda axes: float(np.linalg.norm(axes - change)))
    if not np.array_equal(nearest, np.eye(3)) and _angle_rad(nearest, change) < NAMED_RAD:
        return _axes_name(nearest)
    turned = fitted @ stated.T
    yaw_deg = np.degrees(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    mirror = "the points mirrored and " if np.linalg.det(change) < 0 else ""
    return f"{mirror}the lidar turned by {yaw_deg:+.1f} degrees about the vehicle's z"


def _angle_rad(one: Array, other: Array) -> float:
    """Angle of the rotation between two orthogonal matrices; pi where one of them mirrors."""
    between = one.T @ other
    if np.linalg.det(between) < 0:
        return float(np.pi)
    return float(np.arccos(np.clip((np.trace(between) - 1) / 2, -1, 1)))


def signed_axes() -> list[Array]:
    """All 48 permutations of axes with signs; 24 of them mirror."""
    return [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]


def _letters(axes: Array) -> str:
    """The axis, with its sign, that each row takes."""
    return ", ".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in axes)


def _axes_name(axes: Array) -> str:
    off_diagonal = np.flatnonzero(np.diag(axes) == 0)
    reversed_axes = " and ".join("xyz"[i] for i in range(3) if axes[i, i] < 0)
    if not len(off_diagonal):
        mirror = ": the points are mirrored" if np.linalg.det(axes) < 0 else ": the lidar turned by 180 degrees"
        return f"{reversed_axes} reversed{mirror}"
    if len(off_diagonal) == 2 and (axes >= 0).all():
        one, other = off_diagonal
        return f"{'xyz'[one]} and {'xyz'[other]} swapped: the points are mirrored"
    return f"the points' axes permuted: x, y, z are the file's {_letters(axes)}"


# ---------------------------------------------------------------- cameras


def camera_readings(camera: MountedCamera, others: Sequence[MountedCamera]) -> Iterator[Reading[MountedCamera]]:
    """Calibrations that may have been meant.

    Args:
        camera: as stated.
        others: cameras whose images may be taken for those of this one, all at one size.
    """
    model, mounting = camera.model, camera.vehicle_from_camera
    rotation, place_m = mounting.rotation, mounting.translation_m
    lenses = [(f"the focal length times {factor:g}", model.zoomed(factor)) for factor in (0.5, 2.0)]
    for description, lens in (*lenses, *_other_lenses(model)):
        yield Reading(field="model", description=description, undo=replace(camera, model=lens))
    inverse = replace(camera, vehicle_from_camera=mounting.inverse())
    yield Reading(field="vehicle_from_camera", description="the inverse of the mounting", undo=inverse)
    w, x, y, z = mounting.quaternion_wxyz
    axes = [axes for axes in signed_axes() if np.linalg.det(axes) > 0 and not np.array_equal(axes, np.eye(3))]
    rotations: list[tuple[str, Array]] = [
        ("the quaternion read as x, y, z, w", _rotation(z, w, x, y)),
        ("the quaternion read as w, x, y, z, given as x, y, z, w,", _rotation(x, y, z, w)),
        ("the inverse of the rotation", rotation.T),
        ("the camera frame read as x forward, y left, z up", rotation @ VEHICLE_FROM_OPTICAL),
        ("the camera frame read as x right, y down, z forward twice", rotation @ VEHICLE_FROM_OPTICAL.T),
        ("the images upside down", rotation @ np.diag([-1.0, -1.0, 1.0])),
        *((f"the camera's axes as {_letters(matrix)}", rotation @ matrix) for matrix in axes),
    ]
    for description, matrix in rotations:
        turned = replace(camera, vehicle_from_camera=RigidTransform(matrix, place_m))
        yield Reading(field="vehicle_from_camera.quaternion_wxyz", description=description, undo=turned)
    yield Reading(field="images", description="the images mirrored", undo=camera, elsewhere=True)
    for other in others:
        yield Reading(field="images", description=f"the images of {other.name}", undo=other)


def _rotation(*quaternion_wxyz: float) -> Array:
    return RigidTransform.from_quaternion(quaternion_wxyz, np.zeros(3)).rotation


def _other_lenses(model: CameraModel) -> Iterator[tuple[str, CameraModel]]:
    """A pinhole for what is no pinhole and a fisheye for what is none, of the same focal length at the middle."""
    pixels, _ = model.project(np.array([[1e-4, 0.0, 1.0]]))
    focal = float(np.abs(pixels[0, 0] - model.principal_point[0]) / 1e-4)
    frame: dict[str, Any] = {"width": model.width, "height": model.height, "principal_point": model.principal_point}
    with suppress(ShapeError):
        if not isinstance(model, PinholeCamera):
            yield "a pinhole lens", PinholeCamera(**frame, focal=(focal, focal))
        if not isinstance(model, KannalaBrandtCamera):
            yield "a fisheye lens", KannalaBrandtCamera(**frame, focal=(focal, focal), coefficients=())

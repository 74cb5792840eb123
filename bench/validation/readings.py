"""Readings of annotated boxes: mistakes that people make with them, each undone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from bench.geometry import RigidTransform
from bench.recordings import Cuboid, Recording

Change = Callable[[Cuboid, RigidTransform], Cuboid]  # of a box and world_from_vehicle at its time


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A mistake, and what undoes it.

    Attributes:
        description: what the boxes are if this is the mistake, after "as if".
        field: in the annotations.
        hint: what to change.
        change: undoes it.
        elsewhere: whether boxes move so far that other beams meet them.
    """

    description: str
    field: str
    hint: str
    change: Change
    elsewhere: bool = False


def _sized(*order: int, factor: float = 1.0) -> Change:
    return lambda box, _: replace(box, size_m=box.size_m[list(order)] * factor)


def _raised(heights: float) -> Change:
    def change(box: Cuboid, _: RigidTransform) -> Cuboid:
        raised = np.array([0.0, 0.0, heights * float(box.size_m[2])])
        pose = box.vehicle_from_object
        return replace(box, vehicle_from_object=RigidTransform(pose.rotation, pose.translation_m + raised))

    return change


def _mirrored(centre: bool, rotation: bool) -> Change:
    flip = np.diag([1.0, -1.0, 1.0])

    def change(box: Cuboid, _: RigidTransform) -> Cuboid:
        pose = box.vehicle_from_object
        turned = flip @ pose.rotation @ flip if rotation else pose.rotation
        place = flip @ pose.translation_m if centre else pose.translation_m
        return replace(box, vehicle_from_object=RigidTransform(turned, place))

    return change


def _of_mirrored_lidar(vehicle_from_lidar: RigidTransform) -> Change:
    mirrored = _mirrored(True, True)

    def change(box: Cuboid, world_from_vehicle: RigidTransform) -> Cuboid:
        in_lidar = replace(box, vehicle_from_object=vehicle_from_lidar.inverse() @ box.vehicle_from_object)
        other = mirrored(in_lidar, world_from_vehicle)
        return replace(other, vehicle_from_object=vehicle_from_lidar @ other.vehicle_from_object)

    return change


def _in_frame(vehicle_from_frame: RigidTransform) -> Change:
    return lambda box, _: replace(box, vehicle_from_object=vehicle_from_frame @ box.vehicle_from_object)


def _of_world(box: Cuboid, world_from_vehicle: RigidTransform) -> Cuboid:
    return replace(box, vehicle_from_object=world_from_vehicle.inverse() @ box.vehicle_from_object)


SIZES = (
    Reading(description="the sizes were half ones", field="cuboid, sizes", change=_sized(0, 1, 2, factor=2.0),
            hint="double the sizes: length, width and height are full, from side to side"),
    Reading(description="the sizes were doubled", field="cuboid, sizes", change=_sized(0, 1, 2, factor=0.5),
            hint="halve the sizes: length, width and height count once, from side to side"),
    Reading(description="length and width were swapped", field="cuboid, sizes", change=_sized(1, 0, 2),
            hint="swap them: length is along the box's x; or turn the boxes by 90 degrees"),
    Reading(description="width and height were swapped", field="cuboid, sizes", change=_sized(0, 2, 1),
            hint="swap them: the order is length, width, height"),
    Reading(description="length and height were swapped", field="cuboid, sizes", change=_sized(2, 1, 0),
            hint="swap them: the order is length, width, height"),
    Reading(description="the sign of the yaw was reversed", field="cuboid, rotation", change=_mirrored(False, True),
            hint="reverse the yaw: positive is to the left, counter-clockwise seen from above"),
    Reading(description="the bottom were given for the centre", field="cuboid, z", change=_raised(0.5),
            hint="add half a height to z: the origin of a box is its centre"),
    Reading(description="the top were given for the centre", field="cuboid, z", change=_raised(-0.5),
            hint="take half a height from z: the origin of a box is its centre"),
)  # fmt: skip


def readings(recording: Recording) -> Iterator[Reading]:
    """Readings that the boxes of a drive are tried in."""
    yield from SIZES
    for rotation in (True, False):
        yield Reading(
            description="the sign of y was reversed" + ("" if rotation else ", but not of the yaw"),
            field="cuboid, y",
            hint="reverse y: positive is to the left; or the lidar's, if that is reversed instead",
            change=_mirrored(True, rotation),
            elsewhere=True,
        )
    yield Reading(
        description="the sign of the lidar's y was reversed",
        field="points of the lidar, y",
        hint="the lidar's y has the wrong sign: positive is to the left",
        change=_of_mirrored_lidar(recording.vehicle_from_lidar),
        elsewhere=True,
    )
    frames = {"lidar frame": recording.vehicle_from_lidar} | {
        f"frame of the camera {name}": camera.vehicle_from_camera for name, camera in recording.cameras.items()
    }
    for name, vehicle_from_frame in frames.items():
        yield Reading(
            description=f"they were in the {name}",
            field="cuboid, coordinate system",
            hint=f"move them from the {name} into the vehicle frame, by "
            + ", ".join(f"{way:+.2f}" for way in vehicle_from_frame.translation_m)
            + " m and its rotation",
            change=_in_frame(vehicle_from_frame),
            elsewhere=True,
        )
    yield Reading(
        description="they had been moved from the lidar into the vehicle frame twice",
        field="cuboid, coordinate system",
        hint="apply the lidar's mounting once",
        change=_in_frame(recording.vehicle_from_lidar.inverse()),
        elsewhere=True,
    )
    for axes, degrees in (
        ("y forward and x to the right", -90),
        ("y backward and x to the left", 90),
        ("x backward and y to the right", 180),
    ):
        yield Reading(
            description=f"their axes were {axes}",
            field="cuboid, coordinate system",
            hint="turn them: x is forward, y is left",
            change=_in_frame(RigidTransform.from_yaw(float(np.radians(degrees)))),
            elsewhere=True,
        )
    yield Reading(
        description="they were in the world frame",
        field="cuboid, coordinate system",
        hint="move them into the vehicle frame at each time, by the inverse of the ego vehicle's pose",
        change=_of_world,
        elsewhere=True,
    )

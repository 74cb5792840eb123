"""The mistakes that people make with a drive of their own, each as a change of a recording's files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.egomotion.trajectory import Trajectory
from bench.geometry import RigidTransform
from bench.recordings.native import native_recordings
from benchmarks import planting

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """A mistake.

    Attributes:
        name: as the table says it.
        part: the part of the data it is in: lidar, camera, clocks, ego-motion, boxes or units.
        plant: makes it in a recording's folder.
        lead: regular expression for the right finding's text, check to hint, without case.
        drives: the names of the drives in which the data can tell; all drives if empty.
    """

    name: str
    part: str
    plant: Callable[[Path], object]
    lead: str
    drives: tuple[str, ...] = ()


TURNING = ("turning-by-day", "turning-by-night", "car-park")
BY_DAY = ("turning-by-day", "straight-by-day", "car-park")


def _axes(matrix: Sequence[Sequence[float]], root: Path) -> None:
    """Multiply every point by a matrix."""
    turned = np.asarray(matrix, dtype=np.float32)
    planting.change_sweeps(root, lambda sweep: replace(sweep, points_lidar=sweep.points_lidar @ turned.T))


Mounting = Callable[[RigidTransform], RigidTransform]


def _mounted(sensor: str, change: Mounting, root: Path) -> None:
    """Change the mounting of the lidar, or of a camera."""

    def each(head: planting.Json) -> None:
        place = _place(head, sensor)
        changed = change(RigidTransform.from_quaternion(place["quaternion_wxyz"], place["translation_m"]))
        place.update(quaternion_wxyz=changed.quaternion_wxyz.tolist(), translation_m=changed.translation_m.tolist())

    planting.change_json(root / "recording.json", each)


def _place(head: planting.Json, sensor: str) -> planting.Json:
    of_lidar = sensor == "lidar"
    place: planting.Json = head["lidar" if of_lidar else "cameras"]["vehicle_from_lidar" if of_lidar else sensor]
    return place if of_lidar else place["vehicle_from_camera"]


def _turned_by(axis: str, degrees: float) -> Mounting:
    """About an axis of the vehicle."""
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return lambda mounting: RigidTransform(turn @ mounting.rotation, mounting.translation_m)


def _moved_by(*way_m: float) -> Mounting:
    return lambda mounting: RigidTransform(mounting.rotation, mounting.translation_m + np.array(way_m))


def _biased_bus(degps: float, root: Path) -> None:
    bias = float(np.radians(degps))
    planting.change_bus(root, "yaw_rate_radps", lambda rate: float(rate) + bias)


def _shift_sweeps(milliseconds: float, root: Path) -> None:
    planting.shift_times(root / "lidar", round(milliseconds * 1e6))


def _shift_images(milliseconds: float, root: Path) -> None:
    for folder in (root / "images").iterdir():
        planting.shift_times(folder, round(milliseconds * 1e6))


def _shift_bus(milliseconds: float, root: Path) -> None:
    offset_ns = round(milliseconds * 1e6)
    planting.change_bus(root, "timestamp_ns", lambda time_ns: int(time_ns) + offset_ns)


def _scaled_bus(column: str, factor: float, root: Path) -> None:
    planting.change_bus(root, column, lambda value: float(value) * factor)


MIRROR_X, MIRROR_Y, MIRROR_Z = (np.diag(signs).tolist() for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1]))
SWAPPED, ROTATED = [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
SWEEP_CLOCK, EGO_CLOCK = "clock.*sweeps? (is|are) .*(late|early)", "clock.*ego-motion is .*(late|early)"

# Lidar, odometry, and the clock between them.
OF_LIDAR: tuple[Mistake, ...] = (
    Mistake(name="lidar mirrored in x", part="lidar", plant=partial(_axes, MIRROR_X), lead="lidar.*x reversed.*mirror"),
    Mistake(name="lidar mirrored in y", part="lidar", plant=partial(_axes, MIRROR_Y), lead="lidar.*y reversed.*mirror"),
    Mistake(name="lidar mirrored in z", part="lidar", plant=partial(_axes, MIRROR_Z), lead="lidar.*z reversed.*mirror"),
    Mistake(name="lidar x and y swapped", part="lidar", plant=partial(_axes, SWAPPED), lead="lidar.*x and y swapped"),
    Mistake(name="lidar axes rotated", part="lidar", plant=partial(_axes, ROTATED), lead="lidar.*axes permuted"),
    Mistake(name="lidar mounting inverse", part="lidar", plant=partial(_mounted, "lidar", RigidTransform.inverse),
            lead="lidar.*(inverse|direction of the)"),
    *(Mistake(name=f"lidar turned by {degrees} degrees", part="lidar", lead="lidar.*(yaw|turned by)",
              plant=partial(_mounted, "lidar", _turned_by("z", degrees))) for degrees in (2, 5, 180)),
    *(Mistake(name=f"lidar {centimetres} cm too high", part="lidar", lead="road.*height",
              plant=partial(_mounted, "lidar", _moved_by(0, 0, centimetres / 100))) for centimetres in (10, 30)),
    *(Mistake(name=f"{who} {abs(late)} ms {'late' if late > 0 else 'early'}", part="clocks", plant=partial(shift, late),
              lead=lead, drives=TURNING)
      for who, shift, lead in (("sweeps", _shift_sweeps, SWEEP_CLOCK), ("odometry", _shift_bus, EGO_CLOCK))
      for late in (10, -10, 50, -50, 100, -100)),
    *(Mistake(name=f"speed {percent} % too high", part="ego-motion", lead="scale of the speed",
              plant=partial(_scaled_bus, "speed_mps", 1 + percent / 100)) for percent in (2, 5)),
    Mistake(name="yaw rate positive to the right", part="ego-motion", lead="sign of the yaw rate", drives=TURNING,
            plant=partial(_scaled_bus, "yaw_rate_radps", -1.0)),
    Mistake(name="yaw rate off by 1 degree per second", part="ego-motion", lead="bias of the yaw rate",
            plant=partial(_biased_bus, 1.0)),
)  # fmt: skip


def _each_box(change: Callable[[list[float]], object], root: Path, only: str | None = None) -> None:
    """Change x, y, z, quaternion (x, y, z, w), length, width and height of every box, in place."""
    planting.change_boxes(root, lambda _name, _i, data: change(data["cuboid"][0]["val"]), only=only)


def _resized(order: Sequence[int], factor: float, val: list[float]) -> None:
    val[7:10] = [factor * val[7:10][i] for i in order]


def _shortened(by_m: float, val: list[float]) -> None:
    val[7] = max(val[7] - by_m, 0.2)


def _turned(degrees: float, val: list[float]) -> None:
    turned = Rotation.from_quat(val[3:7]) * Rotation.from_euler("z", degrees, degrees=True)
    val[3:7] = turned.as_quat().tolist()


def _yaw_reversed(val: list[float]) -> None:
    x, y, z, w = val[3:7]
    val[3:7] = [-x, y, -z, w]


def _mirrored(val: list[float]) -> None:
    val[1] *= -1
    _yaw_reversed(val)


def _aside(val: list[float]) -> None:
    way_m = Rotation.from_quat(val[3:7]).apply([0.0, 0.5, 0.0])
    val[:3] = np.add(val[:3], way_m).tolist()


def _raised(heights: float, val: list[float]) -> None:
    val[2] += heights * val[9]


def _into_frame(sensor: str, root: Path) -> None:
    """Move boxes from the vehicle frame into a sensor's."""
    mounting = _place(json.loads((root / "recording.json").read_text()), sensor)
    rotation = Rotation.from_quat(mounting["quaternion_wxyz"], scalar_first=True)

    def move(val: list[float]) -> None:
        val[:3] = rotation.inv().apply(np.subtract(val[:3], mounting["translation_m"])).tolist()
        val[3:7] = (rotation.inv() * Rotation.from_quat(val[3:7])).as_quat().tolist()

    _each_box(move, root)


def _at_frames(root: Path, of: Callable[[Trajectory, int], Value]) -> dict[int, Value]:
    """A value of the path at the time of each annotated frame."""
    (handle,) = native_recordings(root, options={}, card=root / "card.yaml", annotations=None)
    path = handle.open().trajectory
    frames = json.loads((root / "annotations.json").read_text())["openlabel"]["frames"]
    return {int(i): of(path, frame["frame_properties"]["timestamp"]) for i, frame in frames.items()}


def _into_world(root: Path) -> None:
    """Move boxes from the vehicle frame into the frame of the path."""
    poses = _at_frames(root, Trajectory.world_from_vehicle)

    def move(_name: str, i: int, data: planting.Json) -> None:
        val = data["cuboid"][0]["val"]
        val[:3] = poses[i].apply(np.array(val[:3])).tolist()
        val[3:7] = (Rotation.from_matrix(poses[i].rotation) * Rotation.from_quat(val[3:7])).as_quat().tolist()

    planting.change_boxes(root, move)


def _shift_boxes(milliseconds: float, root: Path) -> None:
    def later(content: planting.Json) -> None:
        for frame in content["openlabel"]["frames"].values():
            frame["frame_properties"]["timestamp"] += round(milliseconds * 1e6)

    planting.change_json(root / "annotations.json", later)


def _velocities(change: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]], root: Path) -> None:
    """Change velocities, given those of the ego vehicle."""
    ego = _at_frames(root, Trajectory.velocity_vehicle_mps)

    def each(_name: str, i: int, data: planting.Json) -> None:
        for entry in data["vec"]:
            if entry["name"] == "velocity_mps":
                entry["val"] = change(np.array(entry["val"]), ego[i]).tolist()

    planting.change_boxes(root, each)


def _reversed(own_mps: NDArray[np.float64], _ego_mps: NDArray[np.float64]) -> NDArray[np.float64]:
    return -own_mps


def _one_object(root: Path) -> str:
    """Name of the object that moves fastest."""
    fastest: dict[str, float] = {}

    def note(name: str, _i: int, data: planting.Json) -> None:
        speeds = [np.linalg.norm(entry["val"]) for entry in data["vec"] if entry["name"] == "velocity_mps"]
        fastest[name] = max([fastest.get(name, 0.0), *map(float, speeds)])

    planting.change_boxes(root, note)
    return max(fastest, key=lambda name: fastest[name])


def _left_out(root: Path) -> None:
    """Leave out the object that moves fastest."""
    name = _one_object(root)

    def leave_out(content: planting.Json) -> None:
        del content["openlabel"]["objects"][name]
        for frame in content["openlabel"]["frames"].values():
            frame["objects"].pop(name, None)

    planting.change_json(root / "annotations.json", leave_out)


def _one_aside(root: Path) -> None:
    """Move the boxes of the object that moves fastest half a metre to its left."""
    _each_box(_aside, root, only=_one_object(root))


def _box_mistake(
    name: str, lead: str, change: Callable[[list[float]], object], drives: tuple[str, ...] = ()
) -> Mistake:
    return Mistake(name=name, part="boxes", plant=partial(_each_box, change), lead=lead, drives=drives)


OBLIQUE = ("turning-by-day", "turning-by-night")  # boxes that are neither along the vehicle nor across it
SAME = (0, 1, 2)
OF_BOXES = (
    _box_mistake("boxes of half size", "half", partial(_resized, SAME, 0.5)),
    _box_mistake("boxes of double size", "doubled", partial(_resized, SAME, 2.0)),
    _box_mistake("length and width swapped", "length and width", partial(_resized, (1, 0, 2), 1.0)),
    _box_mistake("width and height swapped", "width and height", partial(_resized, (0, 2, 1), 1.0)),
    _box_mistake("boxes 30 cm too short", "too short|too tight", partial(_shortened, 0.3)),
    _box_mistake("boxes 60 cm too short", "too short|too tight", partial(_shortened, 0.6)),
    _box_mistake("boxes turned by 90 degrees", "turn(ed)?.*90|90 degrees", partial(_turned, 90.0)),
    _box_mistake("boxes turned by 180 degrees", "back to front|180", partial(_turned, 180.0)),
    _box_mistake("boxes mirrored in y", "sign of y|reverse y", _mirrored),
    _box_mistake("yaw of boxes reversed", "yaw", _yaw_reversed, OBLIQUE),
    _box_mistake("bottoms given for centres", "bottom", partial(_raised, -0.5)),
    Mistake(name="boxes in the lidar frame", part="boxes", plant=partial(_into_frame, "lidar"), lead="lidar frame"),
    Mistake(name="boxes in the front camera's frame", part="boxes", plant=partial(_into_frame, "front"),
            lead="frame of the camera front"),
    Mistake(name="boxes in the world frame", part="boxes", plant=_into_world, lead="world frame"),
    Mistake(name="boxes one sweep late", part="boxes", plant=partial(_shift_boxes, 100.0), lead="boxes.*late"),
    Mistake(name="boxes one sweep early", part="boxes", plant=partial(_shift_boxes, -100.0), lead="boxes.*early"),
    Mistake(name="boxes 50 ms late", part="boxes", plant=partial(_shift_boxes, 50.0), lead="boxes.*late"),
    Mistake(name="velocities relative to the vehicle", part="boxes",
            plant=partial(_velocities, np.subtract), lead="velocity.*relative"),
    Mistake(name="velocities reversed", part="boxes", plant=partial(_velocities, _reversed),
            lead="velocity.*sign"),
    Mistake(name="the fastest object left out", part="boxes", plant=_left_out, lead="without a box|in no box"),
    Mistake(name="the fastest object's boxes half a metre to its left", part="boxes",
            plant=_one_aside, lead="object.*farther"),
)  # fmt: skip


# ---- cameras: mounting, lens, images, and their clock
def _reordered(root: Path) -> None:
    """The front camera's quaternion as x, y, z, w."""

    def reorder(head: planting.Json) -> None:
        place = _place(head, "front")
        place["quaternion_wxyz"] = [*place["quaternion_wxyz"][1:], place["quaternion_wxyz"][0]]

    planting.change_json(root / "recording.json", reorder)


def _lens(change: Callable[[planting.Json], object], root: Path) -> None:
    """Change the front camera's lens."""
    planting.change_json(root / "recording.json", lambda head: change(head["cameras"]["front"]["model"]))


def _zoom(factor: float, lens: planting.Json) -> None:
    lens["coefficients"] = [factor * number for number in lens["coefficients"]]


def _as_pinhole(lens: planting.Json) -> None:
    focal, centre = lens["coefficients"][0], lens["principal_point"]
    lens.clear()
    lens.update(model="pinhole", focal=[focal, focal], principal_point=centre)


def _shift_centre(lens: planting.Json) -> None:
    lens["principal_point"] = [lens["principal_point"][0] + 20.0, lens["principal_point"][1]]


def _swap_cameras(root: Path) -> None:
    front, right, aside = (root / "images" / name for name in ("front", "right", "aside"))
    front.rename(aside)
    right.rename(front)
    aside.rename(right)


def _flip_images(way: int, root: Path) -> None:
    for path in (root / "images" / "front").iterdir():
        cv2.imwrite(str(path), cv2.flip(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), way))


def _camera(name: str, plant: Callable[[Path], object], lead: str, drives: tuple[str, ...] = BY_DAY) -> Mistake:
    return Mistake(name=name, part="camera", plant=plant, lead=lead, drives=drives)


OF_CAMERAS: tuple[Mistake, ...] = (
    *(
        _camera(f"front camera turned {degrees:g} deg about the vehicle's {axis}", plant, "camera.*turned against")
        for axis in "xyz"
        for degrees in (1.0, 2.0, -5.0)
        for plant in (partial(_mounted, "front", _turned_by(axis, degrees)),)
    ),
    _camera("inverse mounting", partial(_mounted, "front", RigidTransform.inverse), "inverse"),
    _camera("quaternion as x, y, z, w", _reordered, "quaternion|mounting.*order"),
    _camera("30 cm to the left", partial(_mounted, "front", _moved_by(0, 0.3, 0)), "translation_m.*left"),
    _camera("30 cm up", partial(_mounted, "front", _moved_by(0, 0, 0.3)), "translation_m.*up"),
    *(
        _camera(f"focal length times {factor:g}", partial(_lens, partial(_zoom, factor)), "focal length")
        for factor in (0.5, 0.95, 0.98, 1.02, 1.05, 2.0)
    ),
    _camera("pinhole for fisheye", partial(_lens, _as_pinhole), "fisheye"),
    _camera("principal point 20 px off", partial(_lens, _shift_centre), "principal.point"),
    _camera("images of the cameras swapped", _swap_cameras, "images of (front|right)"),
    _camera("images mirrored", partial(_flip_images, 1), "mirrored"),
    _camera("images upside down", partial(_flip_images, -1), "upside down|turn the images"),
    *(
        replace(_camera(f"images {ms:+g} ms", partial(_shift_images, ms), "image-clock", TURNING), part="clocks")
        for ms in (-100.0, -50.0, -10.0, 10.0, 50.0, 100.0)
    ),
)
# ---- end of cameras


def _bus_times(factor: float, root: Path) -> None:
    planting.change_bus(root, "timestamp_ns", lambda time_ns: round(int(time_ns) * factor))


def _camera_places(factor: float, root: Path) -> None:
    def scale(head: planting.Json) -> None:
        for camera in head["cameras"].values():
            mounting = camera["vehicle_from_camera"]
            mounting["translation_m"] = [factor * value for value in mounting["translation_m"]]

    planting.change_json(root / "recording.json", scale)


def _scaled_boxes(factor: float, val: list[float]) -> None:
    for i in (0, 1, 2, 7, 8, 9):
        val[i] *= factor


OF_UNITS = (
    Mistake(name="speed in km/h", part="units", plant=partial(_scaled_bus, "speed_mps", 3.6), lead="speed.*km/h"),
    Mistake(
        name="yaw rate in degrees per second",
        part="units",
        plant=partial(_scaled_bus, "yaw_rate_radps", math.degrees(1.0)),
        lead="yaw rate.*degrees|degrees",
        drives=TURNING,
    ),
    Mistake(name="ego-motion in microseconds", part="units", plant=partial(_bus_times, 1e-3), lead="time-unit.*1000"),
    Mistake(name="lidar in millimetres", part="units", plant=partial(_axes, np.eye(3) * 1e3), lead="length-unit"),
    Mistake(name="cameras' places in mm", part="units", plant=partial(_camera_places, 1e3), lead="length-unit"),
    Mistake(name="boxes in centimetres", part="units", plant=partial(_each_box, partial(_scaled_boxes, 100.0)),
            lead="length-unit"),
)  # fmt: skip

MISTAKES: tuple[Mistake, ...] = (
    *OF_LIDAR,
    *OF_CAMERAS,
    *OF_BOXES,
    *OF_UNITS,
)

"""The tracked boxes of the aiMotive data set, brought into tracks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, field_validator

from bench.egomotion import Trajectory
from bench.errors import DataError, refuse
from bench.geometry import RigidTransform
from bench.recordings.validation import FileModel, TimeNs, read_json
from bench.records.recording import Cuboid, ObjectState, Track, yaw_rates

CLASSES = {
    **dict.fromkeys(("CAR", "VAN", "TRUCK", "TRUCK/BUS", "BUS", "TRAILER", "TRAIN", "OTHER_VEHICLE"), "vehicle"),
    "PEDESTRIAN": "pedestrian",
    **dict.fromkeys(("BICYCLE", "MOTORCYCLE", "BIKE", "RIDER", "RIDEABLE_VEHICLE"), "cyclist"),
    **dict.fromkeys(("ANIMAL", "OTHER_ANIMAL"), "animal"),
}


class Box(FileModel):
    """One object of a box file; keys that are not used are passed over."""

    model_config = ConfigDict(extra="ignore")

    object_id: int = Field(alias="ObjectId")
    object_type: str = Field(alias="ObjectType")
    x: float = Field(alias="BoundingBox3D Origin X")
    y: float = Field(alias="BoundingBox3D Origin Y")
    z: float = Field(alias="BoundingBox3D Origin Z")
    length_m: float = Field(alias="BoundingBox3D Extent X", gt=0)
    width_m: float = Field(alias="BoundingBox3D Extent Y", gt=0)
    height_m: float = Field(alias="BoundingBox3D Extent Z", gt=0)
    qw: float = Field(alias="BoundingBox3D Orientation Quat W")
    qx: float = Field(alias="BoundingBox3D Orientation Quat X")
    qy: float = Field(alias="BoundingBox3D Orientation Quat Y")
    qz: float = Field(alias="BoundingBox3D Orientation Quat Z")
    velocity_x: float = Field(alias="Relative Velocity X")
    velocity_y: float = Field(alias="Relative Velocity Y")
    velocity_z: float = Field(alias="Relative Velocity Z")


class BoxFile(FileModel):
    """A box file."""

    timestamp_ns: TimeNs = Field(alias="Timestamp")
    objects: tuple[Box, ...] = Field(alias="CapturedObjects")

    @field_validator("timestamp_ns", mode="before")
    @classmethod
    def _from_text(cls, value: object) -> object:
        """The data set writes times as text."""
        return int(value) if isinstance(value, str) and value.isascii() and value.isdigit() else value


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxFrame:
    """The boxes of one frame.

    Attributes:
        file: they come from.
        timestamp_ns: of the frame.
        boxes: all of them.
    """

    file: Path
    timestamp_ns: int
    boxes: tuple[Box, ...]


def read_box_frames(files: Mapping[int, Path], folder: Path) -> dict[int, BoxFrame]:
    """Read the box files of a sequence.

    Args:
        files: by frame number, increasing.
        folder: for messages.

    Raises:
        DataError: no file; a key that is absent or not a number, an unknown type of object, an object named twice;
            times that do not increase.
    """
    if not files:
        raise DataError(folder, expected="files frame_<number>.json, which hold the times of frames", got="none")
    frames: dict[int, BoxFrame] = {}
    last_ns: int | None = None
    for number, file in files.items():
        content = read_json(BoxFile, file)
        refuse(_object_faults(content, file))
        if last_ns is not None and content.timestamp_ns <= last_ns:
            got = f"{content.timestamp_ns} after {last_ns}"
            raise DataError(file, field="Timestamp", expected="times that increase", got=got)
        last_ns = content.timestamp_ns
        frames[number] = BoxFrame(file=file, timestamp_ns=last_ns, boxes=content.objects)
    return frames


def _object_faults(content: BoxFile, file: Path) -> Iterator[DataError]:
    seen: set[int] = set()
    for i, box in enumerate(content.objects):
        field = f"CapturedObjects.{i}"
        if box.object_type not in CLASSES:
            known = f"one of {', '.join(CLASSES)}"
            yield DataError(file, field=f"{field}.ObjectType", expected=known, got=repr(box.object_type[:40]))
        if box.object_id in seen:
            yield DataError(file, field=f"{field}.ObjectId", expected="each object once", got=f"{box.object_id} twice")
        if not any((box.qw, box.qx, box.qy, box.qz)):
            yield DataError(file, field=f"{field}.BoundingBox3D Orientation Quat", expected="a quaternion", got="zeros")
        seen.add(box.object_id)


def tracks_from_boxes(frames: Sequence[BoxFrame], trajectory: Trajectory) -> tuple[Track, ...]:
    """Join boxes to tracks by their number and add the ego-motion to their velocities.

    Args:
        frames: by increasing time.
        trajectory: of the ego vehicle.

    Returns:
        Tracks by object number.

    Raises:
        DataError: times without ego-motion.
    """
    boxes: dict[int, list[Box]] = defaultdict(list)
    times_ns: dict[int, list[int]] = defaultdict(list)
    ego_mps = {frame.timestamp_ns: trajectory.velocity_vehicle_mps(frame.timestamp_ns) for frame in frames}
    for frame in frames:
        for box in frame.boxes:
            boxes[box.object_id].append(box)
            times_ns[box.object_id].append(frame.timestamp_ns)
    return tuple(_track(number, boxes[number], times_ns[number], ego_mps, trajectory) for number in sorted(boxes))


def _track(
    number: int,
    boxes: Sequence[Box],
    times_ns: Sequence[int],
    ego_mps: dict[int, NDArray[np.float64]],
    trajectory: Trajectory,
) -> Track:
    poses = [RigidTransform.from_quaternion((b.qw, b.qx, b.qy, b.qz), (b.x, b.y, b.z)) for b in boxes]
    rates = yaw_rates(np.array(times_ns, dtype=np.int64), np.stack([p.rotation for p in poses]), trajectory)
    states = tuple(
        ObjectState(
            timestamp_ns=time_ns,
            shape=Cuboid(vehicle_from_object=pose, size_m=np.array([box.length_m, box.width_m, box.height_m])),
            velocity_mps=ego_mps[time_ns] + np.array([box.velocity_x, box.velocity_y, box.velocity_z]),
            yaw_rate_radps=float(rate),
        )
        for time_ns, box, pose, rate in zip(times_ns, boxes, poses, rates, strict=True)
    )
    return Track(track_id=str(number), object_class=CLASSES[boxes[0].object_type], states=states)

"""The adapter `rosbag`: bags of ROS 2, folders with `metadata.yaml` or single files, MCAP (`.mcap`) or SQLite (`.db3`).

```
<root>/
  rig.yaml                     which topic is which sensor; models and mountings of cameras; see `rig`
  <recording>/metadata.yaml    and the files of messages that it names
  <recording>.mcap             or one file alone
```

What is translated here, once:

- A message's time is the stamp in its header, plus the sensor's `time_offset_ns`; or the time of recording, where the
  card says so. Images count as exposed at that time.
- Sensors are mounted as the rig file says, or as /tf_static says of the frames that it names. ROS's vehicle and optical
  frames have the axes of ours; the height of the road in the vehicle frame comes from the rig file.
- Poses of an odometry topic are those of its child frame.
- A bag holds no annotations: they are files in the card's `annotations` folder. Without them a recording can be looked
  at, but no image of it is scored.

Where each message is, and its time, is found in one walk when the recording is opened; images and point clouds are read
one by one after that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.adapters.rosbag.bag import BagMessage, TimedRows, bag_files, bag_messages, bags_below
from bench.adapters.rosbag.messages import (
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    POINT_CLOUD,
    POSES,
    TRANSFORMS,
    Position,
    Topic,
    decode,
    field_value,
)
from bench.adapters.rosbag.rig import (
    CameraRig,
    LidarRig,
    OdometryRig,
    ReverseRig,
    Rig,
    RosbagOptions,
    SignalRig,
    read_rig,
)
from bench.adapters.rosbag.sensors import BagImage, BagSweep
from bench.atomic import linked_folder
from bench.egomotion.trajectory import Trajectory, planar_trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.annotations import annotation_file_in, read_annotations
from bench.recordings.catalogue import RecordingHandle, median_interval_ns
from bench.recordings.mounting import Mounting, body_mask, camera_model, mounted_camera
from bench.recordings.validation import located, validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, Content, ImageRef, MountedCamera, Recording, SweepRef

UNIT_TOLERANCE = 1e-2  # of the length of a quaternion
STATIC_FRAMES = "/tf_static"


def rosbag_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `rosbag`: each bag in `root`, or `root` itself, is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(RosbagOptions, options, file=card, field="options")
    handles = []
    for path in bags_below(root):
        name = root.resolve().name if path == root else path.stem if path.is_file() else path.name
        file = annotation_file_in(annotations, name)
        opener = partial(open_rosbag, root, path, chosen, name=name, card=card, annotations=file)
        handles.append(RecordingHandle(name=name, opener=opener))
    return tuple(handles)


def open_rosbag(
    root: Path, path: Path, options: RosbagOptions, *, name: str, card: Path, annotations: Path | None
) -> Recording:
    """Open a bag.

    Args:
        root: folder of the data set, which no file may leave.
        path: the bag, a file or folder in it or the root itself.
        options: as in the card.
        name: of the recording.
        card: for errors.
        annotations: its annotation file; None where it is not annotated.

    Raises:
        DataError: the bag or the rig file cannot be read, or a sensor has no messages that can be used; messages that
            cannot be used, unless the card accepts that.
    """
    files = bag_files(linked_folder(root, path, levels=options.follow_links), path)
    rig, rig_file = read_rig(root, options.rig, recording=name, card=card)
    opening = _Opening(path, files, rig, rig_file, options)
    images = {camera: tuple(opening.images(camera, entry)) for camera, entry in rig.cameras.items()}
    recording = Recording(
        name=name,
        root=root,
        frame_interval_ns=median_interval_ns(images, file=path),
        cameras={camera: opening.camera(camera, entry) for camera, entry in rig.cameras.items()},
        images=images,
        trajectory=opening.trajectory(),
        vehicle_from_lidar=RigidTransform.identity()
        if rig.lidar is None
        else opening.vehicle_from(rig.lidar.vehicle_from_sensor, rig.lidar.frame, "lidar.frame"),
        sweeps=() if rig.lidar is None else tuple(opening.sweeps(rig.lidar)),
        tracks=() if annotations is None else read_annotations(annotations),
        annotated=NOT_ANNOTATED if annotations is None else COMPLETELY,
        vehicle_outline_m=np.array(rig.vehicle.outline_m, dtype=np.float64),
    )
    if opening.losses and not options.accept_losses:
        first, *others = opening.losses
        hints = [first.hint, "set the card's option accept_losses: true to use the rest"]
        hints += [f"{len(others)} more faults, which fisheye-bench validate lists"] if others else []
        hint = "; ".join(filter(None, hints))
        error = DataError(first.file, field=first.field, expected=first.expected, got=first.got, hint=hint)
        error.others = tuple(others)
        raise error
    return replace(recording, contents=tuple(opening.contents()))


class _Opening:
    """A bag that was walked through: where the messages of the sensors are, and what the others say.

    Attributes:
        losses: messages that cannot be used, which the card may accept.
    """

    def __init__(self, path: Path, files: tuple[Path, ...], rig: Rig, rig_file: Path, options: RosbagOptions) -> None:
        self._path, self._files, self._rig, self._rig_file, self._options = path, files, rig, rig_file, options
        self.losses: list[DataError] = []
        self._frames = _StaticFrames()
        self._counts: Counter[str] = Counter()
        self._rows = {topic: TimedRows() for topic in rig.sensor_topics}
        signals = ((name, getattr(rig.ego_motion, name)) for name in ("odometry", "speed", "yaw_rate", "reverse"))
        self._signals: dict[str, tuple[OdometryRig | SignalRig | ReverseRig, TimedRows]] = {
            name: (signal, TimedRows()) for name, signal in signals if signal is not None
        }
        self._motion_topics = {signal.topic for signal, _ in self._signals.values()}
        read = self._motion_topics | {STATIC_FRAMES}
        for message in bag_messages(files, listed=self._rows, read=read, counts=self._counts):
            name, position = message.topic.name, message.position
            if name == STATIC_FRAMES:
                self._frames.take(message)
            if name in self._motion_topics:
                content = decode(message.topic, message.start, file=message.file)
                for signal, rows in self._signals.values():
                    if signal.topic == name:
                        rows.add(message, _numbers(signal, content, message))
            if name in self._rows:
                numbers = (message.file_number, position.chunk, position.offset, position.size)
                self._rows[name].add(message, numbers)

    def contents(self) -> Iterator[Content]:
        """The topics of the bag, read and not read, and what is lost of them."""
        uses = dict.fromkeys(self._motion_topics, "ego-motion") | {STATIC_FRAMES: "frames"}
        uses |= {camera.topic: f"images of {name}" for name, camera in self._rig.cameras.items()}
        uses |= {self._rig.lidar.topic: "sweeps"} if self._rig.lidar else {}
        for topic, count in sorted(self._counts.items()):
            why = "" if topic in uses else f"not named in {self._rig_file.name}"
            yield Content(what=f"topic {topic}", count=count, read_as=uses.get(topic, ""), why=why)
        for loss in self.losses:
            yield Content(what=loss.field or loss.file, why=f"expected {loss.expected}, got {loss.got}", suspect=True)

    def camera(self, name: str, camera: CameraRig) -> MountedCamera:
        """A camera, at the size at which it is evaluated."""
        field, file = f"cameras.{name}", self._rig_file
        with located(file, f"{field}.model"):
            model = camera_model(camera.model, camera.image_size)
        with located(file, field):
            return mounted_camera(
                name,
                model,
                self.vehicle_from(camera.vehicle_from_sensor, camera.frame, f"{field}.frame"),
                ground_height_m=self._rig.vehicle.ground_height_m,
                ego_body=body_mask(camera.image_size, camera.body_polygons),
                evaluated_size_px=self._options.evaluated_size_px,
                rolling_shutter=camera.rolling_shutter,
            )

    def images(self, name: str, camera: CameraRig) -> Iterator[ImageRef]:
        """The images of a camera, by time."""
        for time_ns, file, position, topic in self._messages(camera, f"cameras.{name}", IMAGE, COMPRESSED_IMAGE):
            path = file / name / str(time_ns)
            stored = BagImage(file, position, topic, camera.image_size, camera.white_level, path)
            yield ImageRef(camera=name, timestamp_ns=time_ns, path=path, stored=stored)

    def sweeps(self, lidar: LidarRig) -> Iterator[SweepRef]:
        """The sweeps of the lidar, by time."""
        for time_ns, file, position, topic in self._messages(lidar, "lidar", POINT_CLOUD):
            stored = BagSweep(file, position, topic, lidar)
            yield SweepRef(timestamp_ns=time_ns, path=file / "lidar" / str(time_ns), reader=stored, stored=stored)

    def _messages(
        self, sensor: CameraRig | LidarRig, field: str, *types: str
    ) -> Iterator[tuple[int, Path, Position, Topic]]:
        """Time, file, position and topic of a sensor's messages whose times can be used."""
        rows, path = self._rows[sensor.topic], self._path
        if rows.topic is None:
            got = f"none in {path.name}, which has {', '.join(sorted(self._counts)[:20]) or 'none'}"
            raise DataError(self._rig_file, field=f"{field}.topic", expected=f"messages on {sensor.topic}", got=got)
        rows.topic.refuse_others(*types, file=path)
        topic = replace(rows.topic, definition="")  # ROS's own types need none, and references stay small
        times_ns, positions = self._usable(rows)
        if not len(times_ns):
            raise DataError(path, field=sensor.topic, expected="messages whose times can be used", got="none")
        for time_ns, (number, *position) in zip(times_ns.tolist(), positions.tolist(), strict=True):
            yield time_ns + sensor.time_offset_ns, self._files[number], Position(*position), topic

    def vehicle_from(self, mounting: Mounting | None, frame: str | None, field: str) -> RigidTransform:
        """A mounting: the rig file's own, or that of a frame, or at the vehicle frame itself."""
        if mounting is not None:
            return mounting.transform
        if frame is None:
            return RigidTransform.identity()
        return self._frames.vehicle_from(frame, vehicle=self._rig.vehicle.frame, file=self._rig_file, field=field)

    def _usable(self, rows: TimedRows) -> tuple[NDArray[np.int64], NDArray[Any]]:
        return rows.usable(self._options.clock, file=self._path, losses=self.losses)

    def trajectory(self) -> Trajectory:
        """The path of the vehicle."""
        file, motion, tables = self._path, self._rig.ego_motion, {}
        for name, (signal, rows) in self._signals.items():
            if rows.topic is None:
                raise DataError(file, field=signal.topic, expected="messages of the ego-motion", got="none")
            tables[name] = self._usable(rows)
        if motion.odometry is None:
            return replace(_steered(tables, motion.max_gap_ns, file), max_gap_ns=motion.max_gap_ns)
        mounting, frame, topic = motion.odometry.vehicle_from_child, motion.odometry.frame, motion.odometry.topic
        child_from_vehicle = self.vehicle_from(mounting, frame, "ego_motion.odometry.frame").inverse()
        times_ns, poses = tables["odometry"]
        unit = np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0) < UNIT_TOLERANCE
        if not unit.all():
            got = f"{int((~unit).sum())} of {len(unit)} of another length"
            self.losses.append(DataError(file, field=topic, expected="quaternions of length 1", got=got))
        if unit.sum() < 2:
            raise DataError(file, field=topic, expected="at least two poses", got=f"{int(unit.sum())} that can be used")
        world_from_child = Rotation.from_quat(poses[unit, 3:], scalar_first=True)
        return Trajectory(
            source=str(file),
            timestamps_ns=times_ns[unit],
            rotations=world_from_child * Rotation.from_matrix(child_from_vehicle.rotation),
            positions_m=poses[unit, :3] + world_from_child.apply(np.array(child_from_vehicle.translation_m)),
            max_gap_ns=motion.max_gap_ns,
        )


# Ego-motion from speed and yaw rate, and frames


def _steered(tables: dict[str, tuple[NDArray[np.int64], NDArray[Any]]], max_gap_ns: int, file: Path) -> Trajectory:
    """From speed and yaw rate: at the times of the one that comes more often, the other interpolated."""
    (speed_ns, _), (yaw_rate_ns, _) = tables["speed"], tables["yaw_rate"]
    times_ns = speed_ns if len(speed_ns) >= len(yaw_rate_ns) else yaw_rate_ns
    speed_mps = _interpolated(*tables["speed"], times_ns, max_gap_ns)
    yaw_rate_radps = _interpolated(*tables["yaw_rate"], times_ns, max_gap_ns)
    valid = np.isfinite(speed_mps) & np.isfinite(yaw_rate_radps)
    if valid.sum() < 2:
        got = f"{len(speed_ns)} of speed, {len(yaw_rate_ns)} of yaw rate, {int(valid.sum())} in common"
        raise DataError(file, field="ego_motion", expected="at least two times with speed and yaw rate", got=got)
    if "reverse" in tables:
        # The gear is that of the last message; before the first one, that of the first.
        gear_ns, reverse = tables["reverse"]
        last = np.maximum(np.searchsorted(gear_ns, times_ns, side="right") - 1, 0)
        speed_mps = np.where(reverse[last, 0] > 0, -np.abs(speed_mps), np.abs(speed_mps))
    return planar_trajectory(
        source=str(file),
        timestamps_ns=times_ns[valid],
        speed_mps=speed_mps[valid],
        yaw_rate_radps=yaw_rate_radps[valid],
    )


def _interpolated(
    known_ns: NDArray[np.int64], known: NDArray[Any], times_ns: NDArray[np.int64], max_gap_ns: int
) -> NDArray[np.float64]:
    """(N,) values at times; NaN where not between two known ones that are close enough, or at a known one."""
    if known_ns is times_ns:
        return known[:, 0]
    if len(known_ns) < 2:
        return np.full(len(times_ns), np.nan)
    right = np.clip(np.searchsorted(known_ns, times_ns), 1, len(known_ns) - 1)
    values = np.interp(times_ns - known_ns[0], known_ns - known_ns[0], known[:, 0], left=np.nan, right=np.nan)
    return np.where(known_ns[right] - known_ns[right - 1] <= max_gap_ns, values, np.nan)


def _numbers(signal: OdometryRig | SignalRig | ReverseRig, content: Any, message: BagMessage) -> tuple[float, ...]:
    """Position (x, y, z) and quaternion (w, x, y, z), or the signal's value, or 1 for reverse gear and 0 for others."""
    if isinstance(signal, OdometryRig):
        message.topic.refuse_others(ODOMETRY, *POSES, file=message.file)
        pose = getattr(content.pose, "pose", content.pose)
        at, q = pose.position, pose.orientation
        return at.x, at.y, at.z, q.w, q.x, q.y, q.z
    paths = (signal.field,) if isinstance(signal.field, str) else signal.field
    values: list[Any] = [field_value(content, path, file=message.file, topic=signal.topic) for path in paths]
    for path, value in zip(paths, values, strict=True):
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not number and not (isinstance(signal, ReverseRig) and isinstance(value, bool | np.bool_ | str)):
            field = f"{signal.topic}, {path}"
            raise DataError(message.file, field=field, expected="a number", got=type(value).__name__)
    if isinstance(signal, ReverseRig):
        return (float(values[0] in signal.values),)
    return (signal.factor * float(np.mean(values)),)


class _StaticFrames:
    """The frames of /tf_static. Each has one parent, the last that was published."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, RigidTransform | DataError]] = {}  # child -> parent, parent_from_child

    def take(self, message: BagMessage) -> None:
        """Take a message of /tf_static.

        A transform that is none matters where its frame is asked for.

        Raises:
            DataError: another message.
        """
        message.topic.refuse_others(TRANSFORMS, file=message.file)
        for entry in decode(message.topic, message.start, file=message.file).transforms:
            child = str(entry.child_frame_id).lstrip("/")
            rotation, translation = entry.transform.rotation, entry.transform.translation
            parent_from_child: RigidTransform | DataError
            try:
                parent_from_child = RigidTransform.from_quaternion(
                    (rotation.w, rotation.x, rotation.y, rotation.z), (translation.x, translation.y, translation.z)
                )
            except ShapeError as error:
                field = f"{STATIC_FRAMES}, {child[:40]}"
                parent_from_child = DataError(message.file, field=field, expected="a transform", got=str(error))
            self._parents[child] = str(entry.header.frame_id).lstrip("/"), parent_from_child

    def vehicle_from(self, frame: str, *, vehicle: str, file: Path, field: str) -> RigidTransform:
        """Return the pose of a frame on the vehicle.

        Args:
            frame: its name.
            vehicle: name of the vehicle frame.
            file: that names them, for errors.
            field: where in the file.

        Raises:
            DataError: a frame that is not there, or not joined to the vehicle.
        """
        names = set(self._parents) | {parent for parent, _ in self._parents.values()}
        got = ", ".join(sorted(names)[:20]) or "none; is /tf_static recorded?"
        frame, vehicle = frame.lstrip("/"), vehicle.lstrip("/")
        for name in (vehicle, frame):
            if name not in names and frame != vehicle:
                raise DataError(file, field=field, expected=f"the frame {name!r} in {STATIC_FRAMES}", got=got)
        (root, root_from_frame), (vehicle_root, root_from_vehicle) = self._root_from(frame), self._root_from(vehicle)
        if root != vehicle_root:
            got = f"one below {root!r}, the other below {vehicle_root!r}"
            raise DataError(file, field=field, expected=f"{frame!r} joined to {vehicle!r} in {STATIC_FRAMES}", got=got)
        return root_from_vehicle.inverse() @ root_from_frame

    def _root_from(self, frame: str) -> tuple[str, RigidTransform]:
        """The frame above all others of this one's tree, and this one in it."""
        root, root_from_frame, passed = frame, RigidTransform.identity(), set[str]()
        while root in self._parents and root not in passed:
            passed.add(root)
            root, parent_from_child = self._parents[root]
            if isinstance(parent_from_child, DataError):
                raise parent_from_child
            root_from_frame = parent_from_child @ root_from_frame
        return root, root_from_frame

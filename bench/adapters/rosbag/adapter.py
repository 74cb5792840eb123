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
from collections.abc import Iterator, Mapping, Set
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.rosbag.bag import Bag, TimedRows, bag_messages, bags_below, open_bag
from bench.adapters.rosbag.messages import COMPRESSED_IMAGE, IMAGE, POINT_CLOUD, Position, Topic
from bench.adapters.rosbag.motion import STATIC_FRAMES, EgoMotionMessages, StaticFrames
from bench.adapters.rosbag.rig import CameraRig, LidarRig, Rig, RosbagOptions, read_rig
from bench.adapters.rosbag.sensors import BagImage, BagSweep
from bench.atomic import linked_folder, path_inside
from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.annotations import annotation_file_in, read_annotations
from bench.recordings.catalogue import RecordingHandle
from bench.recordings.images import read_mask
from bench.recordings.mounting import Mounting, body_mask, camera_model, mounted_camera
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, Content, ImageRef, MountedCamera, Recording, SweepRef


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
        DataError: the bag or the rig file cannot be read, or a sensor has no messages that can be used; files or
            messages that the bag lacks or that cannot be used, unless the card accepts that.
    """
    bag = open_bag(linked_folder(root, path, levels=options.follow_links), path)
    rig, rig_file = read_rig(root, options.rig, recording=name, card=card)
    opening = _Opening(bag, rig, rig_file, options)
    images = {camera: tuple(opening.images(camera, entry)) for camera, entry in rig.cameras.items()}
    recording = Recording(
        name=name,
        root=root,
        licence=options.licence,
        frame_interval_ns=rig.frame_interval_ns or _median_interval_ns(images, bag),
        cameras={camera: opening.camera(root, camera, entry) for camera, entry in rig.cameras.items()},
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


def _median_interval_ns(images: Mapping[str, tuple[ImageRef, ...]], bag: Bag) -> int:
    steps_ns = [np.diff([ref.timestamp_ns for ref in refs]) for refs in images.values() if len(refs) > 1]
    if not steps_ns:
        raise DataError(bag.path, expected="two images of a camera at least", got="one")
    return int(np.median(np.concatenate(steps_ns)))


class _Opening:
    """A bag that was walked through: where the messages of the sensors are, and what the others say.

    Attributes:
        losses: what the bag lacks, which the card may accept.
    """

    def __init__(self, bag: Bag, rig: Rig, rig_file: Path, options: RosbagOptions) -> None:
        self._bag, self._rig, self._rig_file, self._options = bag, rig, rig_file, options
        self.losses = [*bag.losses]
        self._frames, self._motion = StaticFrames(), EgoMotionMessages(rig.ego_motion)
        self._counts: Counter[str] = Counter()
        self._rows = {topic: TimedRows(4, "q") for topic in rig.sensor_topics}
        self._walk(self._motion.topics)

    def _walk(self, motion: Set[str]) -> None:
        """Find the messages of the sensors, and read those of the ego-motion and the frames."""
        read = motion | {STATIC_FRAMES}
        for message in bag_messages(self._bag, listed=self._rows, read=read, counts=self._counts):
            name, position = message.topic.name, message.position
            if name == STATIC_FRAMES:
                self._frames.take(message)
            if name in motion:
                self._motion.take(message)
            if name in self._rows:
                numbers = (message.file_number, position.chunk, position.offset, position.size)
                self._rows[name].add(message, numbers)
        for name, stated in self._bag.counts.items():
            if self._counts[name] < stated:
                expected, got = f"{stated} messages, as metadata.yaml says", str(self._counts[name])
                self.losses.append(DataError(self._bag.path, field=name[:80], expected=expected, got=got))

    def contents(self) -> Iterator[Content]:
        """The topics of the bag, read and not read, and what is lost of them."""
        uses = dict.fromkeys(self._motion.topics, "ego-motion") | {STATIC_FRAMES: "frames"}
        uses |= {camera.topic: f"images of {name}" for name, camera in self._rig.cameras.items()}
        uses |= {self._rig.lidar.topic: "sweeps"} if self._rig.lidar else {}
        for topic, count in sorted(self._counts.items()):
            why = "" if topic in uses else f"not named in {self._rig_file.name}"
            yield Content(what=f"topic {topic}", count=count, read_as=uses.get(topic, ""), why=why)
        for loss in self.losses:
            yield Content(what=loss.field or loss.file, why=f"expected {loss.expected}, got {loss.got}", suspect=True)

    def camera(self, root: Path, name: str, camera: CameraRig) -> MountedCamera:
        """A camera, at the size at which it is evaluated."""
        field, file = f"cameras.{name}", self._rig_file
        ego_body = body_mask(camera.image_size, camera.body_polygons)
        if camera.ego_body_mask is not None:
            path = path_inside(root, camera.ego_body_mask, file=file, field=f"{field}.ego_body_mask")
            mask = read_mask(path, camera.image_size)
            ego_body = mask if ego_body is None else mask | ego_body
        return mounted_camera(
            name,
            camera_model(camera.model, camera.image_size, file=file, field=f"{field}.model"),
            self.vehicle_from(camera.vehicle_from_sensor, camera.frame, f"{field}.frame"),
            ground_height_m=self._rig.vehicle.ground_height_m,
            ego_body=ego_body,
            evaluated_size_px=self._options.evaluated_size_px,
            rolling_shutter=camera.rolling_shutter,
            file=file,
            field=field,
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
        rows, path = self._rows[sensor.topic], self._bag.path
        if rows.topic is None:
            got = f"none in {path.name}, which has {', '.join(sorted(self._counts)[:20]) or 'none'}"
            raise DataError(self._rig_file, field=f"{field}.topic", expected=f"messages on {sensor.topic}", got=got)
        rows.topic.refuse_others(*types, file=path)
        topic = replace(rows.topic, definition="")  # ROS's own types need none, and references stay small
        times_ns, positions = rows.usable(self._options.clock, file=path, losses=self.losses)
        if not len(times_ns):
            raise DataError(path, field=sensor.topic, expected="messages whose times can be used", got="none")
        for time_ns, (number, *position) in zip(times_ns.tolist(), positions.tolist(), strict=True):
            yield time_ns + sensor.time_offset_ns, self._bag.files[number], Position(*position), topic

    def vehicle_from(self, mounting: Mounting | None, frame: str | None, field: str) -> RigidTransform:
        """A mounting: the rig file's own, or that of a frame, or at the vehicle frame itself."""
        if mounting is not None:
            return mounting.transform
        if frame is None:
            return RigidTransform.identity()
        return self._frames.vehicle_from(frame, vehicle=self._rig.vehicle.frame, file=self._rig_file, field=field)

    def trajectory(self) -> Trajectory:
        """The path of the vehicle."""
        odometry = self._rig.ego_motion.odometry
        mounting, frame = (odometry.vehicle_from_child, odometry.frame) if odometry else (None, None)
        child_from_vehicle = self.vehicle_from(mounting, frame, "ego_motion.odometry.frame").inverse()
        return self._motion.trajectory(
            self._options.clock, child_from_vehicle=child_from_vehicle, file=self._bag.path, losses=self.losses
        )

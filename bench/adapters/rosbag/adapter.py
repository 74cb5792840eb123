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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.rosbag.bag import TimedRows, bag_messages, bags_below, open_bag
from bench.adapters.rosbag.messages import COMPRESSED_IMAGE, IMAGE, POINT_CLOUD, Topic
from bench.adapters.rosbag.motion import EgoMotionMessages
from bench.adapters.rosbag.rig import STATIC_FRAMES, CameraRig, LidarRig, RosbagOptions, StaticFrames, read_rig
from bench.adapters.rosbag.sensors import BagImage, BagSweep
from bench.adapters.rosbag.storage import Position
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
    sources = []
    for path in bags_below(root):
        name = root.resolve().name if path == root else path.stem if path.is_file() else path.name
        file = annotation_file_in(annotations, name)
        sources.append(_Source(root=root, path=path, name=name, card=card, options=chosen, annotations=file))
    return tuple(RecordingHandle(name=each.name, opener=each.open) for each in sources)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """Source of a recording.

    Attributes:
        root: folder of the data set, which no file may leave.
        path: the bag, a file or folder in it or the root itself.
        name: of the recording.
        card: for errors.
        options: as in the card.
        annotations: its annotation file; None where it is not annotated.
    """

    root: Path
    path: Path
    name: str
    card: Path
    options: RosbagOptions
    annotations: Path | None

    def open(self) -> Recording:
        """Open the bag.

        Raises:
            DataError: a file that is missing or not what the format asks for; files or messages that the bag lacks or
                that cannot be used, unless the card accepts that.
        """
        opening = _Opening(self)
        recording = opening.recording()
        if opening.losses and not self.options.accept_losses:
            first, *others = opening.losses
            hints = [first.hint, "set the card's option accept_losses: true to use the rest"]
            hints += [f"{len(others)} more faults, which fisheye-bench validate lists"] if others else []
            hint = "; ".join(filter(None, hints))
            error = DataError(first.file, field=first.field, expected=first.expected, got=first.got, hint=hint)
            error.others = tuple(others)
            raise error
        return recording


class _Opening:
    """A bag that is being opened.

    Args:
        source: where it comes from.

    Attributes:
        losses: what the bag lacks, which the card may accept.
    """

    def __init__(self, source: _Source) -> None:
        self.source = source
        self.losses: list[DataError] = []

    def recording(self) -> Recording:
        """The recording.

        Raises:
            DataError: the bag or the rig file cannot be read, or a sensor has no messages that can be used.
        """
        source = self.source
        within = linked_folder(source.root, source.path, levels=source.options.follow_links)
        self.bag = open_bag(within, source.path)
        self.losses += self.bag.losses
        self.rig, self.rig_file = read_rig(source.root, source.options.rig, recording=source.name, card=source.card)
        self.frames, motion = StaticFrames(), EgoMotionMessages(self.rig.ego_motion)
        self._walk(motion)
        images = {name: tuple(self._images(name, camera)) for name, camera in self.rig.cameras.items()}
        lidar, file = self.rig.lidar, source.annotations
        return Recording(
            name=source.name,
            root=source.root,
            licence=source.options.licence,
            frame_interval_ns=self.rig.frame_interval_ns or self._median_interval_ns(images),
            cameras={name: self._camera(name, camera) for name, camera in self.rig.cameras.items()},
            images=images,
            trajectory=self._trajectory(motion),
            vehicle_from_lidar=RigidTransform.identity()
            if lidar is None
            else self._vehicle_from(lidar.vehicle_from_sensor, lidar.frame, "lidar.frame"),
            sweeps=() if lidar is None else tuple(self._sweeps(lidar)),
            tracks=() if file is None else read_annotations(file),
            annotated=NOT_ANNOTATED if file is None else COMPLETELY,
            vehicle_outline_m=np.array(self.rig.vehicle.outline_m, dtype=np.float64),
            contents=tuple(self._contents(motion.topics)),
        )

    def _contents(self, motion: Set[str]) -> Iterator[Content]:
        """The topics of the bag, read and not read, and what is lost of them."""
        uses = dict.fromkeys(motion, "ego-motion") | {STATIC_FRAMES: "frames"}
        uses |= {camera.topic: f"images of {name}" for name, camera in self.rig.cameras.items()}
        uses |= {self.rig.lidar.topic: "sweeps"} if self.rig.lidar else {}
        for topic, count in sorted(self.counts.items()):
            why = "" if topic in uses else f"not named in {self.rig_file.name}"
            yield Content(what=f"topic {topic}", count=count, read_as=uses.get(topic, ""), why=why)
        for loss in self.losses:
            yield Content(what=loss.field or loss.file, why=f"expected {loss.expected}, got {loss.got}", suspect=True)

    def _walk(self, motion: EgoMotionMessages) -> None:
        """Find the messages of the sensors, and read those of the ego-motion and the frames."""
        self.counts: Counter[str] = Counter()
        self.rows = {topic: TimedRows(4, "q") for topic in self.rig.sensor_topics}
        read = motion.topics | {STATIC_FRAMES}
        for message in bag_messages(self.bag, listed=self.rows, read=read, counts=self.counts):
            name, position = message.topic.name, message.position
            if name == STATIC_FRAMES:
                self.frames.take(message)
            if name in motion.topics:
                motion.take(message)
            if name in self.rows:
                numbers = (message.file_number, position.chunk, position.offset, position.size)
                self.rows[name].add(message, numbers)
        for name, stated in self.bag.counts.items():
            if self.counts[name] < stated:
                expected, got = f"{stated} messages, as metadata.yaml says", str(self.counts[name])
                self.losses.append(DataError(self.bag.path, field=name[:80], expected=expected, got=got))

    def _camera(self, name: str, camera: CameraRig) -> MountedCamera:
        """A camera, at the size at which it is evaluated."""
        field, file = f"cameras.{name}", self.rig_file
        vehicle_from_camera = self._vehicle_from(camera.vehicle_from_sensor, camera.frame, f"{field}.frame")
        ego_body = body_mask(camera.image_size, camera.body_polygons)
        if camera.ego_body_mask is not None:
            path = path_inside(self.source.root, camera.ego_body_mask, file=file, field=f"{field}.ego_body_mask")
            mask = read_mask(path, camera.image_size)
            ego_body = mask if ego_body is None else mask | ego_body
        return mounted_camera(
            name,
            camera_model(camera.model, camera.image_size, file=file, field=f"{field}.model"),
            vehicle_from_camera,
            ground_height_m=self.rig.vehicle.ground_height_m,
            ego_body=ego_body,
            evaluated_size_px=self.source.options.evaluated_size_px,
            rolling_shutter=camera.rolling_shutter,
            file=file,
            field=field,
        )

    def _images(self, name: str, camera: CameraRig) -> Iterator[ImageRef]:
        """The images of a camera, by time."""
        for time_ns, file, position, topic in self._messages(camera, f"cameras.{name}", IMAGE, COMPRESSED_IMAGE):
            path = file / name / str(time_ns)
            compressed, size_px, white_level = self.bag.compressed, camera.image_size, camera.white_level
            stored = BagImage(file, position, topic, compressed, size_px, white_level, path)
            yield ImageRef(camera=name, timestamp_ns=time_ns, path=path, stored=stored)

    def _sweeps(self, lidar: LidarRig) -> Iterator[SweepRef]:
        """The sweeps of the lidar, by time."""
        for time_ns, file, position, topic in self._messages(lidar, "lidar", POINT_CLOUD):
            stored = BagSweep(file, position, topic, self.bag.compressed, lidar)
            yield SweepRef(timestamp_ns=time_ns, path=file / "lidar" / str(time_ns), reader=stored, stored=stored)

    def _messages(
        self, sensor: CameraRig | LidarRig, field: str, *types: str
    ) -> Iterator[tuple[int, Path, Position, Topic]]:
        """Time, file, position and topic of a sensor's messages whose times can be used."""
        rows, path = self.rows[sensor.topic], self.bag.path
        if rows.topic is None:
            got = f"none in {path.name}, which has {', '.join(sorted(self.counts)[:20]) or 'none'}"
            raise DataError(self.rig_file, field=f"{field}.topic", expected=f"messages on {sensor.topic}", got=got)
        rows.topic.refuse_others(*types, file=path)
        topic = replace(rows.topic, definition="")  # ROS's own types need none, and references stay small
        times_ns, positions = rows.usable(self.source.options.clock, file=path, losses=self.losses)
        if not len(times_ns):
            raise DataError(path, field=sensor.topic, expected="messages whose times can be used", got="none")
        for time_ns, (number, *position) in zip(times_ns.tolist(), positions.tolist(), strict=True):
            yield time_ns + sensor.time_offset_ns, self.bag.files[number], Position(*position), topic

    def _vehicle_from(self, mounting: Mounting | None, frame: str | None, field: str) -> RigidTransform:
        """A mounting: the rig file's own, or that of a frame, or at the vehicle frame itself."""
        if mounting is not None:
            return mounting.transform
        if frame is None:
            return RigidTransform.identity()
        return self.frames.vehicle_from(frame, vehicle=self.rig.vehicle.frame, file=self.rig_file, field=field)

    def _trajectory(self, motion: EgoMotionMessages) -> Trajectory:
        odometry, clock, file = self.rig.ego_motion.odometry, self.source.options.clock, self.bag.path
        mounting, frame = (odometry.vehicle_from_child, odometry.frame) if odometry else (None, None)
        child_from_vehicle = self._vehicle_from(mounting, frame, "ego_motion.odometry.frame").inverse()
        return motion.trajectory(clock, child_from_vehicle=child_from_vehicle, file=file, losses=self.losses)

    def _median_interval_ns(self, images: Mapping[str, tuple[ImageRef, ...]]) -> int:
        steps_ns = [np.diff([ref.timestamp_ns for ref in refs]) for refs in images.values() if len(refs) > 1]
        if not steps_ns:
            raise DataError(self.bag.path, expected="two images of a camera at least", got="one")
        return int(np.median(np.concatenate(steps_ns)))

"""Bags of ROS 2: folders with `metadata.yaml`, or single files, as MCAP (`.mcap`) or SQLite (`.db3`).

```
<root>/
  rig.yaml                     which topic is which sensor; cameras' models and places; see `rig`
  <recording>/metadata.yaml    and the files of messages that it names
  <recording>.mcap             or one file alone
```

What is translated here, once:

- A message's time is the stamp in its header, plus the sensor's `time_offset_ns`; or the time of recording, where the
  card says so. Images count as exposed at that time.
- Sensors sit where the rig file says, or where /tf_static has the frames that it names. ROS's vehicle and optical
  frames have the axes of ours; the height of the road in the vehicle frame comes from the rig file.
- Poses of an odometry topic are those of its child frame.
- A bag holds no annotations: they are files in the card's `annotations` folder. Without them a recording can be looked
  at, but no image of it is scored.

The index of a bag, where each message lies and when, is made in one walk when the recording is opened; images and point
clouds are read one by one after that. What the walk cannot read is told, and used only where the card accepts it.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.annotation_faults import annotation_faults
from bench.recordings.annotations import read_annotations
from bench.recordings.handles import RecordingHandle
from bench.recordings.records import ImageRef, MountedCamera, Recording, SweepRef, Track
from bench.recordings.rosbag.egomotion import EgoMotionMessages
from bench.recordings.rosbag.files import bag_files, bags_below
from bench.recordings.rosbag.frames import TOPIC as FRAMES_TOPIC
from bench.recordings.rosbag.frames import StaticFrames
from bench.recordings.rosbag.index import Consumer, Times, index_bag
from bench.recordings.rosbag.options import RosbagOptions
from bench.recordings.rosbag.rig import Rig, read_rig
from bench.recordings.rosbag.sensors import BagSensors
from bench.recordings.rosbag.storage import Topic
from bench.recordings.salvage import Part, Salvaged, collected, standing_still
from bench.recordings.validation import validated


def rosbag_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `rosbag`: each bag in `root`, or `root` itself, is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(RosbagOptions, options, file=card, field="options")
    handles = []
    for place in bags_below(root):
        name = root.resolve().name if place == "." else _name(place)
        source = _Source(
            root=root,
            place=place,
            name=name,
            card=card,
            options=chosen,
            annotations=None if annotations is None else annotations / f"{name}.json",
        )
        handles.append(
            RecordingHandle(name=name, opener=partial(open_rosbag, source), salvager=partial(salvage_rosbag, source))
        )
    return tuple(handles)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Source:
    """Where a recording comes from.

    Attributes:
        root: folder of the data set.
        place: file or folder in it; "." for the root itself.
        name: of the recording.
        card: for messages.
        options: as in the card.
        annotations: the file that may have its annotations.
    """

    root: Path
    place: str
    name: str
    card: Path
    options: RosbagOptions
    annotations: Path | None


def open_rosbag(source: _Source) -> Recording:
    """Open a bag.

    Raises:
        DataError: a file that is missing or not what the format asks for; a bag of which a part cannot be read, unless
            the card accepts that.
    """
    opened = _Opening(source, salvage=False)
    recording = opened.recording()
    if opened.losses and not source.options.accept_losses:
        first, more = opened.losses[0], len(opened.losses) - 1
        do = "set the card's option accept_losses: true to use the rest"
        do += f"; {more} more faults, which fisheye-bench validate tells" if more else ""
        raise DataError(
            first.file,
            field=first.field,
            expected=first.expected,
            got=first.got,
            do="; ".join(filter(None, (first.do, do))),
        )
    return recording


def salvage_rosbag(source: _Source) -> Salvaged:
    """All that is wrong with a bag, and the rest of it."""
    opened = _Opening(source, salvage=True)
    try:
        recording = opened.recording()
    except DataError as error:
        return Salvaged(faults=(*opened.losses, error), recording=None)
    return Salvaged(faults=tuple(opened.losses), recording=recording, lost=frozenset(opened.lost))


class _Opening:
    """One bag on its way to a recording; `losses` fills meanwhile."""

    def __init__(self, source: _Source, *, salvage: bool) -> None:
        self.source, self.salvage = source, salvage
        self.losses: list[DataError] = []
        self.lost: set[Part] = set()

    def recording(self) -> Recording:
        """The recording; what is salvaged lacks the parts that cannot be used.

        Raises:
            DataError: a part that cannot be used; where it is salvaged, only if nothing is left.
        """
        source = self.source
        bag = bag_files(source.root, source.place)
        rig, rig_file = read_rig(source.root, source.options.rig, recording=source.name, card=source.card)
        frames, motion = StaticFrames(), EgoMotionMessages(rig.ego_motion, source.options.clock)
        index = index_bag(bag, heads=_sensor_topics(rig), whole=_consumers(frames, motion))
        self.losses.extend(index.losses)
        sensors = BagSensors(
            root=source.root,
            options=source.options,
            index=index,
            rig=rig,
            rig_file=rig_file,
            frames=frames,
            place=bag.place,
            losses=self.losses,
        )
        tracks = self._tracks()
        cameras: dict[str, MountedCamera] = {}
        images: dict[str, tuple[ImageRef, ...]] = {}
        for name in rig.cameras:
            with self._part():
                refs = sensors.images(name, scored=tracks is not None)
                cameras[name], images[name] = sensors.camera(name), refs
        if not cameras:
            raise DataError(bag.place, expected="a camera that can be used", got="none")
        vehicle_from_lidar = RigidTransform.identity()
        sweeps: tuple[SweepRef, ...] = ()
        with self._part():
            vehicle_from_lidar, sweeps = sensors.vehicle_from_lidar(), sensors.sweeps()
        return Recording(
            name=source.name,
            root=source.root,
            licence=source.options.licence,
            frame_interval_ns=rig.frame_interval_ns or _median_step_ns(images, bag.place),
            cameras=cameras,
            images=images,
            trajectory=self._trajectory(motion, sensors),
            vehicle_from_lidar=vehicle_from_lidar,
            sweeps=sweeps,
            tracks=tracks or (),
            vehicle_outline_m=np.array(rig.vehicle.outline_m, dtype=np.float64),
        )

    def _part(self) -> AbstractContextManager[object]:
        return collected(self.losses) if self.salvage else nullcontext()

    def _trajectory(self, motion: EgoMotionMessages, sensors: BagSensors) -> Trajectory:
        with self._part():
            child_from_vehicle = sensors.child_from_vehicle()
            return motion.trajectory(child_from_vehicle=child_from_vehicle, file=sensors.place, losses=self.losses)
        self.lost.add("trajectory")
        return standing_still(sensors.place)

    def _tracks(self) -> tuple[Track, ...] | None:
        """The annotated objects; None where the bag is not annotated."""
        file = self.source.annotations
        if file is None or not file.is_file():
            self.lost.add("annotations")
            return None
        try:
            return read_annotations(file)
        except DataError as error:
            if not self.salvage:
                raise
            self.losses.extend(annotation_faults(file) or (error,))
            self.lost.add("annotations")
            return None


def _name(place: str) -> str:
    return place if Path(place).suffix not in (".mcap", ".db3", ".bag") else Path(place).stem


def _sensor_topics(rig: Rig) -> frozenset[str]:
    topics = {camera.topic for camera in rig.cameras.values()}
    return frozenset(topics | ({rig.lidar.topic} if rig.lidar else set()))


def _consumers(frames: StaticFrames, motion: EgoMotionMessages) -> Mapping[str, Consumer]:
    def take_frames(topic: Topic, _times: Times, payload: bytes, file: Path) -> None:
        frames.add(topic, payload, file=file)

    return {**motion.consumers(), FRAMES_TOPIC: take_frames}


def _median_step_ns(images: Mapping[str, tuple[ImageRef, ...]], place: Path) -> int:
    steps = [np.diff([ref.timestamp_ns for ref in refs]) for refs in images.values() if len(refs) > 1]
    if not steps:
        raise DataError(place, expected="two images of a camera at least", got="one")
    return int(np.median(np.concatenate(steps)))

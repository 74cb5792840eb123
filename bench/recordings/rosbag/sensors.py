"""The cameras and the lidar of a bag, from the rig file and the index."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.atomic import path_inside
from bench.recordings.images import body_mask, read_mask, scaled_camera
from bench.recordings.native import camera_model
from bench.recordings.records import ImageRef, MountedCamera, SweepRef
from bench.recordings.rosbag.frames import StaticFrames
from bench.recordings.rosbag.index import BagIndex, TopicIndex
from bench.recordings.rosbag.messages import COMPRESSED_IMAGE, IMAGE, POINT_CLOUD, message_type
from bench.recordings.rosbag.options import RosbagOptions
from bench.recordings.rosbag.parts import BagImage, BagSweep, CameraSource, LidarSource
from bench.recordings.rosbag.rig import CameraRig, Placed, Rig
from bench.recordings.rosbag.storage import Place
from bench.recordings.rosbag.times import usable_times
from bench.recordings.validation import data_error


@dataclass(frozen=True, slots=True, kw_only=True)
class BagSensors:
    """The sensors of a rig, and what the index of a bag has of them.

    Attributes:
        root: folder of the data set, which no file may leave.
        options: as in the card.
        index: of the bag.
        rig: which topics are which sensors.
        rig_file: for messages.
        frames: of /tf_static.
        place: of the bag, for messages.
        losses: takes what is left out.
    """

    root: Path
    options: RosbagOptions
    index: BagIndex
    rig: Rig
    rig_file: Path
    frames: StaticFrames
    place: Path
    losses: list[DataError]

    def camera(self, name: str) -> MountedCamera:
        """A camera, at the size at which it is evaluated."""
        entry, field = self.rig.cameras[name], f"cameras.{name}"
        vehicle_from_camera = self._mounting(entry, field)
        try:
            road = RoadPlane.below(vehicle_from_camera, ground_height_m=self.rig.vehicle.ground_height_m)
        except ShapeError as error:
            raise data_error(error, file=self.rig_file, field=field) from error
        camera = MountedCamera(
            name=name,
            model=camera_model(entry.model, entry.image_size, file=self.rig_file, field=f"{field}.model"),
            vehicle_from_camera=vehicle_from_camera,
            road=road,
            stored_size_px=entry.image_size,
            ego_body=self._ego_body(entry, field),
        )
        return scaled_camera(camera, self.options.evaluated_size_px)

    def images(self, name: str, *, scored: bool) -> tuple[ImageRef, ...]:
        """The images of a camera, by time."""
        entry: CameraRig = self.rig.cameras[name]
        found = self._of(entry.topic, (IMAGE, COMPRESSED_IMAGE), f"cameras.{name}.topic")
        source = CameraSource(
            topic=found.topic, packed=self.index.packed, size_px=entry.image_size, white_level=entry.white_level
        )
        refs = []
        for time_ns, file, place in self._timed(found, entry.time_offset_ns):
            path = file / name / str(time_ns)
            stored = BagImage(file, place, path, source)
            refs.append(ImageRef(camera=name, timestamp_ns=time_ns, path=path, scored=scored, stored=stored))
        return tuple(refs)

    def sweeps(self) -> tuple[SweepRef, ...]:
        """The sweeps of the lidar, by time."""
        entry = self.rig.lidar
        if entry is None:
            return ()
        found = self._of(entry.topic, (POINT_CLOUD,), "lidar.topic")
        source = LidarSource(topic=found.topic, packed=self.index.packed, rig=entry)
        refs = []
        for time_ns, file, place in self._timed(found, entry.time_offset_ns):
            stored = BagSweep(file, place, source)
            path = file / "lidar" / str(time_ns)
            refs.append(SweepRef(timestamp_ns=time_ns, path=path, reader=stored, stored=stored))
        return tuple(refs)

    def vehicle_from_lidar(self) -> RigidTransform:
        """Where the lidar sits."""
        return RigidTransform.identity() if self.rig.lidar is None else self._mounting(self.rig.lidar, "lidar")

    def child_from_vehicle(self) -> RigidTransform:
        """The vehicle in the frame whose poses are told."""
        entry = self.rig.ego_motion.odometry
        if entry is None or (entry.frame is None and entry.vehicle_from_child is None):
            return RigidTransform.identity()
        if entry.vehicle_from_child is not None:
            return entry.vehicle_from_child.transform.inverse()
        assert entry.frame is not None
        return self._vehicle_from(entry.frame, "ego_motion.odometry.frame").inverse()

    def _ego_body(self, entry: CameraRig, field: str) -> NDArray[np.bool_] | None:
        drawn = body_mask(entry.image_size, entry.body_polygons)
        if entry.ego_body_mask is None:
            return drawn
        path = path_inside(self.root, entry.ego_body_mask, file=self.rig_file, field=f"{field}.ego_body_mask")
        mask = read_mask(path, entry.image_size)
        return mask if drawn is None else mask | drawn

    def _mounting(self, entry: Placed, field: str) -> RigidTransform:
        if entry.vehicle_from_sensor is not None:
            return entry.vehicle_from_sensor.transform
        assert entry.frame is not None
        return self._vehicle_from(entry.frame, f"{field}.frame")

    def _vehicle_from(self, frame: str, field: str) -> RigidTransform:
        return self.frames.vehicle_from(
            frame.lstrip("/"), vehicle=self.rig.vehicle.frame.lstrip("/"), file=self.rig_file, field=field
        )

    def _of(self, name: str, types: tuple[str, ...], field: str) -> TopicIndex:
        found = self.index.messages.get(name)
        if found is None or not len(found.log_ns):
            known = ", ".join(sorted(self.index.topics)[:20]) or "none"
            got = f"none in {self.place.name}, which has {known}"
            raise DataError(self.rig_file, field=field, expected=f"messages on {name}", got=got)
        if message_type(found.topic) not in types:
            expected = f"messages {' or '.join(types)}"
            raise DataError(self.place, field=name, expected=expected, got=found.topic.message_type[:80])
        return found

    def _timed(self, found: TopicIndex, offset_ns: int) -> list[tuple[int, Path, Place]]:
        times_ns, valid = usable_times(
            found.log_ns,
            found.stamp_ns,
            clock=self.options.clock,
            what=found.topic.name,
            file=self.place,
            losses=self.losses,
        )
        if not valid.any():
            raise DataError(self.place, field=found.topic.name, expected="messages whose times can be used", got="none")
        kept = zip((times_ns[valid] + offset_ns).tolist(), found.places[valid].tolist(), strict=True)
        return [(time_ns, self.index.files[file], Place(*place)) for time_ns, (file, *place) in kept]

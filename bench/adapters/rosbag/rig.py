"""Options of the card, and the rig file with each sensor's topic, model and mounting."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from bench.adapters.rosbag.messages import full_name
from bench.atomic import MOST_LINK_LEVELS, path_inside
from bench.lidar.fields import TimeUnit
from bench.plain_yaml import parse_yaml
from bench.recordings.files import read_text
from bench.recordings.images import MOST_WHITE
from bench.recordings.mounting import EvaluatedSize, Mounting, Name, Polygon, RollingShutterHead, WhiteLevel
from bench.recordings.validation import FileModel, SidePx, validated

LARGEST_RIG_BYTES = 1_000_000
TopicName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_/~.-]+$"), AfterValidator(full_name)]
FieldPath = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*|\.[0-9]{1,4})*$")]
OffsetNs = Annotated[int, Field(ge=-(10**9), le=10**9)]


class RosbagOptions(FileModel):
    """The card's `options`.

    Attributes:
        rig: the rig file, relative to the data set's root; `{recording}` stands for the recording's name.
        clock: "header", the time that a message carries, or "bag", the time at which it was recorded.
        accept_losses: leave out messages whose times or numbers cannot be used, and use the rest.
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        follow_links: how many levels below `root` links to folders are followed; 1 for bags in `root` itself.
    """

    rig: str = "rig.yaml"
    clock: Literal["header", "bag"] = "header"
    accept_losses: bool = False
    evaluated_size_px: EvaluatedSize = None
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)


class MountedRig(FileModel):
    """A sensor on the vehicle.

    Attributes:
        vehicle_from_sensor: the mounting.
        frame: name of its frame in /tf_static, which then gives the mounting.
    """

    vehicle_from_sensor: Mounting | None = None
    frame: str | None = None

    @model_validator(mode="after")
    def _one(self) -> MountedRig:
        if (self.vehicle_from_sensor is None) == (self.frame is None):
            raise ValueError("one of vehicle_from_sensor, the mounting, and frame, its name in /tf_static")
        return self


class CameraRig(MountedRig):
    """A camera.

    Attributes:
        topic: of images or compressed images.
        model: `model` is the name of a camera model, the rest are its parameters without the image size.
        image_size: width and height of the images, px.
        time_offset_ns: added to the stamp to get the middle of the exposure.
        white_level: value of 16-bit images that is white; fixed, since flow compares images.
        body_polygons: outlines of the ego vehicle's own body, (u, v) in stored pixels.
        rolling_shutter: null where all rows are exposed at once.
    """

    topic: TopicName
    model: dict[str, Any]
    image_size: tuple[SidePx, SidePx]
    time_offset_ns: OffsetNs = 0
    white_level: WhiteLevel = MOST_WHITE
    body_polygons: tuple[Polygon, ...] = ()
    rolling_shutter: RollingShutterHead | None = None


class LidarRig(MountedRig):
    """The lidar.

    Attributes:
        topic: of point clouds, one message for each revolution.
        time_offset_ns: added to the stamp, and with it to the times of the points.
        time_field: the field with times of points; null for the first of the usual names.
        time_unit: its unit; null for the one by which a sweep lasts 10 ms to a second.
        drop_origin: leave out points at the lidar itself, which some drivers store for lost returns.
    """

    topic: TopicName
    time_offset_ns: OffsetNs = 0
    time_field: str | None = None
    time_unit: TimeUnit | None = None
    drop_origin: bool = False


class OdometryRig(FileModel):
    """Poses.

    Attributes:
        topic: of nav_msgs/Odometry, or of stamped poses.
        vehicle_from_child: the frame whose poses they are; without it and `frame` they are the vehicle's.
        frame: the same by its name in /tf_static.
    """

    topic: TopicName
    vehicle_from_child: Mounting | None = None
    frame: str | None = None

    @model_validator(mode="after")
    def _at_most_one(self) -> OdometryRig:
        if self.vehicle_from_child is not None and self.frame is not None:
            raise ValueError("at most one of vehicle_from_child and frame")
        return self


class SignalRig(FileModel):
    """A number in messages.

    Attributes:
        topic: of any message.
        field: path of the number, such as `twist.linear.x`; of several the mean is taken.
        factor: that the value is multiplied with, to m/s and rad/s, and to change a sign.
    """

    topic: TopicName
    field: FieldPath | tuple[FieldPath, ...] = Field(min_length=1)
    factor: float = 1.0


class ReverseRig(FileModel):
    """Field of messages that shows reverse gear.

    Attributes:
        topic: of any message.
        field: path of the value.
        values: those that mean reverse; the speed then counts backwards whatever its sign.
    """

    topic: TopicName
    field: FieldPath
    values: tuple[bool | int | str, ...] = Field(min_length=1)


class EgoMotionRig(FileModel):
    """Source of ego-motion: poses, or speed and yaw rate.

    Attributes:
        odometry: poses.
        speed: m/s, of the middle of the rear axle, along x.
        yaw_rate: rad/s, positive to the left.
        reverse: where the speed has no sign.
        max_gap_ns: poses and signals further apart than this are not joined.
    """

    odometry: OdometryRig | None = None
    speed: SignalRig | None = None
    yaw_rate: SignalRig | None = None
    reverse: ReverseRig | None = None
    max_gap_ns: int = Field(default=500_000_000, gt=0)

    @model_validator(mode="after")
    def _one_way(self) -> EgoMotionRig:
        signals = self.speed is not None and self.yaw_rate is not None
        if signals == (self.odometry is not None) or (self.odometry is not None and (self.speed or self.yaw_rate)):
            raise ValueError("either odometry, or speed and yaw_rate")
        if self.reverse is not None and self.odometry is not None:
            raise ValueError("reverse only with speed and yaw_rate")
        return self


class VehicleRig(FileModel):
    """The ego vehicle.

    Attributes:
        outline_m: x and y of its outline seen from above, vehicle frame.
        ground_height_m: height of the road in the vehicle frame.
        frame: the vehicle frame's name in /tf_static.
    """

    outline_m: Polygon = Field(min_length=3)
    ground_height_m: float = 0.0
    frame: str = "base_link"


class Rig(FileModel):
    """The rig file.

    Attributes:
        vehicle: the ego vehicle.
        cameras: by name.
        lidar: null without one, then nothing can be scored.
        ego_motion: of the ego vehicle.
    """

    vehicle: VehicleRig
    cameras: dict[Name, CameraRig] = Field(min_length=1)
    lidar: LidarRig | None = None
    ego_motion: EgoMotionRig

    @property
    def sensor_topics(self) -> list[str]:
        """Topics of images and point clouds."""
        return [camera.topic for camera in self.cameras.values()] + ([self.lidar.topic] if self.lidar else [])

    @model_validator(mode="after")
    def _topics_once(self) -> Rig:
        topics = self.sensor_topics
        if twice := sorted({topic for topic in topics if topics.count(topic) > 1}):
            raise ValueError(f"each topic for one sensor, {twice[0]} is named twice")
        return self


def read_rig(root: Path, relative: str, *, recording: str, card: Path) -> tuple[Rig, Path]:
    """Read the rig file of a recording.

    Args:
        root: folder of the data set, which the file must not leave.
        relative: as the card names it.
        recording: name that stands for `{recording}`.
        card: for errors.

    Returns:
        The rig, and its file.

    Raises:
        DataError: missing, or not what a rig says.
    """
    file = path_inside(root, relative.replace("{recording}", recording), file=card, field="options.rig")
    content = parse_yaml(read_text(file, largest_bytes=LARGEST_RIG_BYTES), file=file)
    return validated(Rig, content, file=file), file

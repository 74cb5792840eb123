"""KITTI-360's calibration, brought into mounted cameras and the mounting of the lidar.

Frames of the data set: the pose frame is that of the GPS/IMU, x forward, y right, z down; the velodyne frame x
forward, y left, z up; cameras x right, y down, z along the axis. `calib_cam_to_pose` maps points of a camera into the
pose frame, `calib_cam_to_velo` points of camera 00 into the velodyne frame.

The vehicle frame is x forward, y left, z up from the ground below the rear axle. The data set states only where its
sensors are to each other, so the place of the scanner decides: 0.76 m ahead of the rear axle, in the middle of the car
and 1.73 m above the road, as the sensor plan of KITTI has it (Geiger, Lenz and Urtasun 2012: the same car).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from bench.atomic import MOST_LINK_LEVELS, linked_folder, refuse_escape
from bench.cameras import UnifiedCamera
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.plain_yaml import parse_yaml
from bench.recordings.files import numbers, read_text
from bench.recordings.mounting import EvaluatedSize, Polygon, body_mask, mounted_camera
from bench.recordings.validation import FileModel, SidePx, located, validated
from bench.records.recording import MountedCamera

LICENCE = "CC BY-NC-SA 3.0"
CameraName = Literal["image_02", "image_03"]


class FrameExclusion(FileModel):
    """Frames of a sequence that are left out, by their number in the data set.

    Attributes:
        sequence: number of the sequence, such as "0004".
        frames: first and last frame, themselves excluded.
        reason: why.
    """

    sequence: str = Field(pattern=r"^\d{4}$")
    frames: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
    reason: str = Field(min_length=1)

    @model_validator(mode="after")
    def _ordered(self) -> FrameExclusion:
        if self.frames[0] > self.frames[1]:
            raise ValueError("the first frame not after the last")
        return self


class Kitti360Options(FileModel):
    """The card's `options`.

    Attributes:
        cameras: fisheye cameras to evaluate, of those that are there.
        boxes: folder of `data_3d_bboxes` that the boxes come from.
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        field_of_view_deg: per camera, full angle of the lens; absent for as far as the calibration is one-to-one.
        body_polygons: per camera, outlines of the ego vehicle's body, (u, v) in stored pixels.
        lidar_position_m: the laser scanner in the vehicle frame; the calibration gives only places of sensors to each
            other.
        vehicle_outline_m: the ego vehicle seen from above, vehicle frame.
        max_pose_gap_s: poses further apart are not interpolated between, unless the car was stationary.
        stationary_m: poses no further apart than this are of a stationary or creeping car, whatever the time between.
        static_range_m: stationary objects are annotated while they are this near, since they hide what moves.
        static_people: "unclear" ignores people whose box is not marked dynamic, since some of them do walk; "static"
            takes the label at its word.
        excluded_frames: frames that are left out; sequences that are not there are passed over.
        follow_links: how many levels below `root` links to folders are followed; 1 for those in `root` itself.
        licence: of the data.
    """

    cameras: tuple[CameraName, ...] = Field(default=("image_02", "image_03"), min_length=1)
    boxes: Literal["train", "train_full"] = "train"
    evaluated_size_px: EvaluatedSize = None
    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    lidar_position_m: tuple[float, float, float] = (0.76, 0.0, 1.73)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.91), (3.8, -0.91), (3.8, 0.91), (-1.0, 0.91)), min_length=3)
    max_pose_gap_s: float = Field(default=1.0, gt=0)
    stationary_m: float = Field(default=0.5, ge=0)
    static_range_m: float = Field(default=25.0, ge=0)
    static_people: Literal["unclear", "static"] = "unclear"
    excluded_frames: tuple[FrameExclusion, ...] = ()
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)
    licence: str = LICENCE


FOLDER = "calibration"
LARGEST_BYTES = 100_000
TURN_OVER = np.diag([1.0, -1.0, -1.0])  # from y right, z down to y left, z up


class Mirror(FileModel):
    """`mirror_parameters`."""

    xi: float


class Distortion(FileModel):
    """`distortion_parameters`."""

    k1: float
    k2: float
    p1: float
    p2: float


class Projection(FileModel):
    """`projection_parameters`, px."""

    gamma1: float
    gamma2: float
    u0: float
    v0: float


class FisheyeFile(FileModel):
    """`image_02.yaml` and `image_03.yaml`."""

    model_config = ConfigDict(extra="ignore", protected_namespaces=())

    model_type: Literal["MEI"]
    camera_name: str
    image_width: SidePx
    image_height: SidePx
    mirror_parameters: Mirror
    distortion_parameters: Distortion
    projection_parameters: Projection


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """Mountings of all sensors.

    Attributes:
        vehicle_from_imu: of the frame that poses are given for.
        vehicle_from_lidar: of the laser scanner.
        cameras: by name.
    """

    vehicle_from_imu: RigidTransform
    vehicle_from_lidar: RigidTransform
    cameras: dict[str, MountedCamera]


def read_rig(root: Path, cameras: tuple[CameraName, ...], options: Kitti360Options) -> Rig:
    """Read the calibration, which all sequences share.

    Args:
        root: folder of the data set, above `calibration`.
        cameras: which.
        options: sizes, masks and the place of the scanner.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / FOLDER
    within = linked_folder(root, folder, levels=options.follow_links)
    imu_from = _cameras_in_imu(within, folder / "calib_cam_to_pose.txt", ("image_00", *cameras))
    file = folder / "calib_cam_to_velo.txt"
    lidar_from_camera = _transform(_text(within, file).split(), file=file, field="calib_cam_to_velo")
    imu_from_lidar = imu_from["image_00"] @ lidar_from_camera.inverse()
    rotated = RigidTransform(TURN_OVER, np.zeros(3))
    offset_m = np.array(options.lidar_position_m) - rotated.apply(imu_from_lidar.translation_m)
    vehicle_from_imu = RigidTransform(TURN_OVER, offset_m)
    mounted: dict[str, MountedCamera] = {}
    for name in cameras:
        lens = _lens(within, folder / f"{name}.yaml", name, options)
        mounted[name] = mounted_camera(
            name,
            lens,
            vehicle_from_imu @ imu_from[name],
            ego_body=body_mask((lens.width, lens.height), options.body_polygons.get(name, ())),
            evaluated_size_px=options.evaluated_size_px,
            file=folder / "calib_cam_to_pose.txt",
            field=name,
        )
    return Rig(vehicle_from_imu=vehicle_from_imu, vehicle_from_lidar=vehicle_from_imu @ imu_from_lidar, cameras=mounted)


def _lens(root: Path, file: Path, name: CameraName, options: Kitti360Options) -> UnifiedCamera:
    field_deg = options.field_of_view_deg.get(name)
    content = _fisheye(root, file)
    if content.camera_name != name:
        raise DataError(file, field="camera_name", expected=repr(name), got=repr(content.camera_name))
    focal, bend = content.projection_parameters, content.distortion_parameters
    with located(file, name):
        return UnifiedCamera(
            width=content.image_width,
            height=content.image_height,
            xi=content.mirror_parameters.xi,
            focal=(focal.gamma1, focal.gamma2),
            principal_point=(focal.u0, focal.v0),
            radial=(bend.k1, bend.k2),
            tangential=(bend.p1, bend.p2),
            max_angle_rad=None if field_deg is None else float(np.deg2rad(field_deg / 2)),
        )


def _fisheye(root: Path, file: Path) -> FisheyeFile:
    """OpenCV's dialect: a first line `%YAML:1.0` and keys without a blank after the colon are not YAML."""
    lines = [line for line in _text(root, file).splitlines() if not line.startswith("%YAML")]
    spaced = (re.sub(r"^(\s*\w+):(?=\S)", r"\1: ", line) for line in lines)
    values = parse_yaml("\n".join(spaced), file=file)
    if not isinstance(values, dict):
        raise DataError(file, expected="keys and values", got=type(values).__name__)
    return validated(FisheyeFile, values, file=file)


def _cameras_in_imu(root: Path, file: Path, names: tuple[str, ...]) -> dict[str, RigidTransform]:
    lines = [line.partition(":") for line in _text(root, file).splitlines()]
    stated = {name: words for name, colon, words in lines if colon and name in names}
    for name in names:
        if name not in stated:
            raise DataError(file, field=name, expected="a line with 12 numbers", got="none")
    return {name: _transform(stated[name].split(), file=file, field=name) for name in names}


def _transform(words: list[str], *, file: Path, field: str) -> RigidTransform:
    values = numbers(words, 12, file=file, field=field)
    with located(file, field):
        return RigidTransform.from_matrix(np.array(values).reshape(3, 4))


def _text(root: Path, file: Path) -> str:
    refuse_escape(root, file, file=file)
    return read_text(file, largest_bytes=LARGEST_BYTES)

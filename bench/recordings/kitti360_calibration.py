"""KITTI-360's calibration, brought into mounted cameras and the mounting of the lidar.

Frames of the data set: the pose frame is that of the GPS/IMU, x forward, y right, z down; the velodyne frame x
forward, y left, z up; cameras x right, y down, z along the axis. `calib_cam_to_pose` maps points of a camera into the
pose frame, `calib_cam_to_velo` points of camera 00 into the velodyne frame.

The vehicle frame is x forward, y left, z up from the ground below the rear axle. The data set tells only where its
sensors are to each other, so the place of the scanner decides: 0.76 m ahead of the rear axle, in the middle of the car
and 1.73 m above the road, as the sensor plan of KITTI has it (Geiger, Lenz and Urtasun 2012: the same car).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from pydantic import ConfigDict, Field

from bench.cameras import UnifiedCamera
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.body_polygons import body_mask
from bench.recordings.kitti360_options import CameraName, Kitti360Options
from bench.recordings.paths import refuse_escape
from bench.recordings.records import MountedCamera
from bench.recordings.resizing import scaled_camera
from bench.recordings.text_files import numbers, read_text
from bench.recordings.validation import FileModel, data_error, validated

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
    image_width: int = Field(gt=0)
    image_height: int = Field(gt=0)
    mirror_parameters: Mirror
    distortion_parameters: Distortion
    projection_parameters: Projection


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """Where everything sits.

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
    imu_from = _cameras_in_imu(root, folder / "calib_cam_to_pose.txt", ("image_00", *cameras))
    file = folder / "calib_cam_to_velo.txt"
    lidar_from_camera = _transform(_text(root, file).split(), file=file, field="calib_cam_to_velo")
    imu_from_lidar = imu_from["image_00"] @ lidar_from_camera.inverse()
    turned = RigidTransform(TURN_OVER, np.zeros(3))
    offset_m = np.array(options.lidar_position_m) - turned.apply(imu_from_lidar.translation_m)
    vehicle_from_imu = RigidTransform(TURN_OVER, offset_m)
    return Rig(
        vehicle_from_imu=vehicle_from_imu,
        vehicle_from_lidar=vehicle_from_imu @ imu_from_lidar,
        cameras={name: _camera(root, name, vehicle_from_imu @ imu_from[name], options) for name in cameras},
    )


def _camera(
    root: Path, name: CameraName, vehicle_from_camera: RigidTransform, options: Kitti360Options
) -> MountedCamera:
    file = root / FOLDER / f"{name}.yaml"
    content = _fisheye(root, file)
    if content.camera_name != name:
        raise DataError(file, field="camera_name", wanted=repr(name), came=repr(content.camera_name))
    lens, bend = content.projection_parameters, content.distortion_parameters
    size_px = content.image_width, content.image_height
    field_deg = options.field_of_view_deg.get(name)
    try:
        model = UnifiedCamera(
            width=size_px[0],
            height=size_px[1],
            xi=content.mirror_parameters.xi,
            focal=(lens.gamma1, lens.gamma2),
            principal_point=(lens.u0, lens.v0),
            radial=(bend.k1, bend.k2),
            tangential=(bend.p1, bend.p2),
            max_angle_rad=None if field_deg is None else float(np.deg2rad(field_deg / 2)),
        )
        road = RoadPlane.below(vehicle_from_camera)
    except ShapeError as error:
        raise data_error(error, file=file, field=name) from error
    camera = MountedCamera(
        name=name,
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=road,
        stored_size_px=size_px,
        ego_body=body_mask(size_px, options.body_polygons.get(name, ())),
    )
    return scaled_camera(camera, options.evaluated_size_px)


def _fisheye(root: Path, file: Path) -> FisheyeFile:
    """OpenCV's dialect: a first line `%YAML:1.0` and keys without a blank after the colon are not YAML."""
    lines = [line for line in _text(root, file).splitlines() if not line.startswith("%YAML")]
    spaced = (re.sub(r"^(\s*\w+):(?=\S)", r"\1: ", line) for line in lines)
    try:
        values = yaml.safe_load("\n".join(spaced))
    except yaml.YAMLError as error:
        raise DataError(file, wanted="YAML", came=" ".join(str(error).split())) from error
    if not isinstance(values, dict):
        raise DataError(file, wanted="keys and values", came=type(values).__name__)
    return validated(FisheyeFile, values, file=file)


def _cameras_in_imu(root: Path, file: Path, names: tuple[str, ...]) -> dict[str, RigidTransform]:
    found: dict[str, RigidTransform] = {}
    for line in _text(root, file).splitlines():
        name, colon, words = line.partition(":")
        if colon and name in names:
            found[name] = _transform(words.split(), file=file, field=name)
    for name in names:
        if name not in found:
            raise DataError(file, field=name, wanted="a line with 12 numbers", came="none")
    return found


def _transform(words: list[str], *, file: Path, field: str) -> RigidTransform:
    values = numbers(words, 12, file=file, field=field)
    try:
        return RigidTransform.from_matrix(np.array(values).reshape(3, 4))
    except ShapeError as error:
        raise data_error(error, file=file, field=field) from error


def _text(root: Path, file: Path) -> str:
    refuse_escape(root, file, file=file)
    return read_text(file, largest_bytes=LARGEST_BYTES)

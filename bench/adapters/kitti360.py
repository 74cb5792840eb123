"""KITTI-360 (Liao, Xie and Geiger 2022): its two sideways fisheye cameras, laser scans and 3D boxes.

```
calibration/{calib_cam_to_pose,calib_cam_to_velo}.txt, image_02.yaml, image_03.yaml
data_2d_raw/<sequence>/image_0{2,3}/{data_rgb/<frame>.png, timestamps.txt}
data_3d_raw/<sequence>/velodyne_points/data/<frame>.bin
data_poses/<sequence>/poses.txt
data_3d_bboxes/{train,train_full}/<sequence>.xml
```

What is translated here, once:

- A frame number is an instant: the scanner triggers the cameras when it faces forward, and poses are given per frame.
  Everything of a frame has the time that the first evaluated camera notes for it.
- The pose frame is that of the GPS/IMU, x forward, y right, z down; the velodyne frame x forward, y left, z up; cameras
  x right, y down, z along the axis. `calib_cam_to_pose` maps points of a camera into the pose frame,
  `calib_cam_to_velo` points of camera 00 into the velodyne frame.
- The vehicle frame is x forward, y left, z up from the ground below the rear axle. The data set states only where its
  sensors are to each other, so the place of the scanner decides: 0.76 m ahead of the rear axle, in the middle of the
  car and 1.73 m above the road, as the sensor plan of KITTI has it (Geiger, Lenz and Urtasun 2012: the same car).
- The world of the data set becomes one with z up, as `files` says.
- Images outside of the annotated stretches of a drive are left out: what moves there has no box. A drive without a file
  of boxes, as of the test set, is not annotated.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field

from bench.adapters.kitti360_boxes import read_boxes, tracks_from_world
from bench.adapters.kitti_files import (
    TURN_OVER,
    calibration_text,
    read_calibration,
    read_clock,
    read_drive,
    read_turn,
)
from bench.atomic import linked_folder, refuse_escape
from bench.cameras.spheres import UnifiedCamera
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.plain_yaml import parse_yaml
from bench.recordings.annotations import read_annotations
from bench.recordings.catalogue import RecordingHandle, handles_of
from bench.recordings.files import framed_files
from bench.recordings.mounting import FisheyeOptions, Polygon
from bench.recordings.validation import FileModel, ForeignModel, SidePx, in_order, located, validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, ImageRef, MountedCamera, Recording, SweepRef, Track

CALIBRATION, IMAGES, SWEEPS = "calibration", "data_2d_raw", "data_3d_raw"
POSES, BOXES = "data_poses", "data_3d_bboxes"
SEQUENCE = re.compile(r"\d{4}_\d\d_\d\d_drive_(\d{4})_sync")
CameraName = Literal["image_02", "image_03"]
Frame = Annotated[int, Field(ge=0)]


class FrameExclusion(FileModel):
    """Frames of a sequence that are left out, by their number in the data set.

    Attributes:
        sequence: number of the sequence, such as "0004".
        frames: first and last frame, themselves excluded.
        reason: why.
    """

    sequence: str = Field(pattern=r"^\d{4}$")
    frames: Annotated[tuple[Frame, Frame], AfterValidator(in_order)]
    reason: str = Field(min_length=1)


class Kitti360Options(FisheyeOptions[CameraName]):
    """The card's `options`.

    Attributes:
        cameras: fisheye cameras to evaluate, of those that are there.
        boxes: folder of `data_3d_bboxes` that the boxes come from.
        lidar_position_m: the laser scanner in the vehicle frame; the calibration gives only places of sensors to each
            other.
        vehicle_outline_m: the ego vehicle seen from above, vehicle frame.
        excluded_frames: frames that are left out; sequences that are not there are passed over.
    """

    cameras: tuple[CameraName, ...] = Field(default=("image_02", "image_03"), min_length=1)
    boxes: Literal["train", "train_full"] = "train"
    lidar_position_m: tuple[float, float, float] = (0.76, 0.0, 1.73)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.91), (3.8, -0.91), (3.8, 0.91), (-1.0, 0.91)), min_length=3)
    excluded_frames: tuple[FrameExclusion, ...] = ()


def kitti360_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `kitti360`: each sequence below `data_2d_raw` that has fisheye images is a recording.

    Raises:
        DataError: options that are wrong, or a folder without sequences.
    """
    chosen = validated(Kitti360Options, options, file=card, field="options")
    folder = root / IMAGES
    if not folder.is_dir():
        raise DataError(folder, expected="folders of sequences with fisheye images", got="no such folder")
    sequences = sorted(p for p in folder.iterdir() if SEQUENCE.fullmatch(p.name) and _camera_names(p, chosen))
    return handles_of(sequences, partial(open_kitti360, root, options=chosen), annotations)


def open_kitti360(root: Path, folder: Path, options: Kitti360Options, *, annotations: Path | None = None) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set.
        folder: of the sequence's images, called as it.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    sequence, names = folder.name, _camera_names(folder, options)
    if not names:
        raise DataError(folder, expected=f"images of {' or '.join(options.cameras)}", got="none")
    within = partial(linked_folder, root, levels=options.follow_links)

    def inside(file: Path) -> Path:
        refuse_escape(within(file), file, file=file)
        return file

    def framed(place: Path, suffix: str) -> dict[int, Path]:
        return framed_files(within(place), place, rf"(\d{{10}})\.{suffix}")

    vehicle_from_imu, vehicle_from_lidar, cameras = read_rig(root, names, options)
    images = {name: framed(folder / name / "data_rgb", "png") for name in names}
    if not images[names[0]]:
        raise DataError(folder / names[0] / "data_rgb", expected="images <frame, ten digits>.png", got="none")
    clock = read_clock(inside(folder / names[0] / "timestamps.txt"), list(images[names[0]]))
    trajectory, world_from_global = read_drive(inside(root / POSES / sequence / "poses.txt"), clock, vehicle_from_imu)
    boxes = root / BOXES / options.boxes / f"{sequence}.xml"
    tracks: tuple[Track, ...] = ()
    windows: set[tuple[int, int]] = set()
    if annotations is not None:
        tracks = read_annotations(annotations)
    elif boxes.is_file():
        objects, windows = read_boxes(inside(boxes))
        tracks = tracks_from_world(objects, trajectory, world_from_global, clock)
    left_out = [entry.frames for entry in options.excluded_frames if f"_drive_{entry.sequence}_" in sequence]

    def evaluated(files: Mapping[int, Path]) -> list[tuple[int, Path]]:
        """Times and files of frames that are annotated and not left out."""
        return [
            (clock.at(frame, file=path), path)
            for frame, path in files.items()
            if (not windows or _within(frame, windows)) and not _within(frame, left_out)
        ]

    reader = partial(read_turn, period_ns=clock.interval_ns)
    scans = framed(root / SWEEPS / sequence / "velodyne_points" / "data", "bin")
    return Recording(
        name=sequence,
        root=root,
        frame_interval_ns=clock.interval_ns,
        cameras=cameras,
        images={
            name: tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in evaluated(files))
            for name, files in images.items()
        },
        trajectory=trajectory,
        vehicle_from_lidar=vehicle_from_lidar,
        sweeps=tuple(SweepRef(timestamp_ns=t, path=path, reader=reader) for t, path in evaluated(scans)),
        tracks=tracks,
        annotated=COMPLETELY if annotations is not None or boxes.is_file() else NOT_ANNOTATED,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _camera_names(folder: Path, options: Kitti360Options) -> tuple[CameraName, ...]:
    """The cameras of `options` that a sequence has images of."""
    return tuple(name for name in options.cameras if (folder / name / "data_rgb").is_dir())


def _within(frame: int, spans: Iterable[tuple[int, int]]) -> bool:
    return any(first <= frame <= last for first, last in spans)


# Calibration


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


class FisheyeFile(ForeignModel):
    """`image_02.yaml` and `image_03.yaml`."""

    model_config = ConfigDict(protected_namespaces=())

    model_type: Literal["MEI"]
    camera_name: str
    image_width: SidePx
    image_height: SidePx
    mirror_parameters: Mirror
    distortion_parameters: Distortion
    projection_parameters: Projection


def read_rig(
    root: Path, names: tuple[CameraName, ...], options: Kitti360Options
) -> tuple[RigidTransform, RigidTransform, dict[str, MountedCamera]]:
    """Read the calibration, which all sequences share.

    Args:
        root: folder of the data set, above `calibration`.
        names: of the cameras.
        options: sizes, masks and the place of the scanner.

    Returns:
        vehicle_from_imu: of the frame that poses are given for.
        vehicle_from_lidar: of the laser scanner.
        cameras: by name.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / CALIBRATION
    within = linked_folder(root, folder, levels=options.follow_links)
    poses = read_calibration(within, folder / "calib_cam_to_pose.txt")
    lidar_from_camera = read_calibration(within, folder / "calib_cam_to_velo.txt").transform("")
    imu_from_lidar = poses.transform("image_00") @ lidar_from_camera.inverse()
    offset_m = np.array(options.lidar_position_m) - TURN_OVER @ imu_from_lidar.translation_m
    vehicle_from_imu = RigidTransform(TURN_OVER, offset_m)
    cameras: dict[str, MountedCamera] = {}
    for name in names:
        lens = _lens(within, folder / f"{name}.yaml", name, options)
        mounting = vehicle_from_imu @ poses.transform(name)
        with located(poses.file, name):
            cameras[name] = options.mounted(name, lens, mounting)
    return vehicle_from_imu, vehicle_from_imu @ imu_from_lidar, cameras


def _lens(root: Path, file: Path, name: CameraName, options: Kitti360Options) -> UnifiedCamera:
    # OpenCV's dialect: a first line `%YAML:1.0` and keys without a blank after the colon are not YAML.
    lines = [line for line in calibration_text(root, file).splitlines() if not line.startswith("%YAML")]
    values = parse_yaml("\n".join(re.sub(r"^(\s*\w+):(?=\S)", r"\1: ", line) for line in lines), file=file)
    if not isinstance(values, dict):
        raise DataError(file, expected="keys and values", got=type(values).__name__)
    content = validated(FisheyeFile, values, file=file)
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
            max_angle_rad=options.max_angle_rad(name),
        )

"""KITTI's raw drives (Geiger, Lenz, Stiller and Urtasun 2013), synchronised and rectified.

```
<date>/calib_{cam_to_cam,velo_to_cam,imu_to_velo}.txt
<date>/<date>_drive_<number>_sync/
  image_0{0,1,2,3}/{data/<frame>.png, timestamps.txt}
  velodyne_points/{data/<frame>.bin, timestamps.txt}
  oxts/{data/<frame>.txt, timestamps.txt}
  tracklet_labels.xml
```

What is translated here, once:

- The vehicle frame has the axes of the GPS/IMU (x forward, y left, z up) and its origin on the road below the middle of
  the rear axle; the calibration gives only places of sensors to each other, so that the card's option says where the
  laser scanner sits.
- Each sensor has its own times of frames, of one clock. A scan has the time at which the scanner faces forward, when it
  triggers the cameras; it turns to the left, so that a point at azimuth a was measured a/(2 pi) of a turn later.
- Latitude and longitude become metres by a Mercator projection that is true to scale at the first frame.
- A tracklet's boxes are those of the scans with its frame numbers: its first frame plus the number of the pose. Length
  is along x, width along y, height along z, and the place is the middle of the bottom. How they move is taken from
  their places.
- A drive without tracklets is not annotated. Tracklets are of what the cameras see.

Of a pose in `tracklet_labels.xml`, `state` is 0 unset, 1 interpolated, 2 labelled; `occlusion` -1 unset, 0 visible, 1
partly, 2 fully; `truncation` -1 unset, 0 in the image, 1 cut off (some tools write the share), 2 outside, 99 behind.
Other tools write files of the same tags with other meanings (`bench.annotation.formats.tracklets`).

Sources:
    The raw data's readme and development kit (`convertOxtsToPose.m`, `run_demoVelodyne.m`, `tracklets.h`,
    `readTracklets.m`).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from bench.adapters.kitti_files import read_calibration, read_clock, read_turn
from bench.atomic import linked_folder, refuse_escape
from bench.cameras.pinhole import PinholeCamera
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.annotations import box_state, read_annotations
from bench.recordings.catalogue import RecordingHandle, handles_of
from bench.recordings.files import framed_files, numbers, read_text, xml_parts
from bench.recordings.mounting import CameraOptions, Polygon
from bench.recordings.validation import located, validated
from bench.records.recording import (
    COMPLETELY,
    NOT_ANNOTATED,
    ImageRef,
    MountedCamera,
    ObjectState,
    Recording,
    SweepRef,
    Track,
    world_velocities,
    world_yaw_rates,
)

CameraName = Literal["image_00", "image_01", "image_02", "image_03"]
DRIVE = re.compile(r"\d{4}_\d\d_\d\d_drive_\d{4}_sync")
SCANS, MOTION, TRACKLETS = "velodyne_points", "oxts", "tracklet_labels.xml"
OXTS_FIELDS = 30  # latitude, longitude (degrees), altitude (m), roll, pitch, yaw (rad, yaw from east to the left), ...
EARTH_M = 6_378_137.0
LARGEST_ITEM_BYTES = 8_000_000  # ten thousand poses, a quarter of an hour
DEEPEST = 12  # levels of nested elements; the format has six, attributes that tools add two more
UNSET, LABELLED = 0, 2
CUT_OFF, OUTSIDE = 1, (2, 99)  # truncation
ID_ATTRIBUTE = "id"
POSE = ("tx", "ty", "tz", "rx", "ry", "rz")
UPRIGHT_RAD = 1e-6
CLASSES = {
    "Car": "vehicle", "Van": "vehicle", "Truck": "vehicle", "Tram": "vehicle", "Misc": "vehicle",
    "Pedestrian": "pedestrian", "Person (sitting)": "pedestrian", "Cyclist": "cyclist",
}  # fmt: skip


class KittiRawOptions(CameraOptions[CameraName]):
    """The card's `options`.

    Attributes:
        cameras: those to evaluate, of those that are there.
        lidar_position_m: the laser scanner in the vehicle frame.
        vehicle_outline_m: the ego vehicle seen from above, vehicle frame.
    """

    cameras: tuple[CameraName, ...] = Field(default=("image_02",), min_length=1)
    lidar_position_m: tuple[float, float, float] = (0.76, 0.0, 1.73)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.91), (3.8, -0.91), (3.8, 0.91), (-1.0, 0.91)), min_length=3)


def kitti_raw_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `kitti-raw`: each `<date>/<drive>_sync` is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(KittiRawOptions, options, file=card, field="options")
    drives = sorted(path for path in root.glob("*/*") if DRIVE.fullmatch(path.name) and path.is_dir())
    return handles_of(drives, partial(open_kitti_raw, root, options=chosen), annotations)


def open_kitti_raw(root: Path, folder: Path, options: KittiRawOptions, *, annotations: Path | None = None) -> Recording:
    """Open a drive.

    Args:
        root: folder of the data set, above the dates.
        folder: of the drive.
        options: as in the card.
        annotations: annotation file that stands in for the tracklets; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    within = linked_folder(root, folder, levels=options.follow_links)
    names = [name for name in options.cameras if (folder / name / "data").is_dir()]
    if not names:
        raise DataError(folder, expected=f"images of {' or '.join(options.cameras)}", got="none")
    vehicle_from_lidar, vehicle_from_imu, cameras = _read_rig(root, folder.parent, names, options)
    images = {name: _timed_files(within, folder / name, "png") for name in names}
    scans, turn_ns = _timed_files(within, folder / SCANS, "bin")
    trajectory = _trajectory(within, folder / MOTION, vehicle_from_imu)
    reader = partial(read_turn, period_ns=turn_ns, to_the_left=True)
    tracklets = folder / TRACKLETS
    refuse_escape(within, tracklets, file=tracklets)
    if annotations is not None:
        tracks: tuple[Track, ...] = read_annotations(annotations)
    else:
        _, _, driven = trajectory.at(np.array([time_ns for time_ns, _ in scans.values()], dtype=np.int64))
        times_ns = {frame: time_ns for (frame, (time_ns, _)), here in zip(scans.items(), driven, strict=True) if here}
        tracks = _tracks(tracklets, times_ns, vehicle_from_lidar, trajectory) if tracklets.is_file() else ()
    return Recording(
        name=folder.name,
        root=root,
        frame_interval_ns=images[names[0]][1],
        cameras=cameras,
        images={
            name: tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in files.values())
            for name, (files, _) in images.items()
        },
        trajectory=trajectory,
        vehicle_from_lidar=vehicle_from_lidar,
        sweeps=tuple(SweepRef(timestamp_ns=t, path=path, reader=reader) for t, path in scans.values()),
        tracks=tracks,
        annotated=COMPLETELY if annotations is not None or tracklets.is_file() else NOT_ANNOTATED,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _timed_files(root: Path, folder: Path, suffix: str) -> tuple[dict[int, tuple[int, Path]], int]:
    """Times and files of a sensor by frame, and the time between two of them, ns."""
    files = framed_files(root, folder / "data", rf"(\d{{10}})\.{suffix}")
    if not files:
        raise DataError(folder / "data", expected=f"files <frame, ten digits>.{suffix}", got="none")
    file = folder / "timestamps.txt"
    refuse_escape(root, file, file=file)
    clock = read_clock(file, list(files))
    return {frame: (clock.at(frame, file=path), path) for frame, path in files.items()}, clock.interval_ns


def _read_rig(
    root: Path, folder: Path, names: list[CameraName], options: KittiRawOptions
) -> tuple[RigidTransform, RigidTransform, dict[str, MountedCamera]]:
    """Mountings of the laser scanner and of the GPS/IMU, and the cameras."""
    within = linked_folder(root, folder, levels=options.follow_links)
    lenses = read_calibration(within, folder / "calib_cam_to_cam.txt")
    imu = read_calibration(within, folder / "calib_imu_to_velo.txt")
    velodyne = read_calibration(within, folder / "calib_velo_to_cam.txt")
    lidar_from_imu = imu.transform("R", imu.numbers("T", 3))
    camera_0_from_lidar = velodyne.transform("R", velodyne.numbers("T", 3))
    vehicle_from_lidar = RigidTransform(lidar_from_imu.rotation.T, np.array(options.lidar_position_m))
    rectified_from_camera_0 = lenses.transform("R_rect_00", np.zeros(3))
    cameras: dict[str, MountedCamera] = {}
    for name in names:
        number = name.removeprefix("image_")
        width, height = lenses.numbers(f"S_rect_{number}", 2).tolist()
        projection = lenses.numbers(f"P_rect_{number}", 3, 4)
        with located(lenses.file, f"P_rect_{number}"):
            lens = PinholeCamera(
                width=round(width),
                height=round(height),
                focal=(float(projection[0, 0]), float(projection[1, 1])),
                principal_point=(float(projection[0, 2]), float(projection[1, 2])),
            )
            if not np.linalg.det(projection[:, :3]) > 0:
                raise ShapeError("expected a camera, its focal lengths and a 1 in the diagonal, got another matrix")
            offset_m = np.asarray(np.linalg.solve(projection[:, :3], projection[:, 3]), dtype=np.float64)
            camera_from_rectified = RigidTransform(np.eye(3), offset_m)
            camera_from_lidar = camera_from_rectified @ rectified_from_camera_0 @ camera_0_from_lidar
            cameras[name] = options.mounted(name, lens, vehicle_from_lidar @ camera_from_lidar.inverse())
    return vehicle_from_lidar, vehicle_from_lidar @ lidar_from_imu, cameras


def _trajectory(root: Path, folder: Path, vehicle_from_imu: RigidTransform) -> Trajectory:
    """Poses of the vehicle in a world that begins below the first one; x is east, z is up."""
    files, _ = _timed_files(root, folder, "txt")
    times_ns, paths = zip(*files.values(), strict=True)
    rows = np.array([numbers(read_text(f).split(), OXTS_FIELDS, file=f, field="oxts") for f in paths])
    latitude, longitude = np.radians(rows[:, 0]), np.radians(rows[:, 1])
    if not (np.abs(latitude) < np.radians(85.0)).all():
        raise DataError(folder / "data", field="latitude", expected="between -85 and 85 degrees", got="another")
    scale_m = np.cos(latitude[0]) * EARTH_M
    north = np.log(np.tan(np.pi / 4 + latitude / 2))
    positions_m = np.column_stack([scale_m * longitude, scale_m * north, rows[:, 2]])
    world_from_imu = Rotation.from_euler("ZYX", rows[:, [5, 4, 3]])
    rotations = world_from_imu * Rotation.from_matrix(vehicle_from_imu.rotation.T)
    positions_m += world_from_imu.as_matrix() @ vehicle_from_imu.inverse().translation_m
    return Trajectory(
        source=str(folder / "data"),
        timestamps_ns=np.array(times_ns, dtype=np.int64),
        rotations=rotations,
        positions_m=positions_m - positions_m[0],
    )


# Tracklets


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackletPose:
    """An object in one frame; numbers as the file has them.

    Attributes:
        number: of the frame.
        place_m: tx, ty, tz in the frame of the lidar.
        angles_rad: rx, ry, rz.
        state: see the module.
        occlusion: see the module.
        truncation: see the module.
    """

    number: int
    place_m: tuple[float, ...]
    angles_rad: tuple[float, ...]
    state: int
    occlusion: int
    truncation: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracklet:
    """An object.

    Attributes:
        label: class, as the tool calls it.
        hwl_m: what the file calls h, w and l.
        poses: by frame.
        name: the object's id; empty where it has none.
        not_read: how many other attributes it and its poses carry.
    """

    label: str
    hwl_m: tuple[float, ...]
    poses: tuple[TrackletPose, ...]
    name: str
    not_read: int


def read_tracklets(file: Path) -> tuple[Tracklet, ...]:
    """Read a file of tracklets; what it states as counts is not used.

    Raises:
        DataError: missing, cut short, not XML, with entities, nested too deeply, a number that is missing or none,
            nothing in it but a count of 0.
    """
    tracklets: list[Tracklet] = []
    counts: list[str] = []
    for element in xml_parts(
        file,
        level=2,
        parts="tracklets",
        largest_bytes=LARGEST_ITEM_BYTES,
        deepest=DEEPEST,
        outer=("boost_serialization", "tracklets"),
    ):
        if element.tag == "count":
            counts.append((element.text or "").strip())
        elif element.tag == "item":
            tracklets.append(_tracklet(element, file, f"tracklets.item {len(tracklets)}"))
    if not tracklets and counts != ["0"]:
        raise DataError(file, field="tracklets", expected="tracklets, or a count of 0", got="neither")
    return tuple(tracklets)


def _tracklet(item: Element, file: Path, field: str) -> Tracklet:
    label = (item.findtext("objectType") or "").strip()
    if not label:
        raise DataError(file, field=f"{field}.objectType", expected="a class", got="nothing")
    hwl_m = tuple(_number(item, name, file, field) for name in "hwl")
    if min(hwl_m) <= 0:
        raise DataError(file, field=f"{field}.h, w, l", expected="sizes above 0", got=str(hwl_m))
    attributes = [(entry.findtext("name"), (entry.findtext("value") or "").strip()) for entry in item.iter("attribute")]
    names = [value for name, value in attributes if name == ID_ATTRIBUTE]
    first = _whole(item, "first_frame", file, field)
    entries = item.findall("poses/item")
    poses = tuple(_pose(entry, first + j, file, f"{field}.poses.item {j}") for j, entry in enumerate(entries))
    name = next(filter(None, names), "")
    return Tracklet(label=label, hwl_m=hwl_m, poses=poses, name=name, not_read=len(attributes) - len(names))


def _pose(entry: Element, number: int, file: Path, field: str) -> TrackletPose:
    tx, ty, tz, rx, ry, rz = (_number(entry, name, file, field) for name in POSE)
    share = re.fullmatch(r"0?\.[0-9]{1,20}", (entry.findtext("truncation") or "").strip())
    return TrackletPose(
        number=number,
        place_m=(tx, ty, tz),
        angles_rad=(rx, ry, rz),
        state=_whole(entry, "state", file, field, default=LABELLED),
        occlusion=_whole(entry, "occlusion", file, field, default=-1),
        truncation=CUT_OFF if share else _whole(entry, "truncation", file, field, default=-1),
    )


def _number(element: Element, name: str, file: Path, field: str) -> float:
    return numbers((element.findtext(name) or "").split(), 1, file=file, field=f"{field}.{name}")[0]


def _whole(element: Element, name: str, file: Path, field: str, default: int | None = None) -> int:
    text = element.findtext(name)
    if text is None and default is not None:
        return default
    text = (text or "").strip()
    if not re.fullmatch(r"-?[0-9]{1,9}", text):
        got = repr(text[:40]) if text else "nothing"
        raise DataError(file, field=f"{field}.{name}", expected="a whole number", got=got)
    return int(text)


def upright_box(pose: TrackletPose, height_m: float, file: Path, field: str) -> RigidTransform:
    """Pose of the box's centre in the frame of the lidar.

    Raises:
        DataError: a box that is tilted.
    """
    rx, ry, rz = pose.angles_rad
    if max(abs(rx), abs(ry)) > UPRIGHT_RAD:
        hint = "files of CVAT, which turns boxes about all axes, are read as cvat"
        raise DataError(file, field=f"{field}.rx, ry", expected="0", got=f"{rx:.4g} and {ry:.4g}", hint=hint)
    return RigidTransform.from_yaw(rz, np.add(pose.place_m, (0.0, 0.0, height_m / 2.0)))


def _tracks(
    file: Path, times_ns: Mapping[int, int], vehicle_from_lidar: RigidTransform, trajectory: Trajectory
) -> tuple[Track, ...]:
    """Tracks from tracklets; poses of other frames are left out.

    Args:
        file: of the tracklets.
        times_ns: of the scans at which there is ego-motion, by frame.
        vehicle_from_lidar: mounting of the scanner, in whose frame tracklets are.
        trajectory: of the vehicle.
    """
    numbered: dict[str, int] = defaultdict(int)
    tracks = []
    for i, tracklet in enumerate(read_tracklets(file)):
        field, label = f"tracklets.item {i}", tracklet.label
        if label not in CLASSES:
            expected = f"one of {', '.join(CLASSES)}"
            raise DataError(file, field=f"{field}.objectType", expected=expected, got=label[:40])
        numbered[label] += 1
        poses = [pose for pose in tracklet.poses if pose.state != UNSET and pose.number in times_ns]
        boxes = [
            vehicle_from_lidar @ upright_box(pose, tracklet.hwl_m[0], file, f"{field}, frame {pose.number}")
            for pose in poses
        ]
        at_ns = np.array([times_ns[pose.number] for pose in poses], dtype=np.int64)
        states = _states(at_ns, boxes, tracklet.hwl_m[::-1], trajectory)
        tracks.append(Track(track_id=f"{label} {numbered[label]}", object_class=CLASSES[label], states=states))
    return tuple(track for track in tracks if track.states)


def _states(
    at_ns: NDArray[np.int64], boxes: list[RigidTransform], size_m: tuple[float, ...], trajectory: Trajectory
) -> tuple[ObjectState, ...]:
    """States of boxes of one size, which move as their places in the world do."""
    rotations, positions_m, _ = trajectory.at(at_ns)
    centres = np.array([box.translation_m for box in boxes]).reshape(-1, 3)
    turned = np.array([box.rotation for box in boxes]).reshape(-1, 3, 3)
    velocities = world_velocities(at_ns, np.einsum("nij,nj->ni", rotations, centres) + positions_m)
    yaw_rates_radps = world_yaw_rates(at_ns, rotations @ turned)
    return tuple(
        box_state(at_ns[i], boxes[i], size_m, rotations[i].T @ velocities[i], yaw_rates_radps[i])
        for i in range(len(boxes))
    )

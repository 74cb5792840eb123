"""The aiMotive multimodal data set (Matuszka et al. 2022).

```
data/<split>/<odd>/<sequence>/
  sensor/calibration/calibration.json           per camera: model and RT_body_from_sensor; MEI's are evaluated
  sensor/camera/<CAMERA>/<CAMERA>_<frame>.jpg
  dynamic/raw-revolutions/frame_<frame>.laz     body frame at each point's own time; gps_time in ns
  dynamic/box/3d_body/frame_<frame>.json        time of the frame and tracked boxes
  sensor/gnssins/egomotion.json                 pose of each frame; where the card names no other ego-motion
```

What is translated here, once:

- The body frame is x forward, y left, z up, but its origin is not on the road: the card's `ground_height_m` says where
  the road is. It serves as the vehicle frame as it stands.
- An image has the time of the box file with its number.
- Points are in body axes already, so `vehicle_from_lidar` is the identity and `lidar_from_sensor` the mounting of the
  sensor.
- A revolution runs from about 68 ms before to 32 ms after the time of its frame, in the same clock. Frames are 67 ms
  apart, so neighbouring revolutions share the points of 33 ms; an image takes those of one revolution only.
- Boxes state velocity relative to the ego vehicle in body axes; over the ground it is the ego's velocity plus that. The
  turn of an object comes from the headings of its boxes.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, RootModel
from scipy.spatial.transform import Rotation

from bench.atomic import linked_folder, path_inside, refuse_escape
from bench.cameras.spheres import UnifiedCamera
from bench.egomotion.files import read_bus_signals
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.files import read_sweep
from bench.recordings.annotations import box_state, read_annotations
from bench.recordings.catalogue import RecordingHandle, handles_of
from bench.recordings.files import framed_files
from bench.recordings.mounting import FisheyeOptions, Polygon
from bench.recordings.validation import (
    FileModel,
    ForeignModel,
    SidePx,
    TimeNs,
    located,
    number_from_text,
    read_json,
    validated,
)
from bench.records.recording import (
    COMPLETELY,
    ImageRef,
    MountedCamera,
    Recording,
    SweepRef,
    Track,
    world_yaw_rates,
)

CALIBRATION, EGO_MOTION = "sensor/calibration/calibration.json", "sensor/gnssins/egomotion.json"
BOXES, SWEEPS = "dynamic/box/3d_body", "dynamic/raw-revolutions"
FRAME_INTERVAL_NS = 66_666_667
AXES_M = np.array([6_378_137.0, 6_378_137.0, 6_356_752.3142])  # of the WGS 84 ellipsoid
CLASSES = {
    **dict.fromkeys(("CAR", "VAN", "TRUCK", "TRUCK/BUS", "BUS", "TRAILER", "TRAIN", "OTHER_VEHICLE"), "vehicle"),
    "PEDESTRIAN": "pedestrian",
    **dict.fromkeys(("BICYCLE", "MOTORCYCLE", "BIKE", "RIDER", "RIDEABLE_VEHICLE"), "cyclist"),
    **dict.fromkeys(("ANIMAL", "OTHER_ANIMAL"), "animal"),
}


class EgoMotionOptions(FileModel):
    """Source of ego-motion.

    Attributes:
        file: CSV file, relative to the data set's root; `{sequence}` stands for the sequence's name.
        columns: as `bench.egomotion.read_bus_signals` takes them.
    """

    file: str
    columns: dict[str, str | float | tuple[str, ...]] = Field(default_factory=dict)


class AimotiveOptions(FisheyeOptions[str]):
    """The card's `options`.

    Attributes:
        cameras: those to evaluate; null for every fisheye camera that has images.
        ego_motion: where ego-motion comes from; null for the data set's own `egomotion.json`.
        ground_height_m: height of the road in the body frame.
        vehicle_outline_m: the ego vehicle seen from above, body frame, where the size of the ego vehicle is known.
    """

    cameras: tuple[str, ...] | None = None
    ego_motion: EgoMotionOptions | None = None
    ground_height_m: float = 0.0
    vehicle_outline_m: Polygon = Field(default=((-1.1, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.1, 0.95)), min_length=3)


def aimotive_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `aimotive`: each `data/<split>/<odd>/<sequence>` is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(AimotiveOptions, options, file=card, field="options")
    sequences = sorted(path for path in root.glob("data/*/*/*") if path.is_dir())
    return handles_of(sequences, partial(open_aimotive, root, options=chosen), annotations)


def open_aimotive(root: Path, folder: Path, options: AimotiveOptions, *, annotations: Path | None = None) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set, above `data`.
        folder: of the sequence.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    within = linked_folder(root, folder, levels=options.follow_links)
    cameras, lidar_from_sensor = read_calibration(within, folder, options)
    frames = _box_files(within, folder)
    times_ns = {number: content.timestamp_ns for number, content in frames.items()}
    if options.ego_motion is None:
        trajectory = _own_trajectory(within, folder, times_ns)
    else:
        name = options.ego_motion.file.replace("{sequence}", folder.name)
        path = path_inside(root, name, file=root, field="options.ego_motion.file")
        trajectory = read_bus_signals(path, columns=options.ego_motion.columns)
    images: dict[str, tuple[ImageRef, ...]] = {}
    for name in cameras:
        place = folder / "sensor/camera" / name
        paths = framed_files(within, place, rf"{re.escape(name)}_(\d+)\.(?:jpg|png)")
        if not paths:
            raise DataError(place, expected=f"images {name}_<number>.jpg", got="none")
        images[name] = tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in _timed(paths, times_ns))
    revolutions = framed_files(within, folder / SWEEPS, r"frame_(\d+)\.laz")
    return Recording(
        name=folder.name,
        root=root,
        frame_interval_ns=FRAME_INTERVAL_NS,
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=tuple(
            SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in _timed(revolutions, times_ns)
        ),
        tracks=_tracks(frames, trajectory) if annotations is None else read_annotations(annotations),
        annotated=COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
        lidar_from_sensor=lidar_from_sensor,
    )


def _timed(paths: Mapping[int, Path], times_ns: Mapping[int, int]) -> Iterator[tuple[int, Path]]:
    """Files with the times of their frames."""
    for number, path in paths.items():
        if number not in times_ns:
            raise DataError(path, expected=f"{BOXES}/frame_{number:07d}.json with its time", got="no such file")
        yield times_ns[number], path


class Entries(RootModel[dict[str, Any]]):
    """Calibrations by sensor, or poses by frame number; entries that are not used may be any."""


Matrix = Annotated[tuple[tuple[float, float, float, float], ...], Field(min_length=4, max_length=4)]


# Calibration


class SensorCalibration(ForeignModel):
    """The key of any sensor's calibration that is used; the file has many more."""

    RT_body_from_sensor: Matrix


class CameraCalibration(SensorCalibration):
    """The keys of a fisheye camera's calibration that are used."""

    model: Literal["mei"]
    xi: float
    focal_length_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    distortion_coeffs: tuple[float, ...] = Field(min_length=4)
    image_resolution_px: tuple[SidePx, SidePx]


def read_calibration(
    root: Path, folder: Path, options: AimotiveOptions
) -> tuple[dict[str, MountedCamera], RigidTransform]:
    """Read the calibration of a sequence.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.
        options: which cameras, at which size, with which masks.

    Returns:
        cameras: by name.
        body_from_beams: of the one lidar that is named. Points come in body axes, so it serves only to find rows and
            columns of beams. The identity where no lidar is named, or several whose points are mixed: surface-patch
            polygons then have no rows.

    Raises:
        DataError: a missing file, a camera without a calibration, one of another model, or a mounting that is none.
    """
    file = folder / CALIBRATION
    refuse_escape(root, file, file=file)
    content = read_json(Entries, file).root
    names = options.cameras
    if names is None:
        present = sorted(path.name for path in folder.glob("sensor/camera/*") if path.is_dir())
        # An entry that is missing or no object is reported below.
        names = tuple(n for n in present if not isinstance(e := content.get(n), dict) or e.get("model") == "mei")
    if not names:
        raise DataError(folder / "sensor/camera", expected="images of a fisheye camera", got="none")
    for name in names:
        if name not in content:
            raise DataError(file, field=name, expected="a calibration of this camera", got="none")
    cameras = {name: _camera(name, content[name], file, options) for name in names}
    lidars = [n for n, entry in content.items() if isinstance(entry, dict) and entry.get("sensor_type") == "lidar"]
    if len(lidars) != 1:
        return cameras, RigidTransform.identity()
    entry = validated(SensorCalibration, content[lidars[0]], file=file, field=lidars[0])
    with located(file, f"{lidars[0]}.RT_body_from_sensor"):
        return cameras, RigidTransform.from_matrix(entry.RT_body_from_sensor)


def _camera(name: str, content: Mapping[str, Any], file: Path, options: AimotiveOptions) -> MountedCamera:
    entry = validated(CameraCalibration, content, file=file, field=name)
    k1, k2, p1, p2, *others = entry.distortion_coeffs
    if any(others):
        expected, got = "k1, k2, p1, p2, 0", "further ones that are not 0"
        raise DataError(file, field=f"{name}.distortion_coeffs", expected=expected, got=got)
    with located(file, name):
        vehicle_from_camera = RigidTransform.from_matrix(entry.RT_body_from_sensor)
        lens = UnifiedCamera(
            width=entry.image_resolution_px[0],
            height=entry.image_resolution_px[1],
            xi=entry.xi,
            focal=entry.focal_length_px,
            principal_point=entry.principal_point_px,
            radial=(k1, k2),
            tangential=(p1, p2),
            max_angle_rad=options.max_angle_rad(name),
        )
        return options.mounted(name, lens, vehicle_from_camera, ground_height_m=options.ground_height_m)


# Ego-motion


def _own_trajectory(root: Path, folder: Path, times_ns: Mapping[int, int]) -> Trajectory:
    """The poses of the data set.

    The file maps frame numbers to entries with a 4 x 4 matrix that takes points of the body into the earth-centred,
    earth-fixed frame. The world here begins at the first pose, with z along the local vertical.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.
        times_ns: of frames, from the files of boxes; poses of other frames are passed over.
    """
    file = folder / EGO_MOTION
    refuse_escape(root, file, file=file)
    content = read_json(Entries, file).root
    keys = {int(key): key for key in content if key.isascii() and key.isdigit() and len(key) < 10}
    frames = sorted(keys.keys() & times_ns.keys())
    poses = [_earth_from_body(content[keys[frame]], keys[frame], file) for frame in frames]
    if len(poses) < 2:
        expected = f"poses of two frames at least, of those from {min(times_ns)} to {max(times_ns)}"
        raise DataError(file, expected=expected, got=str(len(poses)))
    start_m = poses[0].translation_m
    upright = _upright(start_m)
    world_from_earth = RigidTransform(upright, -upright @ start_m)
    placed = [world_from_earth @ pose for pose in poses]
    return Trajectory(
        source=str(file),
        timestamps_ns=np.array([times_ns[frame] for frame in frames], dtype=np.int64),
        rotations=Rotation.from_matrix(np.stack([pose.rotation for pose in placed])),
        positions_m=np.stack([pose.translation_m for pose in placed]),
    )


class FramePose(ForeignModel):
    """The key of a frame in `egomotion.json` that is used."""

    RT_ECEF_body: Matrix


def _earth_from_body(entry: Any, key: str, file: Path) -> RigidTransform:
    pose = validated(FramePose, entry, file=file, field=key)
    with located(file, f"{key}.RT_ECEF_body"):
        return RigidTransform.from_matrix(pose.RT_ECEF_body)


def _upright(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation that turns the local vertical at a place on the earth to z; which way x looks does not matter."""
    if not np.linalg.norm(position_m) > 1_000_000.0:  # a local frame, with z up already
        return np.eye(3)
    up = position_m / AXES_M**2
    up = up / np.linalg.norm(up)
    east = np.cross([0.0, 0.0, 1.0], up) if abs(up[2]) < 0.99 else np.cross([1.0, 0.0, 0.0], up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


# Boxes


class Box(ForeignModel):
    """One object of a box file."""

    object_id: int = Field(alias="ObjectId")
    object_type: str = Field(alias="ObjectType")
    x: float = Field(alias="BoundingBox3D Origin X")
    y: float = Field(alias="BoundingBox3D Origin Y")
    z: float = Field(alias="BoundingBox3D Origin Z")
    length_m: float = Field(alias="BoundingBox3D Extent X", gt=0)
    width_m: float = Field(alias="BoundingBox3D Extent Y", gt=0)
    height_m: float = Field(alias="BoundingBox3D Extent Z", gt=0)
    qw: float = Field(alias="BoundingBox3D Orientation Quat W")
    qx: float = Field(alias="BoundingBox3D Orientation Quat X")
    qy: float = Field(alias="BoundingBox3D Orientation Quat Y")
    qz: float = Field(alias="BoundingBox3D Orientation Quat Z")
    velocity_x: float = Field(alias="Relative Velocity X")
    velocity_y: float = Field(alias="Relative Velocity Y")
    velocity_z: float = Field(alias="Relative Velocity Z")


class BoxFile(FileModel):
    """The boxes of one frame."""

    timestamp_ns: Annotated[TimeNs, BeforeValidator(number_from_text)] = Field(alias="Timestamp")
    boxes: tuple[Box, ...] = Field(alias="CapturedObjects")


def _box_files(root: Path, folder: Path) -> dict[int, BoxFile]:
    """The box files of a sequence by frame number; their times increase."""
    place = folder / BOXES
    files = framed_files(root, place, r"frame_(\d+)\.json")
    if not files:
        raise DataError(place, expected="files frame_<number>.json, which hold the times of frames", got="none")
    frames: dict[int, BoxFile] = {}
    before: BoxFile | None = None
    for number, file in files.items():
        frames[number] = content = read_json(BoxFile, file)
        _check_objects(content, file)
        if before is not None and content.timestamp_ns <= before.timestamp_ns:
            got = f"{content.timestamp_ns} after {before.timestamp_ns}"
            raise DataError(file, field="Timestamp", expected="times that increase", got=got)
        before = content
    return frames


def _check_objects(content: BoxFile, file: Path) -> None:
    seen: set[int] = set()
    for i, box in enumerate(content.boxes):
        field = f"CapturedObjects.{i}"
        if box.object_type not in CLASSES:
            known = f"one of {', '.join(CLASSES)}"
            raise DataError(file, field=f"{field}.ObjectType", expected=known, got=repr(box.object_type[:40]))
        if box.object_id in seen:
            raise DataError(file, field=f"{field}.ObjectId", expected="each object once", got=f"{box.object_id} twice")
        if not any((box.qw, box.qx, box.qy, box.qz)):
            raise DataError(file, field=f"{field}.BoundingBox3D Orientation Quat", expected="a quaternion", got="zeros")
        seen.add(box.object_id)


def _tracks(frames: Mapping[int, BoxFile], trajectory: Trajectory) -> tuple[Track, ...]:
    """Boxes joined by their number, with the ego-motion added to their velocities; by object number."""
    by_object: dict[int, list[tuple[int, Box]]] = defaultdict(list)
    ego_mps = {}
    for frame in frames.values():
        ego_mps[frame.timestamp_ns] = trajectory.velocity_vehicle_mps(frame.timestamp_ns)
        for box in frame.boxes:
            by_object[box.object_id].append((frame.timestamp_ns, box))
    return tuple(_track(number, boxes, ego_mps, trajectory) for number, boxes in sorted(by_object.items()))


def _track(
    number: int,
    boxes: list[tuple[int, Box]],
    ego_mps: Mapping[int, NDArray[np.float64]],
    trajectory: Trajectory,
) -> Track:
    poses = [RigidTransform.from_quaternion((b.qw, b.qx, b.qy, b.qz), (b.x, b.y, b.z)) for _, b in boxes]
    times_ns = np.array([time_ns for time_ns, _ in boxes], dtype=np.int64)
    world_from_vehicle, _, _ = trajectory.at(times_ns)
    rates = world_yaw_rates(times_ns, world_from_vehicle @ np.stack([pose.rotation for pose in poses]))
    states = []
    for (time_ns, box), pose, rate in zip(boxes, poses, rates, strict=True):
        velocity_mps = ego_mps[time_ns] + np.array([box.velocity_x, box.velocity_y, box.velocity_z])
        states.append(box_state(time_ns, pose, (box.length_m, box.width_m, box.height_m), velocity_mps, rate))
    return Track(track_id=str(number), object_class=CLASSES[boxes[0][1].object_type], states=tuple(states))

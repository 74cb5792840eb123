"""Logs of 123D (Dauner et al.): one Arrow format for nuScenes, Waymo, Argoverse, KITTI-360, PandaSet, nuPlan and more.

```
<root>/<split>/<log>/
  sync.arrow                     of which data set the log is
  ego_state_se3.arrow            poses of the inertial sensor in the world
  camera.<name>.arrow            calibration in its head; times and images
  lidar.<name>.arrow             points in the frame of the inertial sensor; lidar.lidar_merged for several lidars
  box_detections_se3.arrow       tracked boxes in the world, with velocities
```

What is translated here, once:

- Times are int64 microseconds.
- The vehicle frame is below the rear axle on the road; the road is half of the vehicle's height below its centre, or
  where the card says.
- The image of the optical axis is stated with the centre of the first pixel at (0, 0), as here.
- Points are in the axes of the inertial sensor, so `lidar_from_sensor` is the mounting of the lidar in them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from bench.adapters.log123d_tables import LogImage, LogSweep, LogTable, pose
from bench.atomic import linked_folder, refuse_escape
from bench.cameras.model import CameraModel
from bench.cameras.stored import camera_from_parameters
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform
from bench.recordings.annotations import box_state, read_annotations
from bench.recordings.catalogue import RecordingHandle, handles_of, median_interval_ns
from bench.recordings.mounting import FisheyeOptions
from bench.recordings.validation import ForeignModel, SidePx, located, validated
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

SYNC, EGO, BOXES = "sync.arrow", "ego_state_se3.arrow", "box_detections_se3.arrow"
MERGED = "lidar_merged"
KNOWN_VERSIONS = ("0.6", "0.7")  # of the library whose logs this was tried with
POSE_WIDTH = 7
MILLISECOND_NS = 1_000_000
FTHETA_CONSTANT_PX = 1e-3  # a lens whose image of the optical axis is further from its centre is none
SplitName = Annotated[str, Field(pattern=r"^\w[\w.-]*$")]
Pose = Annotated[tuple[float, ...], Field(min_length=POSE_WIDTH, max_length=POSE_WIDTH)]  # x, y, z, qw, qx, qy, qz


class LogOptions(FisheyeOptions[str]):
    """The card's `options`.

    Attributes:
        log_splits: which folders of splits are read, such as `av2-sensor_val`; null for all that are there.
        cameras: those to evaluate, as their tables are called without `camera.`, such as `fmcam_l`; null for all.
        lidar: whose points are used, such as `lidar_top`; null for the one or the merged lidar that a log has.
        motion_compensated: to which time of the sweep the data set moved its points; null for points as measured, each
            at its own time, or in the middle of the sweep where the log does not say.
        time_offset_ms: per camera, added to the times of its images to get the middle of the exposure.
        ground_height_m: height of the road at the rear axle's; null for half of the vehicle's height below its centre.
    """

    log_splits: tuple[SplitName, ...] | None = None
    cameras: tuple[str, ...] | None = None
    lidar: str | None = None
    motion_compensated: Literal["start", "end"] | None = None
    time_offset_ms: dict[str, float] = Field(default_factory=dict)
    ground_height_m: float | None = None


def log123d_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `123d`: each `<split>/<log>` is a recording.

    Raises:
        DataError: options that are wrong, or no logs.
    """
    chosen = validated(LogOptions, options, file=card, field="options")
    splits = ("*",) if chosen.log_splits is None else chosen.log_splits
    folders = sorted(sync.parent for split in splits for sync in root.glob(f"{split}/*/{SYNC}"))
    if not folders:
        expected = f"logs of 123D, {' or '.join(splits)}/<log>/{SYNC}"
        hint = "convert the data set by py123d, or set the card's root and its option log_splits to where its logs are"
        raise DataError(root, expected=expected, got="none", hint=hint)
    return handles_of(folders, partial(open_log, root, options=chosen), annotations)


def open_log(root: Path, folder: Path, options: LogOptions, *, annotations: Path | None = None) -> Recording:
    """Open a log.

    Args:
        root: folder of the data set.
        folder: of the log.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a table that is missing or not what the format asks for.
    """
    within = linked_folder(root, folder, levels=options.follow_links)
    for path in folder.glob("*.arrow"):
        refuse_escape(within, path, file=path)
    head = LogTable(folder / SYNC).head(SyncHead)
    if not head.version.startswith(tuple(f"{known}." for known in KNOWN_VERSIONS)):
        expected = f"a log of 123D {' or '.join(KNOWN_VERSIONS)}"
        raise DataError(folder / SYNC, field="metadata.version", expected=expected, got=head.version)
    ego = LogTable(folder / EGO)
    ego_head = ego.head(EgoHead)
    imu_from_vehicle = ego_head.imu_from_vehicle(options.ground_height_m)
    vehicle_from_imu = imu_from_vehicle.inverse()
    names = options.cameras
    if names is None:
        names = tuple(path.stem.removeprefix("camera.") for path in sorted(folder.glob("camera.*.arrow")))
    if not names:
        raise DataError(folder, expected="a table camera.<name>.arrow", got="none")
    tables = {name: LogTable(folder / f"camera.{name}.arrow") for name in names}
    cameras = {name: _camera(name, table, vehicle_from_imu, options) for name, table in tables.items()}
    images = {name: _images(name, table, options) for name, table in tables.items()}
    sweeps, imu_from_sensor = _sweeps(folder, options)
    trajectory = _trajectory(ego, imu_from_vehicle)
    boxes = folder / BOXES
    if annotations is not None:
        tracks = read_annotations(annotations)
    else:
        tracks = _read_tracks(LogTable(boxes), trajectory) if boxes.is_file() else ()
    return Recording(
        name=folder.name,
        root=root,
        frame_interval_ns=median_interval_ns(images, file=folder),
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=vehicle_from_imu,
        sweeps=sweeps,
        tracks=tracks,
        annotated=COMPLETELY if annotations is not None or boxes.is_file() else NOT_ANNOTATED,
        vehicle_outline_m=ego_head.outline_m(),
        lidar_from_sensor=imu_from_sensor,
    )


def _images(name: str, table: LogTable, options: LogOptions) -> tuple[ImageRef, ...]:
    """The images of a camera by time."""
    times_ns = table.times_ns() + round(options.time_offset_ms.get(name, 0.0) * MILLISECOND_NS)
    _refuse_disorder(table, times_ns)
    cells = zip(times_ns.tolist(), table.cells("data"), strict=True)
    return tuple(
        ImageRef(camera=name, timestamp_ns=time_ns, path=table.path / str(time_ns), stored=LogImage(**cell))
        for time_ns, cell in cells
    )


def _sweeps(folder: Path, options: LogOptions) -> tuple[tuple[SweepRef, ...], RigidTransform]:
    """The sweeps by time, and the pose of their lidar in the frame of the inertial sensor."""
    tables = {path.stem.removeprefix("lidar."): LogTable(path) for path in sorted(folder.glob("lidar.*.arrow"))}
    if not tables:
        raise DataError(folder, expected="a table lidar.<name>.arrow", got="none")
    wanted = options.lidar
    if wanted is None and len(tables) > 1 and MERGED not in tables:
        hint = "name one in the card's option lidar"
        raise DataError(folder, expected="one lidar, or one table of all", got=", ".join(tables), hint=hint)
    key = wanted if wanted in tables else MERGED if MERGED in tables else next(iter(tables))
    table, lidar_id = tables[key], None
    lidars = _lidar_heads(table)
    if wanted is not None and wanted != key:
        chosen = [head for head in lidars if head.lidar_name.lower() == wanted.lower()]
        if len(chosen) != 1:
            known = ", ".join(head.lidar_name for head in lidars)
            raise DataError(table.path, field="metadata", expected=f"a lidar {wanted!r}", got=f"lidars {known}")
        lidars, lidar_id = chosen, chosen[0].lidar_id
    starts_ns, ends_ns = table.times_ns(), table.times_ns("end_timestamp_us")
    # Points without times of their own count as of the middle.
    middles_ns = starts_ns + (ends_ns - starts_ns) // 2
    times_ns = {"start": starts_ns, "end": ends_ns, None: middles_ns}[options.motion_compensated]
    _refuse_disorder(table, times_ns)
    sweeps = []
    for time_ns, cell in zip(times_ns.tolist(), table.cells("data"), strict=True):
        stored = LogSweep(**cell, lidar_id=lidar_id, as_measured=options.motion_compensated is None)
        path = table.path / str(time_ns)
        sweeps.append(SweepRef(timestamp_ns=time_ns, path=path, reader=stored, stored=stored))
    # Beams of several lidars have no common origin, and with it no rows.
    imu_from_sensor = pose(lidars[0].lidar_to_imu_se3) if len(lidars) == 1 else RigidTransform.identity()
    return tuple(sweeps), imu_from_sensor


def _trajectory(ego: LogTable, imu_from_vehicle: RigidTransform) -> Trajectory:
    poses = ego.vectors("imu_se3", ego.items("imu_se3"), width=POSE_WIDTH)
    there = np.isfinite(poses).all(axis=1) & poses[:, 3:].any(axis=1)
    if not there.all():
        raise DataError(ego.path, field=f"imu_se3, row {int(there.argmin()) + 1}", expected="a pose", got="none")
    world_from_imu = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    return Trajectory(
        source=str(ego.path),
        timestamps_ns=ego.times_ns(),
        rotations=world_from_imu * Rotation.from_matrix(imu_from_vehicle.rotation),
        positions_m=poses[:, :3] + world_from_imu.as_matrix() @ imu_from_vehicle.translation_m,
    )


def _refuse_disorder(table: LogTable, times_ns: NDArray[np.int64]) -> None:
    later = np.diff(times_ns) <= 0
    if later.any():
        row = int(later.argmax()) + 1
        got = f"{times_ns[row]} ns after {times_ns[row - 1]} ns in row {row + 1}"
        raise DataError(table.path, field="timestamp_us", expected="times that increase", got=got)


# What the heads of the tables state


class SyncHead(ForeignModel):
    """The head of `sync.arrow`: the version of the library that wrote the log."""

    version: str = "unknown"


class EgoHead(ForeignModel):
    """The ego vehicle: metres, and poses in the frame of its inertial sensor."""

    width: float = Field(gt=0)
    length: float = Field(gt=0)
    height: float = Field(gt=0)
    center_to_imu_se3: Pose
    rear_axle_to_imu_se3: Pose

    def imu_from_vehicle(self, ground_height_m: float | None) -> RigidTransform:
        """The pose of our vehicle frame: below the rear axle on the road, axes as the rear axle's."""
        imu_from_axle, imu_from_centre = pose(self.rear_axle_to_imu_se3), pose(self.center_to_imu_se3)
        axle_from_centre = imu_from_axle.inverse() @ imu_from_centre
        if ground_height_m is None:
            ground_height_m = float(axle_from_centre.translation_m[2]) - self.height / 2
        return imu_from_axle @ RigidTransform(np.eye(3), np.array([0.0, 0.0, ground_height_m]))

    def outline_m(self) -> NDArray[np.float64]:
        """(4, 2) float64, the vehicle from above, vehicle frame."""
        centre = (pose(self.rear_axle_to_imu_se3).inverse() @ pose(self.center_to_imu_se3)).translation_m[:2]
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
        return centre + corners * (self.length / 2, self.width / 2)


class CameraHead(ForeignModel):
    """A camera.

    Attributes:
        camera_model: which of the three.
        camera_to_imu_se3: its pose.
        intrinsics: of a pinhole camera fx, fy, cx, cy, skew; of an f-theta lens cx, cy and two polynomials of six
            coefficients: from the angle to the optical axis to pixels, and back.
        distortion: k1, k2, p1, p2 and, of a pinhole camera, k3.
        projection: of MEI's model gamma1, gamma2, u0, v0.
        mirror_parameter: xi of MEI's model.
        is_undistorted: whether a pinhole camera's images were rectified, so that its distortion no longer applies.
    """

    camera_model: Literal["pinhole", "fisheye_mei", "ftheta"]
    width: SidePx
    height: SidePx
    camera_to_imu_se3: Pose
    intrinsics: tuple[float, ...] | None = None
    distortion: tuple[float, ...] | None = None
    projection: tuple[float, ...] | None = None
    mirror_parameter: float | None = None
    is_undistorted: bool = False

    def model(self, max_angle_rad: float | None) -> CameraModel:
        """The lens.

        Raises:
            ShapeError: numbers that make none.
        """
        size: dict[str, Any] = {"width": self.width, "height": self.height, "max_angle_rad": max_angle_rad}
        if self.camera_model == "fisheye_mei":
            gamma1, gamma2, u0, v0 = _numbers(self.projection, "projection", 4)
            k1, k2, p1, p2 = _numbers(self.distortion or (0.0,) * 4, "distortion", 4)
            (xi,) = _numbers(None if self.mirror_parameter is None else (self.mirror_parameter,), "mirror_parameter", 1)
            lens: dict[str, Any] = {"focal": (gamma1, gamma2), "principal_point": (u0, v0)}
            return camera_from_parameters("unified", **size, **lens, xi=xi, radial=(k1, k2), tangential=(p1, p2))
        if self.camera_model == "ftheta":
            u0, v0, constant, *coefficients = _numbers(self.intrinsics, "intrinsics", 14)[:8]
            if abs(constant) > FTHETA_CONSTANT_PX:
                raise ShapeError(f"intrinsics: expected a polynomial that is 0 at the optical axis, got {constant} px")
            # The inverse is found from this polynomial, since the stored one back is a fit of its own.
            lens = {"principal_point": (u0, v0), "coefficients": tuple(coefficients)}
            return camera_from_parameters("radial_polynomial", **size, **lens)
        fx, fy, u0, v0, skew = _numbers(self.intrinsics, "intrinsics", 5)
        if skew:
            raise ShapeError(f"intrinsics: expected no skew, got {skew}")
        distortion = (0.0,) * 5 if self.is_undistorted else self.distortion or (0.0,) * 5
        k1, k2, p1, p2, k3 = _numbers(distortion, "distortion", 5)
        lens = {"focal": (fx, fy), "principal_point": (u0, v0)}
        return camera_from_parameters("brown_conrady", **size, **lens, radial=(k1, k2, k3), tangential=(p1, p2))


class LidarHead(ForeignModel):
    """A lidar; points are stored in the frame of the inertial sensor, whatever its pose."""

    lidar_name: str
    lidar_id: int
    lidar_to_imu_se3: Pose


def _camera(name: str, table: LogTable, vehicle_from_imu: RigidTransform, options: LogOptions) -> MountedCamera:
    head = table.head(CameraHead)
    with located(table.path, "metadata"):
        model = head.model(options.max_angle_rad(name))
        vehicle_from_camera = vehicle_from_imu @ pose(head.camera_to_imu_se3)
        return options.mounted(name, model, vehicle_from_camera)


def _lidar_heads(table: LogTable) -> list[LidarHead]:
    """The lidars of a table: one, or those of a merged table."""
    content = table.head_content()
    heads = content.values() if table.key.endswith(MERGED) else (content,)
    return [validated(LidarHead, head, file=table.path, field="metadata") for head in heads]


def _numbers(values: tuple[float, ...] | None, name: str, count: int) -> tuple[float, ...]:
    if values is None or len(values) != count:
        got = "none" if values is None else str(len(values))
        raise ShapeError(f"{name}: expected {count} numbers, got {got}")
    return values


# Boxes: labels of the original data sets brought into our classes, rows joined to tracks

BOX_WIDTH, VELOCITY_WIDTH = 10, 3  # x, y, z, qw, qx, qy, qz, length, width, height


# As the enumerations of py123d 0.7 number them. Riders count as cyclists; people in wheelchairs, with strollers and on
# small wheeled devices as pedestrians. The rest, such as signs and cones, are no objects that move by themselves.
NUMBERS: Mapping[str, Mapping[str, Iterable[int]]] = {
    "DefaultBoxDetectionLabel": {"vehicle": (1, 2), "cyclist": (3,), "pedestrian": (4,), "animal": (5,)},
    "AV2SensorBoxDetectionLabel": {
        "vehicle": (1, 5, 6, 10, 11, 17, 18, 19, 23, 24, 25, 26),
        "cyclist": (2, 3, 13, 14),
        "pedestrian": (15, 16, 22, 27, 28, 29),
        "animal": (0, 9),
    },
    "KITTI360BoxDetectionLabel": {"vehicle": (2, 3, 4, 14, 15, 17), "cyclist": (0, 6, 9), "pedestrian": (7,)},
    "NuPlanBoxDetectionLabel": {"vehicle": (0,), "cyclist": (1,), "pedestrian": (2,)},
    "NuScenesBoxDetectionLabel": {
        "vehicle": range(8), "cyclist": (8, 9), "pedestrian": range(10, 17), "animal": (22,)
    },
    "PandasetBoxDetectionLabel": {
        "vehicle": (3, 4, 7, 8, 11, 12, 13, 17, 21, 24, 25, 26),
        "cyclist": (2, 9, 10),
        "pedestrian": (14, 15, 16),
        "animal": (0, 1),
    },
    "WODPerceptionBoxDetectionLabel": {"vehicle": (1,), "pedestrian": (2,), "cyclist": (4,)},
    "PhysicalAIAVBoxDetectionLabel": {
        "vehicle": (0, 2, 3, 4, 8, 10, 11), "cyclist": (6,), "pedestrian": (1, 7), "animal": (9,)
    },
}  # fmt: skip
CLASSES: Mapping[str, Mapping[int, str]] = {
    label_class: {number: name for name, numbers in named.items() for number in numbers}
    for label_class, named in NUMBERS.items()
}


class BoxesHead(ForeignModel):
    """The boxes: the class that numbers their labels."""

    box_detection_label_class: str


def _read_tracks(table: LogTable, trajectory: Trajectory) -> tuple[Track, ...]:
    """Join the boxes of a log to tracks.

    Boxes and their velocities lie in the frame of the world. A velocity that is not stored follows from the positions,
    and so does one of zero where neither the row before nor the one after has the object: 123D writes zero there.
    Of several boxes of an object at one time the first counts: 123D gives one time to what NVIDIA's set has in 100 ms.

    Args:
        table: `box_detections_se3.arrow`.
        trajectory: of the ego vehicle.

    Returns:
        Tracks by token; those of objects that do not move by themselves are left out.

    Raises:
        DataError: labels of an unknown data set, columns that do not fit together, or times without ego-motion.
    """
    label_class = table.head(BoxesHead).box_detection_label_class.rpartition(".")[2]
    if label_class not in CLASSES:
        expected = f"labels of one of {', '.join(CLASSES)}"
        raise DataError(
            table.path, field="metadata.box_detection_label_class", expected=expected, got=repr(label_class)
        )
    classes = CLASSES[label_class]
    times_ns = table.times_ns()
    stored = table.items("track_token")
    tokens = [str(token) for row in stored for token in row]
    labels = _of_each(table, "label", tokens)
    boxes, velocities = (
        table.vectors(name, _of_each(table, name, tokens), width=width)
        for name, width in (("bounding_box_se3", BOX_WIDTH), ("velocity_3d", VELOCITY_WIDTH))
    )
    at_row = np.repeat(np.arange(len(stored)), np.array([len(row) for row in stored], dtype=np.int64))
    listed = pd.DataFrame({"token": pd.Series(tokens, dtype=str), "label": labels, "row": at_row})
    rows_of_token = listed.groupby("token")["row"]
    has_neighbour = (rows_of_token.diff() == 1) | (rows_of_token.diff(-1) == -1)
    velocities[~has_neighbour.to_numpy() & ~velocities.any(axis=1)] = np.nan
    evaluated = listed[listed["label"].isin(classes)].drop_duplicates(["token", "row"])
    tracks = []
    for name, boxes_of_token in evaluated.groupby("token"):
        token, taken = str(name), boxes_of_token.index.to_numpy()
        placed, placed_ns = boxes[taken], times_ns[at_row[taken]]
        if (np.diff(placed_ns) <= 0).any() or not np.isfinite(placed).all() or not (placed[:, 7:] > 0).all():
            expected = "finite boxes of positive size, one at a time"
            raise DataError(table.path, field=f"track {token[:60]}", expected=expected, got="another")
        states = _states(placed_ns, placed, velocities[taken], trajectory)
        tracks.append(Track(track_id=token, object_class=classes[labels[taken[0]]], states=states))
    return tuple(tracks)


def _of_each(table: LogTable, name: str, tokens: list[str]) -> list[Any]:
    """Values of a column, box by box."""
    values = [value for row in table.items(name) for value in row]
    if len(values) != len(tokens):
        got = str(len(values))
        raise DataError(table.path, field=name, expected=f"one for each of {len(tokens)} boxes", got=got)
    return values


def _states(
    times_ns: NDArray[np.int64], boxes: NDArray[np.float64], velocities: NDArray[np.float64], trajectory: Trajectory
) -> tuple[ObjectState, ...]:
    """States of boxes in the world, seen from the vehicle; velocities that are not known follow from the places."""
    world_from_object = Rotation.from_quat(boxes[:, 3:7], scalar_first=True).as_matrix()
    velocities = np.where(np.isfinite(velocities), velocities, world_velocities(times_ns, boxes[:, :3]))
    yaw_rates_radps = world_yaw_rates(times_ns, world_from_object)
    states = []
    for i, time_ns in enumerate(times_ns.tolist()):
        vehicle_from_world = trajectory.world_from_vehicle(time_ns).inverse()
        box, velocity_mps = vehicle_from_world @ pose(boxes[i, :7]), vehicle_from_world.rotate(velocities[i])
        states.append(box_state(time_ns, box, boxes[i, 7:], velocity_mps, yaw_rates_radps[i]))
    return tuple(states)

"""Logs of 123D (Dauner et al.): one Arrow format for nuScenes, Waymo, Argoverse, KITTI-360, PandaSet, nuPlan and more.

```
<logs>/<split>/<log>/
  sync.arrow                     of which data set the log is
  ego_state_se3.arrow            poses of the inertial sensor in the world
  camera.<name>.arrow            calibration in its head; times and images, or the paths of images
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

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.adapters.log123d.boxes import read_tracks
from bench.adapters.log123d.rig import EgoHead, LogHead, LogOptions, lidar_heads, mounted, pose
from bench.adapters.log123d.sensors import LogImage, LogSweep
from bench.adapters.log123d.tables import LogTable
from bench.atomic import linked_folder, refuse_escape
from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.annotations import annotation_file_in, read_annotations
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, Content, ImageRef, Recording, SweepRef

SYNC, EGO, BOXES = "sync.arrow", "ego_state_se3.arrow", "box_detections_se3.arrow"
MERGED = "lidar_merged"
KNOWN_VERSIONS = ("0.6", "0.7")  # of the library whose logs this was tried with
POSE_WIDTH = 7
MILLISECOND_NS = 1_000_000


def log123d_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `123d`: each `<logs>/<split>/<log>` is a recording.

    Raises:
        DataError: options that are wrong, or no logs.
    """
    chosen = validated(LogOptions, options, file=card, field="options")
    splits = ("*",) if chosen.log_splits is None else chosen.log_splits
    sync_files = sorted(sync for split in splits for sync in (root / chosen.logs).glob(f"{split}/*/{SYNC}"))
    if not sync_files:
        expected = f"logs of 123D, {' or '.join(splits)}/<log>/{SYNC}"
        hint = (
            "convert the data set by py123d, or set the card's options logs and log_splits to where its logs are; "
            "py123d writes them into the folder logs"
        )
        raise DataError(root / chosen.logs, expected=expected, got="none", hint=hint)
    return tuple(
        RecordingHandle(
            name=sync.parent.name,
            opener=partial(
                open_log,
                root,
                log=sync.parent.relative_to(root).as_posix(),
                options=chosen,
                annotations=annotation_file_in(annotations, sync.parent.name),
            ),
        )
        for sync in sync_files
    )


def open_log(
    root: Path,
    *,
    log: str,
    options: LogOptions,
    annotations: Path | None = None,
) -> Recording:
    """Open a log.

    Args:
        root: folder of the data set.
        log: folder of the log, below `root`.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a table that is missing or not what the format asks for.
    """
    folder = root / log
    within = linked_folder(root, folder, levels=options.follow_links)
    for path in folder.glob("*.arrow"):
        refuse_escape(within, path, file=path)
    head = LogTable(folder / SYNC).head(LogHead)
    if not head.version.startswith(tuple(f"{known}." for known in KNOWN_VERSIONS)):
        expected = f"a log of 123D {' or '.join(KNOWN_VERSIONS)}"
        raise DataError(folder / SYNC, field="metadata.version", expected=expected, got=head.version)
    ego = LogTable(folder / EGO)
    ego_head = ego.head(EgoHead)
    imu_from_vehicle = ego_head.imu_from_vehicle(options.ground_height_m)
    vehicle_from_imu = imu_from_vehicle.inverse()
    tables = dict(_camera_tables(folder, options))
    if not tables:
        raise DataError(folder, expected="a table camera.<name>.arrow", got="none")
    cameras = {
        name: mounted(name, table, vehicle_from_imu=vehicle_from_imu, options=options) for name, table in tables.items()
    }
    images = {name: tuple(_images(root, name, table, options)) for name, table in tables.items()}
    sweeps, imu_from_sensor = _sweeps(folder, options)
    trajectory = _trajectory(ego, imu_from_vehicle)
    boxes = folder / BOXES
    if annotations is not None:
        tracks = read_annotations(annotations)
    else:
        tracks = read_tracks(LogTable(boxes), trajectory) if boxes.is_file() else ()
    steps_ns = [np.diff([image.timestamp_ns for image in own]) for own in images.values() if len(own) > 1]
    return Recording(
        name=folder.name,
        root=root,
        licence=options.licence,
        frame_interval_ns=int(np.median(np.concatenate(steps_ns))) if steps_ns else 100 * MILLISECOND_NS,
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=vehicle_from_imu,
        sweeps=sweeps,
        tracks=tracks,
        annotated=COMPLETELY if annotations is not None or boxes.is_file() else NOT_ANNOTATED,
        vehicle_outline_m=ego_head.outline_m(),
        lidar_from_sensor=imu_from_sensor,
        contents=tuple(
            Content(
                what=path.name,
                read_as="a table" if _is_read(path.name, tables) else "",
                why="" if _is_read(path.name, tables) else "not asked for",
            )
            for path in sorted(folder.glob("*.arrow"))
        ),
    )


def _is_read(name: str, cameras: Mapping[str, LogTable]) -> bool:
    return name in (SYNC, EGO, BOXES, *(f"camera.{camera}.arrow" for camera in cameras)) or name.startswith("lidar.")


def _camera_tables(folder: Path, options: LogOptions) -> Iterator[tuple[str, LogTable]]:
    tables = {path.stem.removeprefix("camera."): LogTable(path) for path in sorted(folder.glob("camera.*.arrow"))}
    for name in tables if options.cameras is None else options.cameras:
        yield name, tables.get(name, LogTable(folder / f"camera.{name}.arrow"))


def _images(root: Path, name: str, table: LogTable, options: LogOptions) -> Iterator[ImageRef]:
    """The images of a camera by time: cells of the table, or files that these name."""
    offset_ns = round(options.time_offset_ms.get(name, 0.0) * MILLISECOND_NS)
    times_ns = table.times_ns() + offset_ns
    _refuse_disorder(table, times_ns)
    in_files = table.stores_text("data")
    for time_ns, cell in zip(times_ns.tolist(), table.cells("data"), strict=True):
        if in_files:
            path = _sensor_file(root, str(cell.value()), table, options)
            yield ImageRef(camera=name, timestamp_ns=time_ns, path=path)
        else:
            stored = LogImage(container=cell.container, batch=cell.batch, column=cell.column, row=cell.row)
            yield ImageRef(camera=name, timestamp_ns=time_ns, path=table.path / str(time_ns), stored=stored)


def _sensor_file(root: Path, relative: str, table: LogTable, options: LogOptions) -> Path:
    if options.sensors is None:
        hint = "set the card's option sensors to the folder of the original data set, or convert with jpeg_binary"
        raise DataError(table.path, field="data", expected="images in the log", got="paths of files", hint=hint)
    path = root / options.sensors / relative
    refuse_escape(root, path, file=table.path)
    return path


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
    table = tables[key]
    heads = lidar_heads(table)
    lidar_id = None
    if wanted is not None and wanted != key:
        chosen = [head for head in heads.values() if head.lidar_name.lower() == wanted.lower()]
        if len(chosen) != 1:
            known = ", ".join(head.lidar_name for head in heads.values())
            raise DataError(table.path, field="metadata", expected=f"a lidar {wanted!r}", got=f"lidars {known}")
        lidar_id = chosen[0].lidar_id
        heads = {lidar_id: chosen[0]}
    starts_ns, ends_ns = table.times_ns(), table.times_ns("end_timestamp_us")
    # Points without times of their own count as of the middle.
    middles_ns = starts_ns + (ends_ns - starts_ns) // 2
    times_ns = {"start": starts_ns, "end": ends_ns, None: middles_ns}[options.motion_compensated]
    _refuse_disorder(table, times_ns)
    sweeps = []
    for time_ns, cell in zip(times_ns.tolist(), table.cells("data"), strict=True):
        stored = LogSweep(
            container=cell.container, batch=cell.batch, column=cell.column, row=cell.row,
            lidar_id=lidar_id, as_measured=options.motion_compensated is None,
        )  # fmt: skip
        path = table.path / str(time_ns)
        sweeps.append(SweepRef(timestamp_ns=time_ns, path=path, reader=stored, stored=stored))
    # Beams of several lidars have no common origin, and with it no rows.
    one = next(iter(heads.values())) if len(heads) == 1 else None
    return tuple(sweeps), RigidTransform.identity() if one is None else pose(one.lidar_to_imu_se3)


def _trajectory(ego: LogTable, imu_from_vehicle: RigidTransform) -> Trajectory:
    poses = ego.rows("imu_se3", width=POSE_WIDTH)
    if not np.isfinite(poses).all() or not poses[:, 3:].any(axis=1).all():
        row = int((~np.isfinite(poses).all(axis=1) | ~poses[:, 3:].any(axis=1)).argmax())
        raise DataError(ego.path, field=f"imu_se3, row {row + 1}", expected="a pose", got="none")
    world_from_imu = Rotation.from_quat(poses[:, 3:], scalar_first=True)
    return Trajectory(
        source=str(ego.path),
        timestamps_ns=ego.times_ns(),
        rotations=world_from_imu * Rotation.from_matrix(imu_from_vehicle.rotation),
        positions_m=poses[:, :3] + world_from_imu.as_matrix() @ imu_from_vehicle.translation_m,
    )


def _refuse_disorder(table: LogTable, times_ns: np.ndarray[Any, np.dtype[np.int64]]) -> None:
    later = np.diff(times_ns) <= 0
    if later.any():
        row = int(later.argmax()) + 1
        got = f"{times_ns[row]} ns after {times_ns[row - 1]} ns in row {row + 1}"
        raise DataError(table.path, field="timestamp_us", expected="times that increase", got=got)

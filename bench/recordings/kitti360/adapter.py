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
- Sensors go from the frame of the GPS/IMU to the vehicle frame as `calibration` says, the world of the data
  set to one with z up as `times` says.
- Images outside of the annotated stretches of a drive are left out: what moves there has no box.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import DataError
from bench.recordings.annotations import read_annotations
from bench.recordings.atomic import refuse_escape
from bench.recordings.handles import RecordingHandle
from bench.recordings.kitti360.boxes import read_boxes
from bench.recordings.kitti360.calibration import Kitti360Options, read_rig
from bench.recordings.kitti360.files import (
    BOXES,
    IMAGES,
    POSES,
    Drive,
    FrameClock,
    camera_names,
    image_files,
    image_refs,
    read_clock,
    read_drive,
    sweep_files,
    sweep_refs,
    wanted_frames,
)
from bench.recordings.kitti360.salvage import salvage_kitti360
from bench.recordings.kitti360.tracks import Annotated, tracks_from_world
from bench.recordings.records import Recording
from bench.recordings.validation import validated

SEQUENCE = re.compile(r"\d{4}_\d\d_\d\d_drive_(\d{4})_sync")


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
    sequences = sorted(p.name for p in folder.iterdir() if SEQUENCE.fullmatch(p.name) and camera_names(p, chosen))
    handles = []
    for name in sequences:
        layer = None if annotations is None else annotations / f"{name}.json"
        how: dict[str, Any] = {"sequence": name, "options": chosen, "annotations": layer}
        handles.append(
            RecordingHandle(
                name=name,
                opener=partial(open_kitti360, root, **how),
                salvager=partial(salvage_kitti360, root, **how),
            )
        )
    return tuple(handles)


def open_kitti360(root: Path, *, sequence: str, options: Kitti360Options, annotations: Path | None = None) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set.
        sequence: name of its folders.
        options: as in the card.
        annotations: annotation file that stands in for the boxes where it exists.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / IMAGES / sequence
    names = camera_names(folder, options)
    if not names:
        raise DataError(folder, expected=f"images of {' or '.join(options.cameras)}", got="none")
    rig = read_rig(root, names, options)
    images = {name: image_files(root, sequence, name) for name in names}
    clock = _clock(root, folder, names[0], images[names[0]])
    poses = root / POSES / sequence / "poses.txt"
    refuse_escape(root, poses, file=poses)
    drive = read_drive(
        poses, clock, rig.vehicle_from_imu, max_gap_s=options.max_pose_gap_s, standing_m=options.standing_m
    )
    annotated = _annotated(root, sequence, drive, clock, options, annotations)
    expected = wanted_frames(sequence, options, annotated.covers)
    return Recording(
        name=sequence,
        root=root,
        licence=options.licence,
        frame_interval_ns=clock.interval_ns,
        cameras=rig.cameras,
        images={name: image_refs(name, images[name], clock, expected) for name in names},
        trajectory=drive.trajectory,
        vehicle_from_lidar=rig.vehicle_from_lidar,
        sweeps=sweep_refs(sweep_files(root, sequence), clock, expected),
        tracks=annotated.tracks,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _clock(root: Path, folder: Path, camera: str, images: Mapping[int, Path]) -> FrameClock:
    file = folder / camera / "timestamps.txt"
    refuse_escape(root, file, file=file)
    if not images:
        raise DataError(folder / camera / "data_rgb", expected="images <frame, ten digits>.png", got="none")
    return read_clock(file, list(images))


def _annotated(
    root: Path, sequence: str, drive: Drive, clock: FrameClock, options: Kitti360Options, annotations: Path | None
) -> Annotated:
    if annotations is not None and annotations.is_file():
        return Annotated(tracks=read_annotations(annotations), windows=())
    file = root / BOXES / options.boxes / f"{sequence}.xml"
    if not file.is_file():
        do = "test sequences have none; choose a split that has, or name a folder of annotations in the card"
        raise DataError(file, expected="a file of boxes", got="no such file", do=do)
    refuse_escape(root, file, file=file)
    return tracks_from_world(
        read_boxes(file), drive, clock, static_range_m=options.static_range_m, static_people=options.static_people
    )

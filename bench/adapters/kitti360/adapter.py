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
- Images outside of the annotated stretches of a drive are left out: what moves there has no box. A drive without a file
  of boxes, as of the test set, is not annotated.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.kitti360.boxes import read_boxes
from bench.adapters.kitti360.calibration import CameraName, Kitti360Options, Rig, read_rig
from bench.adapters.kitti360.files import Drive, FrameClock, drive_through, read_clock, read_poses, read_turn
from bench.adapters.kitti360.tracks import Annotated, tracks_from_world
from bench.atomic import linked_folder, refuse_escape
from bench.errors import DataError
from bench.recordings.annotations import annotation_file_in, annotations_or_none
from bench.recordings.error_handlers import STRICT, ErrorHandler, OnError, at_most, reporting, stationary
from bench.recordings.files import framed_files
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import MOST_FAULTS, validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, ImageRef, Recording, SweepRef

IMAGES, SWEEPS, POSES, BOXES = "data_2d_raw", "data_3d_raw", "data_poses", "data_3d_bboxes"
NO_BOXES = Annotated(tracks=(), windows=())
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
    sequences = sorted(p.name for p in folder.iterdir() if SEQUENCE.fullmatch(p.name) and _camera_names(p, chosen))
    handles = []
    for name in sequences:
        file = annotation_file_in(annotations, name)
        opener = partial(open_kitti360, root, sequence=name, options=chosen, annotations=file)
        handles.append(RecordingHandle(name=name, opener=opener, lenient=True))
    return tuple(handles)


def open_kitti360(
    root: Path,
    *,
    sequence: str,
    options: Kitti360Options,
    annotations: Path | None = None,
    on_error: ErrorHandler = STRICT,
) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set.
        sequence: name of its folders.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.
        on_error: takes errors; the default raises the first.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / IMAGES / sequence
    names = _camera_names(folder, options)
    if not names:
        on_error(DataError(folder, expected=f"images of {' or '.join(options.cameras)}", got="none"))
    within = partial(linked_folder, root, levels=options.follow_links)
    rig = read_rig(root, names, options, on_error)
    images: dict[CameraName, Mapping[int, Path]] = {}
    for name in names:
        with reporting(on_error):
            place = folder / name / "data_rgb"
            images[name] = framed_files(within(place), place, r"(\d{10})\.png", on_error)
    clock = _clock(within(folder), folder, images, on_error)
    drive = _drive(root, sequence, clock, rig, options, on_error)
    annotated = _annotated(root, sequence, drive, clock, options, annotations, on_error)
    evaluated = partial(_evaluated, sequence=sequence, options=options, annotated=annotated or NO_BOXES)
    refs: dict[str, tuple[ImageRef, ...]] = {}
    if clock is not None:
        for name in names:
            timed = _timed(evaluated(images.get(name, {})), clock, on_error)
            refs[name] = tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in timed)
    scans: Mapping[int, Path] = {}
    with reporting(on_error):
        place = root / SWEEPS / sequence / "velodyne_points" / "data"
        scans = framed_files(within(place), place, r"(\d{10})\.bin", on_error)
    if rig is None or clock is None or not rig.cameras:
        on_error.stop()
    if drive is None:
        on_error.leave_out("trajectory")
    if annotated is None:
        on_error.leave_out("annotations")
    reader = partial(read_turn, period_ns=clock.interval_ns)
    return Recording(
        name=sequence,
        root=root,
        licence=options.licence,
        frame_interval_ns=clock.interval_ns,
        cameras=rig.cameras,
        images={name: refs[name] for name in rig.cameras},
        trajectory=stationary(root) if drive is None else drive.trajectory,
        vehicle_from_lidar=rig.vehicle_from_lidar,
        sweeps=tuple(
            SweepRef(timestamp_ns=t, path=path, reader=reader) for t, path in _timed(evaluated(scans), clock, on_error)
        ),
        tracks=() if annotated is None else annotated.tracks,
        annotated=NOT_ANNOTATED if annotated in {None, NO_BOXES} else COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _camera_names(folder: Path, options: Kitti360Options) -> tuple[CameraName, ...]:
    """The cameras of `options` that a sequence has images of."""
    return tuple(name for name in options.cameras if (folder / name / "data_rgb").is_dir())


def _evaluated(
    files: Mapping[int, Path], *, sequence: str, options: Kitti360Options, annotated: Annotated
) -> dict[int, Path]:
    """The files of frames that are annotated and not left out."""
    left_out = [entry.frames for entry in options.excluded_frames if f"_drive_{entry.sequence}_" in sequence]
    return {
        frame: path
        for frame, path in files.items()
        if annotated.covers(frame) and not any(first <= frame <= last for first, last in left_out)
    }


def _timed(files: Mapping[int, Path], clock: FrameClock, on_error: OnError) -> Iterator[tuple[int, Path]]:
    """Files with the times of their frames; no time is an error."""
    for frame, path in files.items():
        with reporting(on_error):
            yield clock.at(frame, file=path), path


def _clock(
    root: Path, folder: Path, images: Mapping[CameraName, Mapping[int, Path]], on_error: ErrorHandler
) -> FrameClock | None:
    """The clock of the first camera; in lenient reading, of the first that has one."""
    for camera, files in images.items():
        file = folder / camera / "timestamps.txt"
        with reporting(on_error):
            refuse_escape(root, file, file=file)
            if not files:
                on_error(DataError(folder / camera / "data_rgb", expected="images <frame, ten digits>.png", got="none"))
            clock = read_clock(file, list(files), on_error)
            if clock is not None:
                return clock
    return None


def _drive(
    root: Path,
    sequence: str,
    clock: FrameClock | None,
    rig: Rig | None,
    options: Kitti360Options,
    on_error: ErrorHandler,
) -> Drive | None:
    """None after an error; also without a clock or a rig are the poses read, so that every error is reported."""
    file = root / POSES / sequence / "poses.txt"
    with reporting(on_error):
        refuse_escape(linked_folder(root, file, levels=options.follow_links), file, file=file)
        poses = read_poses(file, clock, on_error)
        if poses is not None and rig is not None and clock is not None:
            gap_s, stationary_m = options.max_pose_gap_s, options.stationary_m
            mounting = rig.vehicle_from_imu
            return drive_through(poses, clock, mounting, file=file, max_gap_s=gap_s, stationary_m=stationary_m)
    return None


def _annotated(
    root: Path,
    sequence: str,
    drive: Drive | None,
    clock: FrameClock | None,
    options: Kitti360Options,
    annotations: Path | None,
    on_error: ErrorHandler,
) -> Annotated | None:
    """None where there is no trajectory to place the boxes along, or after an error of the whole file."""
    if annotations is not None:
        tracks = annotations_or_none(annotations, on_error)
        return None if tracks is None else Annotated(tracks=tracks, windows=())
    file = root / BOXES / options.boxes / f"{sequence}.xml"
    with reporting(on_error):
        if not file.is_file():
            return NO_BOXES
        refuse_escape(linked_folder(root, file, levels=options.follow_links), file, file=file)
        boxes = read_boxes(file, at_most(MOST_FAULTS, on_error))
        if drive is None or clock is None:
            deque(boxes, maxlen=0)  # for the errors in it
            return None
        return tracks_from_world(
            boxes, drive, clock, static_range_m=options.static_range_m, static_people=options.static_people
        )
    return None

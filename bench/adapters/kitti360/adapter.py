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
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.kitti360.boxes import read_boxes
from bench.adapters.kitti360.calibration import CameraName, Kitti360Options, read_rig
from bench.adapters.kitti360.files import Drive, FrameClock, drive_through, read_clock, read_poses, read_turn
from bench.adapters.kitti360.tracks import Annotated, tracks_from_world
from bench.atomic import linked_folder, refuse_escape
from bench.errors import DataError
from bench.recordings.annotations import annotation_file_in, read_annotations
from bench.recordings.files import file_contents, framed_files
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, Content, ImageRef, Recording, SweepRef

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
        handles.append(RecordingHandle(name=name, opener=opener))
    return tuple(handles)


def open_kitti360(
    root: Path,
    *,
    sequence: str,
    options: Kitti360Options,
    annotations: Path | None = None,
) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set.
        sequence: name of its folders.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / IMAGES / sequence
    names = _camera_names(folder, options)
    if not names:
        raise DataError(folder, expected=f"images of {' or '.join(options.cameras)}", got="none")
    within = partial(linked_folder, root, levels=options.follow_links)
    rig = read_rig(root, names, options)
    places = {name: folder / name / "data_rgb" for name in names}
    images = {name: framed_files(within(place), place, r"(\d{10})\.png") for name, place in places.items()}
    clock = _clock(within(folder), folder / names[0], images[names[0]])
    poses = root / POSES / sequence / "poses.txt"
    refuse_escape(within(poses), poses, file=poses)
    drive = drive_through(
        read_poses(poses, clock), clock, rig.vehicle_from_imu,
        file=poses, max_gap_s=options.max_pose_gap_s, stationary_m=options.stationary_m,
    )  # fmt: skip
    annotated = _annotated(root, sequence, drive, clock, options, annotations)
    evaluated = partial(_evaluated, sequence=sequence, options=options, annotated=annotated)
    scan_folder = root / SWEEPS / sequence / "velodyne_points" / "data"
    scans = framed_files(within(scan_folder), scan_folder, r"(\d{10})\.bin")
    reader = partial(read_turn, period_ns=clock.interval_ns)
    return Recording(
        name=sequence,
        root=root,
        licence=options.licence,
        frame_interval_ns=clock.interval_ns,
        cameras=rig.cameras,
        images={
            name: tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in _timed(evaluated(files), clock))
            for name, files in images.items()
        },
        trajectory=drive.trajectory,
        vehicle_from_lidar=rig.vehicle_from_lidar,
        sweeps=tuple(SweepRef(timestamp_ns=t, path=path, reader=reader) for t, path in _timed(evaluated(scans), clock)),
        tracks=annotated.tracks,
        annotated=NOT_ANNOTATED if annotated is NO_BOXES else COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
        contents=tuple(_contents(root, sequence, images, scans)),
    )


def _contents(
    root: Path, sequence: str, images: Mapping[CameraName, Mapping[int, Path]], scans: Mapping[int, Path]
) -> Iterator[Content]:
    """Files of the sequence's folders, read and not read."""
    folder = root / IMAGES / sequence
    yield from file_contents(root, folder, [folder / name for name in images], "cameras")
    for name, files in images.items():
        yield from file_contents(
            root, folder / name, [folder / name / "data_rgb", folder / name / "timestamps.txt"], "images"
        )
        yield from file_contents(root, folder / name / "data_rgb", files.values(), "images", suffixes=(".png",))
    velodyne = root / SWEEPS / sequence / "velodyne_points"
    yield from file_contents(root, velodyne.parent, [velodyne], "scans")
    yield from file_contents(root, velodyne / "data", scans.values(), "scans", suffixes=(".bin",))
    yield from file_contents(root, root / POSES / sequence, [root / POSES / sequence / "poses.txt"], "ego-motion")


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


def _timed(files: Mapping[int, Path], clock: FrameClock) -> Iterator[tuple[int, Path]]:
    """Files with the times of their frames."""
    return ((clock.at(frame, file=path), path) for frame, path in files.items())


def _clock(root: Path, folder: Path, images: Mapping[int, Path]) -> FrameClock:
    """The clock of a camera."""
    file = folder / "timestamps.txt"
    refuse_escape(root, file, file=file)
    if not images:
        raise DataError(folder / "data_rgb", expected="images <frame, ten digits>.png", got="none")
    return read_clock(file, list(images))


def _annotated(
    root: Path, sequence: str, drive: Drive, clock: FrameClock, options: Kitti360Options, annotations: Path | None
) -> Annotated:
    """The annotated objects and stretches."""
    if annotations is not None:
        return Annotated(tracks=read_annotations(annotations), windows=())
    file = root / BOXES / options.boxes / f"{sequence}.xml"
    if not file.is_file():
        return NO_BOXES
    refuse_escape(linked_folder(root, file, levels=options.follow_links), file, file=file)
    return tracks_from_world(
        read_boxes(file), drive, clock, static_range_m=options.static_range_m, static_people=options.static_people
    )

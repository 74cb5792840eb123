"""The aiMotive multimodal data set (Matuszka et al. 2022).

```
data/<split>/<odd>/<sequence>/
  sensor/calibration/calibration.json           per camera: MEI or pinhole model and RT_body_from_sensor
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
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.adapters.aimotive.boxes import BoxFrame, frames_in_order, read_box_frame, tracks_from_boxes
from bench.adapters.aimotive.calibration import FRAME_INTERVAL_NS, AimotiveOptions, read_cameras, read_lidar_mounting
from bench.adapters.aimotive.egomotion import sequence_trajectory
from bench.atomic import linked_folder
from bench.egomotion import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import read_sweep
from bench.recordings.annotations import annotation_file_in, annotations_or_none
from bench.recordings.error_handlers import STRICT, ErrorHandler, OnError, reporting, stationary
from bench.recordings.files import framed_files
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import validated
from bench.records.recording import COMPLETELY, NOT_ANNOTATED, ImageRef, Recording, SweepRef, Track

BOXES, SWEEPS = "dynamic/box/3d_body", "dynamic/raw-revolutions"


def aimotive_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `aimotive`: each `data/<split>/<odd>/<sequence>` is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(AimotiveOptions, options, file=card, field="options")
    handles = []
    for sequence in sorted(path for path in root.glob("data/*/*/*") if path.is_dir()):
        opener = partial(
            open_aimotive,
            root,
            sequence=sequence.relative_to(root).as_posix(),
            options=chosen,
            annotations=annotation_file_in(annotations, sequence.name),
        )
        handles.append(RecordingHandle(name=sequence.name, opener=opener, lenient=True))
    return tuple(handles)


def open_aimotive(
    root: Path,
    *,
    sequence: str,
    options: AimotiveOptions,
    annotations: Path | None = None,
    on_error: ErrorHandler = STRICT,
) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set, above `data`.
        sequence: path of the sequence below `root`.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.
        on_error: takes errors; the default raises the first.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / sequence
    within = linked_folder(root, folder, levels=options.follow_links)
    cameras = read_cameras(within, folder, options, on_error)
    boxes, without_time = _boxes(within, folder, on_error)
    times_ns = {number: frame.timestamp_ns for number, frame in boxes.items()}
    trajectory = sequence_trajectory(root, folder, options, times_ns, on_error)
    tracks = _tracks(boxes, trajectory, annotations, on_error)
    timed = partial(_timed, times_ns=times_ns, without_time=without_time, on_error=on_error)
    images: dict[str, tuple[ImageRef, ...]] = dict.fromkeys(cameras, ())
    for name in cameras:
        with reporting(on_error):
            place = folder / "sensor/camera" / name
            paths = framed_files(within, place, rf"{re.escape(name)}_(\d+)\.(?:jpg|png)", on_error)
            if not paths:
                on_error(DataError(place, expected=f"images {name}_<number>.jpg", got="none"))
            images[name] = tuple(ImageRef(camera=name, timestamp_ns=t, path=path) for t, path in timed(paths))
    sweeps: tuple[SweepRef, ...] = ()
    with reporting(on_error):
        paths = framed_files(within, folder / SWEEPS, r"frame_(\d+)\.laz", on_error)
        sweeps = tuple(SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in timed(paths))
    lidar_from_sensor = _lidar_mounting(within, folder, on_error)
    if not cameras or not boxes:
        on_error.stop()
    if trajectory is None:
        on_error.leave_out("trajectory")
    if tracks is None:
        on_error.leave_out("annotations")
    return Recording(
        name=folder.name,
        root=root,
        licence=options.licence,
        frame_interval_ns=FRAME_INTERVAL_NS,
        cameras=cameras,
        images=images,
        trajectory=trajectory or stationary(root),
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=sweeps,
        tracks=tracks or (),
        annotated=NOT_ANNOTATED if tracks is None else COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
        lidar_from_sensor=lidar_from_sensor,
    )


def _boxes(root: Path, folder: Path, on_error: ErrorHandler) -> tuple[dict[int, BoxFrame], frozenset[int]]:
    """Frames by increasing time, and the numbers of those that cannot be used."""
    files: Mapping[int, Path] = {}
    with reporting(on_error):
        files = framed_files(root, folder / BOXES, r"frame_(\d+)\.json", on_error)
        if not files:
            expected = "files frame_<number>.json, which hold the times of frames"
            on_error(DataError(folder / BOXES, expected=expected, got="none"))
    read = {number: read_box_frame(file, on_error) for number, file in files.items()}
    frames = frames_in_order({number: frame for number, frame in read.items() if frame is not None}, on_error)
    return frames, frozenset(files) - frozenset(frames)


def _timed(
    paths: Mapping[int, Path], *, times_ns: Mapping[int, int], without_time: frozenset[int], on_error: OnError
) -> Iterator[tuple[int, Path]]:
    """Files with the times of their frames; no time is an error, except for `without_time`, reported already."""
    for number, path in paths.items():
        if number in times_ns:
            yield times_ns[number], path
        elif number not in without_time:
            on_error(DataError(path, expected=f"{BOXES}/frame_{number:07d}.json with its time", got="no such file"))


def _tracks(
    boxes: Mapping[int, BoxFrame], trajectory: Trajectory | None, annotations: Path | None, on_error: ErrorHandler
) -> tuple[Track, ...] | None:
    """None after an error, or where there is no ego-motion to add to the velocities."""
    if annotations is not None:
        return annotations_or_none(annotations, on_error)
    if trajectory is not None:
        with reporting(on_error):
            return tracks_from_boxes(tuple(boxes.values()), trajectory)
    return None


def _lidar_mounting(root: Path, folder: Path, on_error: ErrorHandler) -> RigidTransform:
    """The identity after an error; one of the whole file was reported with the cameras."""
    try:
        return read_lidar_mounting(root, folder)
    except DataError as error:
        if error.field is not None:
            on_error(error)
        return RigidTransform.identity()

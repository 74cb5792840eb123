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
- Points are in body axes already, so `vehicle_from_lidar` is the identity; a revolution runs from about 68 ms before to
  32 ms after the time of its frame, in the same clock. Frames are 67 ms apart, so neighbouring revolutions share the
  points of 33 ms; an image takes those of one revolution only.
- Boxes tell velocity relative to the ego vehicle in body axes; over the ground it is the ego's velocity plus that. The
  turn of an object comes from the headings of its boxes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.egomotion import Trajectory, read_bus_signals
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import read_sweep
from bench.recordings.aimotive_boxes import read_box_frame, tracks_from_boxes
from bench.recordings.aimotive_cameras import read_cameras
from bench.recordings.aimotive_egomotion import read_egomotion
from bench.recordings.aimotive_options import AimotiveOptions
from bench.recordings.annotations import read_annotations
from bench.recordings.handles import RecordingHandle
from bench.recordings.paths import path_inside, refuse_escape
from bench.recordings.records import ImageRef, Recording, SweepRef
from bench.recordings.validation import validated

BOXES = "dynamic/box/3d_body"
SWEEPS = "dynamic/raw-revolutions"
FRAME_INTERVAL_NS = 66_666_667


def aimotive_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `aimotive`: each `data/<split>/<odd>/<sequence>` is a recording.

    Raises:
        DataError: options that are wrong.
    """
    chosen = validated(AimotiveOptions, options, file=card, field="options")
    return tuple(
        RecordingHandle(
            name=sequence.name,
            opener=partial(
                open_aimotive,
                root,
                sequence=sequence.relative_to(root).as_posix(),
                options=chosen,
                annotations=None if annotations is None else annotations / f"{sequence.name}.json",
            ),
        )
        for sequence in sorted(path for path in root.glob("data/*/*/*") if path.is_dir())
    )


def open_aimotive(root: Path, *, sequence: str, options: AimotiveOptions, annotations: Path | None = None) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set, above `data`.
        sequence: path of the sequence below `root`.
        options: as in the card.
        annotations: annotation file that stands in for the boxes where it exists.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / sequence
    cameras = read_cameras(folder, options)
    frames = _frames(root, folder)
    boxes = {number: read_box_frame(path) for number, path in frames.items()}
    times_ns = {number: frame.timestamp_ns for number, frame in boxes.items()}
    trajectory = _trajectory(root, folder, options, times_ns)
    if annotations is not None and annotations.is_file():
        tracks = read_annotations(annotations)
    else:
        tracks = tracks_from_boxes(tuple(boxes.values()), trajectory)
    return Recording(
        name=folder.name,
        root=root,
        licence=options.licence,
        frame_interval_ns=FRAME_INTERVAL_NS,
        cameras=cameras,
        images={name: _images(root, folder, name, times_ns) for name in cameras},
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=_sweeps(root, folder, times_ns),
        tracks=tracks,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _frames(root: Path, folder: Path) -> dict[int, Path]:
    frames = _numbered(root, folder / BOXES, r"frame_(\d+)\.json")
    if not frames:
        raise DataError(folder / BOXES, wanted="files frame_<number>.json, which tell the times of frames", came="none")
    return frames


def _images(root: Path, folder: Path, camera: str, times_ns: Mapping[int, int]) -> tuple[ImageRef, ...]:
    place = folder / "sensor/camera" / camera
    paths = _numbered(root, place, rf"{re.escape(camera)}_(\d+)\.(?:jpg|png)")
    if not paths:
        raise DataError(place, wanted=f"images {camera}_<number>.jpg", came="none")
    for number, path in paths.items():
        if number not in times_ns:
            raise DataError(path, wanted=f"{BOXES}/frame_{number:07d}.json with its time", came="no such file")
    return tuple(ImageRef(camera=camera, timestamp_ns=times_ns[n], path=path) for n, path in paths.items())


def _sweeps(root: Path, folder: Path, times_ns: Mapping[int, int]) -> tuple[SweepRef, ...]:
    paths = _numbered(root, folder / SWEEPS, r"frame_(\d+)\.laz")
    for number, path in paths.items():
        if number not in times_ns:
            raise DataError(path, wanted=f"{BOXES}/frame_{number:07d}.json with its time", came="no such file")
    return tuple(SweepRef(timestamp_ns=times_ns[n], path=path, reader=read_sweep) for n, path in paths.items())


def _numbered(root: Path, folder: Path, pattern: str) -> dict[int, Path]:
    if not folder.is_dir():
        return {}
    found = {}
    for path in folder.iterdir():
        match = re.fullmatch(pattern, path.name)
        if match is None:
            continue
        if path.is_symlink():
            refuse_escape(root, path, file=path)
        found[int(match[1])] = path
    return dict(sorted(found.items()))


def _trajectory(root: Path, folder: Path, options: AimotiveOptions, times_ns: Mapping[int, int]) -> Trajectory:
    if options.ego_motion is None:
        return read_egomotion(root, folder, times_ns)
    name = options.ego_motion.file.replace("{sequence}", folder.name)
    path = path_inside(root, name, file=root, field="options.ego_motion.file")
    return read_bus_signals(path, columns=options.ego_motion.columns).trajectory()

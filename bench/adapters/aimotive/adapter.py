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
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.adapters.aimotive.boxes import read_box_frames, tracks_from_boxes
from bench.adapters.aimotive.calibration import FRAME_INTERVAL_NS, AimotiveOptions, read_cameras, read_lidar_mounting
from bench.atomic import linked_folder, path_inside
from bench.egomotion import Trajectory, read_bus_signals
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import read_sweep
from bench.recordings.annotations import annotation_file_in, read_annotations
from bench.recordings.files import file_contents, framed_files, read_object
from bench.recordings.handles import RecordingHandle
from bench.recordings.validation import located, validated
from bench.records.recording import COMPLETELY, Content, ImageRef, Recording, SweepRef

EGO_MOTION = "sensor/gnssins/egomotion.json"
POSE = "RT_ECEF_body"
AXES_M = np.array([6_378_137.0, 6_378_137.0, 6_356_752.3142])  # of the WGS 84 ellipsoid


def sequence_trajectory(root: Path, folder: Path, options: AimotiveOptions, times_ns: Mapping[int, int]) -> Trajectory:
    """The ego-motion that the card names, or the data set's own; arguments and errors as for `read_egomotion`."""
    if options.ego_motion is None:
        return read_egomotion(linked_folder(root, folder, levels=options.follow_links), folder, times_ns)
    name = options.ego_motion.file.replace("{sequence}", folder.name)
    path = path_inside(root, name, file=root, field="options.ego_motion.file")
    return read_bus_signals(path, columns=options.ego_motion.columns).trajectory()


def read_egomotion(root: Path, folder: Path, times_ns: Mapping[int, int]) -> Trajectory:
    """Read the poses.

    The file maps frame numbers to entries with a 4 x 4 matrix that takes points of the body into the earth-centred,
    earth-fixed frame. The world here begins at the first pose, with z along the local vertical.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.
        times_ns: of frames, from the files of boxes; poses of other frames are passed over.

    Raises:
        DataError: missing, not JSON, an entry that is no pose, or fewer than two poses.
    """
    file = folder / EGO_MOTION
    content = read_object(root, file, expected="poses by frame number")
    poses = {int(key): _pose(entry, key, file) for key, entry in content.items() if _is_wanted(key, times_ns)}
    frames = sorted(poses)
    if len(frames) < 2:
        expected = f"poses of two frames at least, of those from {min(times_ns)} to {max(times_ns)}"
        raise DataError(file, expected=expected, got=str(len(frames)))
    start = poses[frames[0]]
    world_from_earth = RigidTransform(upright := _upright(start.translation_m), -upright @ start.translation_m)
    placed = [world_from_earth @ poses[frame] for frame in frames]
    return Trajectory(
        source=str(file),
        timestamps_ns=np.array([times_ns[frame] for frame in frames], dtype=np.int64),
        rotations=Rotation.from_matrix(np.stack([pose.rotation for pose in placed])),
        positions_m=np.stack([pose.translation_m for pose in placed]),
    )


def _is_wanted(key: str, times_ns: Mapping[int, int]) -> bool:
    return key.isascii() and key.isdigit() and len(key) < 10 and int(key) in times_ns


def _pose(entry: Any, key: str, file: Path) -> RigidTransform:
    field = f"{key}.{POSE}"
    try:
        with located(file, field):
            return RigidTransform.from_matrix(np.array(entry[POSE], dtype=np.float64))
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(file, field=field, expected="a 4 x 4 matrix", got=f"none ({type(error).__name__})") from None


def _upright(position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation that turns the local vertical at a place on the earth to z; which way x looks does not matter."""
    up = position_m / AXES_M**2
    if not np.linalg.norm(position_m) > 1_000_000.0:  # a local frame, with z up already
        return np.eye(3)
    up = up / np.linalg.norm(up)
    east = np.cross([0.0, 0.0, 1.0], up) if abs(up[2]) < 0.99 else np.cross([1.0, 0.0, 0.0], up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


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
        handles.append(RecordingHandle(name=sequence.name, opener=opener))
    return tuple(handles)


def open_aimotive(
    root: Path,
    *,
    sequence: str,
    options: AimotiveOptions,
    annotations: Path | None = None,
) -> Recording:
    """Open a sequence.

    Args:
        root: folder of the data set, above `data`.
        sequence: path of the sequence below `root`.
        options: as in the card.
        annotations: annotation file that stands in for the boxes; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    folder = root / sequence
    within = linked_folder(root, folder, levels=options.follow_links)
    cameras = read_cameras(within, folder, options)
    frames = read_box_frames(framed_files(within, folder / BOXES, r"frame_(\d+)\.json"), folder / BOXES)
    times_ns = {number: frame.timestamp_ns for number, frame in frames.items()}
    trajectory = sequence_trajectory(root, folder, options, times_ns)
    own = None if annotations is None else read_annotations(annotations)
    tracks = tracks_from_boxes(tuple(frames.values()), trajectory) if own is None else own
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
        licence=options.licence,
        frame_interval_ns=FRAME_INTERVAL_NS,
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=tuple(
            SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in _timed(revolutions, times_ns)
        ),
        tracks=tracks,
        annotated=COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
        lidar_from_sensor=read_lidar_mounting(within, folder),
        contents=tuple(_contents(folder, images, revolutions)),
    )


def _contents(
    folder: Path, images: Mapping[str, tuple[ImageRef, ...]], revolutions: Mapping[int, Path]
) -> Iterator[Content]:
    """Files of the sequence's folder, read and not read."""
    sensor, dynamic = folder / "sensor", folder / "dynamic"
    yield from file_contents(
        folder, sensor, [sensor / name for name in ("calibration", "camera", "gnssins")], "sensors"
    )
    yield from file_contents(folder, sensor / "camera", [sensor / "camera" / name for name in images], "cameras")
    for name, refs in images.items():
        place = sensor / "camera" / name
        yield from file_contents(folder, place, [ref.path for ref in refs], "images", suffixes=(".jpg", ".png"))
    yield from file_contents(folder, dynamic, [dynamic / name for name in ("box", "raw-revolutions")], "boxes, sweeps")
    yield from file_contents(folder, folder / SWEEPS, revolutions.values(), "sweeps", suffixes=(".laz",))


def _timed(paths: Mapping[int, Path], times_ns: Mapping[int, int]) -> Iterator[tuple[int, Path]]:
    """Files with the times of their frames."""
    for number, path in paths.items():
        if number not in times_ns:
            raise DataError(path, expected=f"{BOXES}/frame_{number:07d}.json with its time", got="no such file")
        yield times_ns[number], path

"""Where KITTI-360's files of a sequence lie, by frame number."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from os import scandir
from pathlib import Path

from bench.errors import DataError
from bench.recordings.kitti360.options import CameraName, Kitti360Options
from bench.recordings.kitti360.sweeps import read_turn
from bench.recordings.kitti360.times import FrameClock
from bench.recordings.paths import refuse_escape
from bench.recordings.records import ImageRef, SweepRef
from bench.recordings.salvage import Complaint, refuse

IMAGES, SWEEPS, POSES, BOXES = "data_2d_raw", "data_3d_raw", "data_poses", "data_3d_bboxes"

Wanted = Callable[[int], bool]


def camera_names(folder: Path, options: Kitti360Options) -> tuple[CameraName, ...]:
    """The cameras of `options` that a sequence has images of."""
    return tuple(name for name in options.cameras if (folder / name / "data_rgb").is_dir())


def image_files(root: Path, sequence: str, camera: CameraName, complain: Complaint = refuse) -> dict[int, Path]:
    """Images of a camera by frame number, in order."""
    return _frames(root, root / IMAGES / sequence / camera / "data_rgb", "png", complain)


def sweep_files(root: Path, sequence: str, complain: Complaint = refuse) -> dict[int, Path]:
    """Scans by frame number, in order; none where the folder does not exist."""
    return _frames(root, root / SWEEPS / sequence / "velodyne_points" / "data", "bin", complain)


def image_refs(
    camera: CameraName, files: Mapping[int, Path], clock: FrameClock, expected: Wanted, complain: Complaint = refuse
) -> tuple[ImageRef, ...]:
    """The images of wanted frames; one whose frame has no time goes to `complain`."""
    times_ns = _times(files, clock, expected, complain)
    return tuple(ImageRef(camera=camera, timestamp_ns=time, path=files[frame]) for frame, time in times_ns.items())


def sweep_refs(
    files: Mapping[int, Path], clock: FrameClock, expected: Wanted, complain: Complaint = refuse
) -> tuple[SweepRef, ...]:
    """The scans of wanted frames; one whose frame has no time goes to `complain`."""
    reader = partial(read_turn, period_ns=clock.interval_ns)
    times_ns = _times(files, clock, expected, complain)
    return tuple(SweepRef(timestamp_ns=time, path=files[frame], reader=reader) for frame, time in times_ns.items())


def wanted_frames(sequence: str, options: Kitti360Options, covers: Wanted) -> Wanted:
    """Which frames are evaluated: those that are annotated and not left out."""
    left_out = [entry.frames for entry in options.excluded_frames if f"_drive_{entry.sequence}_" in sequence]
    return lambda frame: covers(frame) and not any(first <= frame <= last for first, last in left_out)


def _times(files: Mapping[int, Path], clock: FrameClock, expected: Wanted, complain: Complaint) -> dict[int, int]:
    times_ns: dict[int, int] = {}
    for frame, path in files.items():
        try:
            if expected(frame):
                times_ns[frame] = clock.at(frame, file=path)
        except DataError as error:
            complain(error)
    return times_ns


def _frames(root: Path, folder: Path, suffix: str, complain: Complaint) -> dict[int, Path]:
    """Files named by their frame number, in order; none where the folder does not exist."""
    if not folder.is_dir():
        return {}
    refuse_escape(root, folder, file=folder)
    found: dict[int, Path] = {}
    with scandir(folder) as entries:
        named = sorted(entry.name for entry in entries if re.fullmatch(rf"\d{{10}}\.{suffix}", entry.name))
    for name in named:
        path = folder / name
        try:
            if path.is_symlink():
                refuse_escape(root, path, file=path)
        except DataError as error:
            complain(error)
        else:
            found[int(path.stem)] = path
    return found

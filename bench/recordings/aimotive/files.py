"""Where the aiMotive data set's files of a sequence lie, by frame number."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from bench.errors import DataError
from bench.lidar import read_sweep
from bench.recordings.atomic import refuse_escape
from bench.recordings.error_handlers import OnError
from bench.recordings.records import ImageRef, SweepRef

BOXES = "dynamic/box/3d_body"
SWEEPS = "dynamic/raw-revolutions"


def box_files(root: Path, folder: Path, on_error: OnError) -> dict[int, Path]:
    """Files of boxes, which also tell the times of frames."""
    frames = _numbered(root, folder / BOXES, r"frame_(\d+)\.json", on_error)
    if not frames:
        expected = "files frame_<number>.json, which tell the times of frames"
        on_error(DataError(folder / BOXES, expected=expected, got="none"))
    return frames


def image_refs(
    root: Path,
    folder: Path,
    camera: str,
    times_ns: Mapping[int, int],
    on_error: OnError,
    *,
    untold: frozenset[int],
) -> tuple[ImageRef, ...]:
    """The images of a camera.

    Args:
        root: folder of the data set.
        folder: of the sequence.
        camera: name.
        times_ns: of frames.
        on_error: takes images whose frame has no time.
        untold: frames whose time could not be read, which was reported already.
    """
    place = folder / "sensor/camera" / camera
    paths = _numbered(root, place, rf"{re.escape(camera)}_(\d+)\.(?:jpg|png)", on_error)
    if not paths:
        on_error(DataError(place, expected=f"images {camera}_<number>.jpg", got="none"))
    timed = _timed(paths, times_ns, on_error, untold)
    return tuple(ImageRef(camera=camera, timestamp_ns=times_ns[n], path=path) for n, path in timed.items())


def sweep_refs(
    root: Path,
    folder: Path,
    times_ns: Mapping[int, int],
    on_error: OnError,
    *,
    untold: frozenset[int],
) -> tuple[SweepRef, ...]:
    """The revolutions; arguments as for `image_refs`."""
    paths = _numbered(root, folder / SWEEPS, r"frame_(\d+)\.laz", on_error)
    timed = _timed(paths, times_ns, on_error, untold)
    return tuple(SweepRef(timestamp_ns=times_ns[n], path=path, reader=read_sweep) for n, path in timed.items())


def _timed(
    paths: Mapping[int, Path], times_ns: Mapping[int, int], on_error: OnError, untold: frozenset[int]
) -> dict[int, Path]:
    for number, path in paths.items():
        if number not in times_ns and number not in untold:
            on_error(DataError(path, expected=f"{BOXES}/frame_{number:07d}.json with its time", got="no such file"))
    return {number: path for number, path in paths.items() if number in times_ns}


def _numbered(root: Path, folder: Path, pattern: str, on_error: OnError) -> dict[int, Path]:
    if not folder.is_dir():
        return {}
    refuse_escape(root, folder, file=folder)
    found: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        match = re.fullmatch(pattern, path.name)
        if match is None or len(match[1]) > 18:
            continue
        try:
            if path.is_symlink():
                refuse_escape(root, path, file=path)
            if int(match[1]) in found:
                raise DataError(path, expected="one file for each frame", got=f"also {found[int(match[1])].name}")
        except DataError as error:
            on_error(error)
        else:
            found[int(match[1])] = path
    return dict(sorted(found.items()))

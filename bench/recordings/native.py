"""The native recording format: what `synthesize` writes and what a user's own data is brought into."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from os.path import lexists
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from bench.atomic import path_inside, refuse_escape
from bench.egomotion import Trajectory, read_bus_signals, read_tum
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar import read_sweep
from bench.recordings.annotations import Statement, annotated_as, annotation_file_in, read_annotations
from bench.recordings.files import numbered_files
from bench.recordings.handles import RecordingHandle
from bench.recordings.images import WhiteLevelImage, read_mask
from bench.recordings.mounting import camera_model, mounted_camera
from bench.recordings.schema import RecordingHead, TrueCalibration
from bench.recordings.validation import LATEST_NS, FileModel, SidePx, read_json, validated
from bench.records.recording import NOT_ANNOTATED, Annotated, ImageRef, MountedCamera, Recording, SweepRef, Track

HEAD = "recording.json"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
SWEEP_SUFFIXES = (".npz", ".bin", ".pcd", ".ply", ".laz")
EGOMOTION_FILES = ("egomotion.csv", "poses.csv")
TRUE_POSES, TRUE_CALIBRATION = "truth/poses.csv", "truth/calibration.json"

Source = Literal["recorded", "exact"]


class NativeOptions(FileModel):
    """The card's `options`.

    Attributes:
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
        ego_motion: "recorded", what the car reports, or "exact", the true poses of a synthetic recording.
        calibration: "recorded", what `recording.json` says, or "exact", where the sensors of a synthetic recording are.
    """

    evaluated_size_px: tuple[SidePx, SidePx] | None = Field(default=None)
    ego_motion: Source = "recorded"
    calibration: Source = "recorded"


def _read_head(root: Path, calibration: Source) -> RecordingHead:
    """`recording.json`, with the true mountings where `calibration` is "exact"."""
    file = root / HEAD
    head = read_json(RecordingHead, file)
    refuse_escape(root, file, file=file)
    if head.name != root.resolve().name:
        expected = f"{root.resolve().name!r}, as its folder"
        raise DataError(file, field="name", expected=expected, got=repr(head.name))
    folder = root / "images"
    if not folder.is_dir():
        raise DataError(folder, expected="a folder with one folder of images per camera", got="no such folder")
    for name in sorted(path.name for path in folder.iterdir() if path.is_dir() and path.name not in head.cameras):
        expected = f"a calibration for images/{name}"
        raise DataError(file, field=f"cameras.{name}", expected=expected, got="none")
    return head if calibration == "recorded" else _truly_calibrated(root, head)


def _truly_calibrated(root: Path, head: RecordingHead) -> RecordingHead:
    file = _truth(root, TRUE_CALIBRATION, "calibration")
    true = read_json(TrueCalibration, file)
    if set(true.vehicle_from_camera) != set(head.cameras):
        raise DataError(
            file,
            field="vehicle_from_camera",
            expected=f"the cameras of {HEAD}: {', '.join(sorted(head.cameras))}",
            got=", ".join(sorted(true.vehicle_from_camera)) or "none",
        )
    cameras = {
        name: entry.model_copy(update={"vehicle_from_camera": true.vehicle_from_camera[name]})
        for name, entry in head.cameras.items()
    }
    lidar = head.lidar.model_copy(update={"vehicle_from_lidar": true.vehicle_from_lidar})
    return head.model_copy(update={"cameras": cameras, "lidar": lidar})


def _truth(root: Path, name: str, option: str) -> Path:
    """A file of the exact truth, which only synthetic recordings have."""
    file = root / name
    if not file.is_file():
        hint = f"set the card's option {option}: recorded, or render the recording again"
        raise DataError(file, expected=f"the truth for {option}: exact", got="no such file", hint=hint)
    refuse_escape(root, file, file=file)
    return file


def _cameras(head: RecordingHead, root: Path, size_px: tuple[int, int] | None) -> dict[str, MountedCamera]:
    """The cameras of the head, at the size at which they are evaluated."""
    file, cameras = root / HEAD, dict[str, MountedCamera]()
    for name, entry in head.cameras.items():
        field = f"cameras.{name}"
        ego_body = None
        if entry.ego_body_mask is not None:
            path = path_inside(root, entry.ego_body_mask, file=file, field=f"{field}.ego_body_mask")
            ego_body = read_mask(path, entry.image_size)
        cameras[name] = mounted_camera(
            name,
            camera_model(entry.model, entry.image_size, file=file, field=f"{field}.model"),
            entry.vehicle_from_camera.transform,
            ground_height_m=head.vehicle.ground_height_m,
            ego_body=ego_body,
            evaluated_size_px=size_px,
            rolling_shutter=entry.rolling_shutter,
            file=file,
            field=f"{field}.vehicle_from_camera",
        )
    return cameras


def _image_refs(root: Path, camera: str, white_level: int | None = None) -> tuple[ImageRef, ...]:
    """The images of a camera, by time."""
    folder = root / "images" / camera
    paths = _timed_files(root, folder, IMAGE_SUFFIXES)
    if not paths:
        raise DataError(folder, expected="images named <timestamp_ns>.png or .jpg", got="none")
    truth = _timed_files(root, root / "truth" / camera, (".png",))
    return tuple(
        ImageRef(
            camera=camera,
            timestamp_ns=time_ns,
            path=path,
            truth_path=truth.get(time_ns),
            stored=None if white_level is None else WhiteLevelImage(path, white_level),
        )
        for time_ns, path in paths.items()
    )


def _sweep_refs(root: Path) -> tuple[SweepRef, ...]:
    """The sweeps, by time."""
    paths = _timed_files(root, root / "lidar", SWEEP_SUFFIXES)
    return tuple(SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in paths.items())


def _timed_files(root: Path, folder: Path, suffixes: tuple[str, ...]) -> dict[int, Path]:
    """Files named by their time; hidden ones are not finished and passed over."""

    def time_ns(path: Path) -> int | None:
        if path.name.startswith(".") or path.suffix.lower() not in suffixes:
            return None
        if not path.stem.isascii() or not path.stem.isdigit() or int(path.stem) > LATEST_NS:
            seconds = path.stem.replace(".", "", 1).isdigit() and "." in path.stem
            hint = "these would be seconds: multiply them by 1000000000" if seconds else ""
            raise DataError(path, expected="a name that is a time in nanoseconds", got=repr(path.stem), hint=hint)
        return int(path.stem)

    return numbered_files(root, folder, time_ns, each="time")


def _ego_motion(root: Path, ego_motion: Source) -> Trajectory:
    """Read the motion that the car reports, or the true poses."""
    if ego_motion == "exact":
        return read_tum(_truth(root, TRUE_POSES, "ego_motion"))
    present = [root / name for name in EGOMOTION_FILES if (root / name).is_file()]
    if len(present) != 1:
        expected = f"one of {' and '.join(EGOMOTION_FILES)}"
        hint = "" if present else "the reference cannot do without: it moves lidar points to the time of the image"
        raise DataError(root, expected=expected, got="both" if present else "neither", hint=hint)
    refuse_escape(root, present[0], file=present[0])
    if present[0].name == "egomotion.csv":
        return read_bus_signals(present[0]).trajectory()
    return read_tum(present[0])


def _tracks(root: Path, annotations: Path | None, stated: Statement | None) -> tuple[tuple[Track, ...], Annotated]:
    """The objects of `annotations`, else of the recording's own file, and what they cover: without a file nothing."""
    file = annotations or _own_annotations(root, stated)
    if file is None:
        return (), NOT_ANNOTATED
    return read_annotations(file), annotated_as(stated or "complete")


def _own_annotations(root: Path, stated: Statement | None) -> Path | None:
    file = root / "annotations.json"
    if lexists(file):
        refuse_escape(root, file, file=file)
        return file
    if stated not in {None, "none"}:
        hint = f'write it, without objects where nothing moves, or state "annotated": "none" in {HEAD}'
        raise DataError(file, expected=f"annotations, as {HEAD} states them", got="no such file", hint=hint)
    return None


def open_native(
    root: Path,
    *,
    evaluated_size_px: tuple[int, int] | None = None,
    ego_motion: Source = "recorded",
    calibration: Source = "recorded",
    annotations: Path | None = None,
) -> Recording:
    """Open a native recording.

    Args:
        root: its folder.
        evaluated_size_px: (width, height) at which images are evaluated; None for as stored.
        ego_motion: "exact" for the true poses of a synthetic recording instead of what its car reports.
        calibration: "exact" for where its sensors are instead of where its calibration says that they are.
        annotations: annotation file that stands in for the recording's own; None for none.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    head = _read_head(root, calibration)
    cameras = _cameras(head, root, evaluated_size_px)
    images = {name: _image_refs(root, name, entry.white_level) for name, entry in head.cameras.items()}
    trajectory, sweeps = _ego_motion(root, ego_motion), _sweep_refs(root)
    tracks, annotated = _tracks(root, annotations, head.annotated)
    beams = head.lidar.lidar_from_sensor
    return Recording(
        name=root.resolve().name,
        root=root,
        licence=head.licence,
        frame_interval_ns=head.frame_interval_ns,
        cameras=cameras,
        images=images,
        trajectory=trajectory,
        vehicle_from_lidar=head.lidar.vehicle_from_lidar.transform,
        sweeps=sweeps,
        tracks=tracks,
        annotated=annotated,
        vehicle_outline_m=np.array(head.vehicle.outline_m, dtype=np.float64),
        lidar_from_sensor=RigidTransform.identity() if beams is None else beams.transform,
    )


def native_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `native`: each folder of `root` that looks like a recording, or `root` itself.

    One without `recording.json` but with images or annotations is listed too: opening it says what is missing.

    Raises:
        DataError: options that do not exist.
    """
    chosen = validated(NativeOptions, options, file=card, field="options")
    folders = [root] if (root / HEAD).is_file() else sorted(path for path in root.glob("[!.]*/") if _is_recording(path))
    handles = []
    for folder in folders:
        opener = partial(
            open_native,
            folder,
            evaluated_size_px=chosen.evaluated_size_px,
            ego_motion=chosen.ego_motion,
            calibration=chosen.calibration,
            annotations=annotation_file_in(annotations, folder.name),
        )
        handles.append(
            RecordingHandle(name=folder.name, opener=opener, parts=partial(_parts, folder, chosen, annotations))
        )
    return tuple(handles)


def _parts(root: Path, options: NativeOptions, annotations: Path | None) -> tuple[Callable[[], object], ...]:
    """Readers of the files of a recording, one by one."""
    cameras = sorted(path.name for path in root.glob("images/*/"))
    return (
        partial(_read_head, root, options.calibration),
        *(partial(_image_refs, root, name) for name in cameras),
        partial(_ego_motion, root, options.ego_motion),
        partial(_sweep_refs, root),
        partial(_tracks, root, annotation_file_in(annotations, root.name), None),
    )


def _is_recording(folder: Path) -> bool:
    return any((folder / name).exists() for name in (HEAD, "images", "annotations.json"))

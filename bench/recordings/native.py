"""The native recording format: what `synthesize` writes and what a user's own data is brought into."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from os import scandir
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.cameras import CameraModel, camera_from_parameters
from bench.egomotion import Trajectory, read_bus_signals, read_tum
from bench.errors import DataError, ShapeError, UnknownNameError
from bench.geometry import RigidTransform, RoadPlane
from bench.lidar import read_sweep
from bench.recordings.annotations import read_annotations
from bench.recordings.handles import RecordingHandle
from bench.recordings.images import read_mask
from bench.recordings.paths import path_inside, refuse_escape
from bench.recordings.records import ImageRef, MountedCamera, Recording, SweepRef, Track
from bench.recordings.resizing import scaled_camera
from bench.recordings.schema import CameraHead, Mounting, RecordingHead
from bench.recordings.validation import FileModel, data_error, read_json, validated

HEAD = "recording.json"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
SWEEP_SUFFIXES = (".npz", ".bin", ".pcd", ".ply", ".laz")
EGOMOTION_FILES = ("egomotion.csv", "poses.csv")


class NativeOptions(FileModel):
    """The card's `options`.

    Attributes:
        evaluated_size_px: (width, height) at which images are evaluated; null for as stored.
    """

    evaluated_size_px: tuple[int, int] | None = Field(default=None)


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
    return tuple(
        RecordingHandle(
            name=folder.name,
            opener=partial(
                open_native,
                folder,
                evaluated_size_px=chosen.evaluated_size_px,
                annotations=None if annotations is None else annotations / f"{folder.name}.json",
            ),
        )
        for folder in folders
    )


def _is_recording(folder: Path) -> bool:
    return any((folder / name).exists() for name in (HEAD, "images", "annotations.json"))


def open_native(
    root: Path, *, evaluated_size_px: tuple[int, int] | None = None, annotations: Path | None = None
) -> Recording:
    """Open a native recording.

    Args:
        root: its folder.
        evaluated_size_px: (width, height) at which images are evaluated; None for as stored.
        annotations: annotation file that stands in for the recording's own where it exists.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    file = root / HEAD
    head = read_json(RecordingHead, file)
    refuse_escape(root, file, file=file)
    if head.name != root.resolve().name:
        raise DataError(file, field="name", wanted=f"{root.resolve().name!r}, as its folder", came=repr(head.name))
    _refuse_uncalibrated(root, head)
    cameras = {name: _camera(root, name, entry, head, evaluated_size_px) for name, entry in head.cameras.items()}
    return Recording(
        name=head.name,
        root=root,
        licence=head.licence,
        frame_interval_ns=head.frame_interval_ns,
        cameras=cameras,
        images={name: _images(root, name) for name in cameras},
        trajectory=_trajectory(root),
        vehicle_from_lidar=_transform(head.lidar.vehicle_from_lidar),
        sweeps=_sweeps(root),
        tracks=_tracks(root, annotations),
        vehicle_outline_m=np.array(head.vehicle.outline_m, dtype=np.float64),
    )


def _camera(
    root: Path, name: str, entry: CameraHead, head: RecordingHead, size_px: tuple[int, int] | None
) -> MountedCamera:
    vehicle_from_camera = _transform(entry.vehicle_from_camera)
    try:
        road = RoadPlane.below(vehicle_from_camera, ground_height_m=head.vehicle.ground_height_m)
    except ShapeError as error:
        raise data_error(error, file=root / HEAD, field=f"cameras.{name}.vehicle_from_camera") from error
    camera = MountedCamera(
        name=name,
        model=_model(root / HEAD, name, entry),
        vehicle_from_camera=vehicle_from_camera,
        road=road,
        stored_size_px=entry.image_size,
        ego_body=_ego_body(root, name, entry),
    )
    return scaled_camera(camera, size_px)


def _model(file: Path, name: str, entry: CameraHead) -> CameraModel:
    field = f"cameras.{name}.model"
    model = entry.model.get("model")
    if not isinstance(model, str):
        raise DataError(file, field=f"{field}.model", wanted="the name of a camera model", came=repr(model))
    if taken := {"width", "height"} & set(entry.model):
        raise DataError(file, field=f"{field}.{taken.pop()}", wanted="no such key", came="one; image_size says it")
    parameters = {key: value for key, value in entry.model.items() if key != "model"}
    try:
        return camera_from_parameters(model, width=entry.image_size[0], height=entry.image_size[1], **parameters)
    except UnknownNameError as error:
        raise DataError(
            file, field=f"{field}.model", wanted=f"one of {', '.join(error.known)}", came=repr(model)
        ) from error
    except ShapeError as error:
        raise data_error(error, file=file, field=field) from error
    except (TypeError, ValueError) as error:
        raise DataError(file, field=field, wanted="numbers", came=str(error)) from error


def _ego_body(root: Path, name: str, entry: CameraHead) -> NDArray[np.bool_] | None:
    if entry.ego_body_mask is None:
        return None
    path = path_inside(root, entry.ego_body_mask, file=root / HEAD, field=f"cameras.{name}.ego_body_mask")
    return read_mask(path, entry.image_size)


def _transform(mounting: Mounting) -> RigidTransform:
    return RigidTransform.from_quaternion(mounting.quaternion_wxyz, mounting.translation_m)


def _refuse_uncalibrated(root: Path, head: RecordingHead) -> None:
    folder = root / "images"
    if not folder.is_dir():
        raise DataError(folder, wanted="a folder with one folder of images per camera", came="no such folder")
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.name not in head.cameras:
            wanted = f"a calibration for images/{path.name}"
            raise DataError(root / HEAD, field=f"cameras.{path.name}", wanted=wanted, came="none")


def _images(root: Path, camera: str) -> tuple[ImageRef, ...]:
    folder = root / "images" / camera
    paths = _timed_files(root, folder, IMAGE_SUFFIXES)
    if not paths:
        raise DataError(folder, wanted="images named <timestamp_ns>.png or .jpg", came="none")
    truth = _timed_files(root, root / "truth" / camera, (".png",))
    return tuple(
        ImageRef(camera=camera, timestamp_ns=time_ns, path=path, truth_path=truth.get(time_ns))
        for time_ns, path in sorted(paths.items())
    )


def _sweeps(root: Path) -> tuple[SweepRef, ...]:
    paths = _timed_files(root, root / "lidar", SWEEP_SUFFIXES)
    return tuple(SweepRef(timestamp_ns=t, path=path, reader=read_sweep) for t, path in sorted(paths.items()))


def _timed_files(root: Path, folder: Path, suffixes: tuple[str, ...]) -> dict[int, Path]:
    """Files named by their time; hidden ones are not finished and passed over."""
    if not folder.is_dir():
        return {}
    refuse_escape(root, folder, file=folder)
    found: dict[int, Path] = {}
    for entry in scandir(folder):
        path = Path(entry.path)
        if entry.name.startswith(".") or path.suffix.lower() not in suffixes:
            continue
        if not path.stem.isascii() or not path.stem.isdigit():
            raise DataError(path, wanted="a name that is a time in nanoseconds", came=repr(path.stem))
        if int(path.stem) in found:
            raise DataError(path, wanted="one file for each time", came=f"also {found[int(path.stem)].name}")
        if entry.is_symlink():
            refuse_escape(root, path, file=path)
        found[int(path.stem)] = path
    return found


def _trajectory(root: Path) -> Trajectory:
    present = [root / name for name in EGOMOTION_FILES if (root / name).is_file()]
    if len(present) != 1:
        wanted = f"one of {' and '.join(EGOMOTION_FILES)}"
        raise DataError(root, wanted=wanted, came="both" if present else "neither")
    refuse_escape(root, present[0], file=present[0])
    if present[0].name == "egomotion.csv":
        return read_bus_signals(present[0]).trajectory()
    return read_tum(present[0])


def _tracks(root: Path, annotations: Path | None) -> tuple[Track, ...]:
    if annotations is not None and annotations.is_file():
        return read_annotations(annotations)
    file = root / "annotations.json"
    if not file.is_file():
        do = "write one without objects where nothing is annotated"
        raise DataError(file, wanted="an annotation file", came="no such file", do=do)
    refuse_escape(root, file, file=file)
    return read_annotations(file)

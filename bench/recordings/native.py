"""The native recording format: what `synthesize` writes and what a user's own data is brought into."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from os.path import lexists
from pathlib import Path
from typing import Annotated as Of
from typing import Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bench.atomic import path_inside, refuse_escape
from bench.egomotion.files import read_bus_signals, read_tum
from bench.egomotion.trajectory import Trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.lidar.files import FORMATS, read_sweep
from bench.recordings.annotations import Statement, annotated_as, read_annotations
from bench.recordings.catalogue import RecordingHandle, handles_of
from bench.recordings.files import file_contents, numbered_files
from bench.recordings.images import WhiteLevelImage, read_mask
from bench.recordings.mounting import (
    EvaluatedSize,
    Mounting,
    Name,
    RollingShutterHead,
    SizePx,
    WhiteLevel,
    camera_model,
    mounted_camera,
)
from bench.recordings.validation import LATEST_NS, FileModel, Measured, located, read_json, validated
from bench.records.recording import (
    NOT_ANNOTATED,
    Annotated,
    Content,
    ImageRef,
    MountedCamera,
    Recording,
    SweepRef,
    Track,
)

HEAD = "recording.json"
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
SWEEP_SUFFIXES = tuple(FORMATS)
EGOMOTION_FILES = ("egomotion.csv", "poses.csv")
READ = (HEAD, *EGOMOTION_FILES, "annotations.json", "images", "lidar", "truth", "ego_body")
TRUE_POSES, TRUE_CALIBRATION = "truth/poses.csv", "truth/calibration.json"

SCHEMA_VERSION = 1
LONGEST_INTERVAL_NS = 3_600_000_000_000  # an hour
CONVENTIONS = (
    "Vehicle frame: x forward, y left, z up, metres, origin on the ground below the middle of the rear axle. "
    "Camera frame: x right, y down, z along the optical axis. a_from_b maps points of frame b into frame a. "
    "Pixels are (u, v), the centre of the first pixel is (0, 0). Quaternions are w, x, y, z here and x, y, z, w in "
    "annotations.json, as OpenLABEL has it. Times are nanoseconds."
)

FolderName = Of[str, Field(pattern=r"^[^/\\\x00-\x1f.][^/\\\x00-\x1f]*$")]


class VehicleHead(FileModel):
    """The ego vehicle.

    Attributes:
        outline_m: x and y of its outline seen from above.
        ground_height_m: height of the road in the vehicle frame.
    """

    outline_m: tuple[tuple[Measured, Measured], ...] = Field(min_length=3)
    ground_height_m: Measured = 0.0


class CameraHead(FileModel):
    """A camera.

    Attributes:
        model: `model` is the name of a camera model, the rest are its parameters without the image size.
        image_size: width and height of the stored images, px.
        vehicle_from_camera: the mounting.
        ego_body_mask: image in the recording, not 0 where the camera sees its own vehicle; null for nowhere.
        rolling_shutter: null where all rows are exposed at once.
        white_level: value of files of 16 bits that is white; fixed, since flow compares images. null for 65535.
    """

    model: dict[str, Any]
    image_size: SizePx
    vehicle_from_camera: Mounting
    ego_body_mask: str | None = None
    rolling_shutter: RollingShutterHead | None = None
    white_level: WhiteLevel | None = None


class LidarHead(FileModel):
    """The lidar.

    Attributes:
        vehicle_from_lidar: from the frame in which the sweeps give their points.
        lidar_from_sensor: where in that frame the beams start and the axes about which they turn; null where points are
            given in the sensor's own axes.
    """

    vehicle_from_lidar: Mounting
    lidar_from_sensor: Mounting | None = None


class TrueCalibration(FileModel):
    """`truth/calibration.json` of a synthetic recording: where the sensors sit, apart from what the head says.

    Attributes:
        vehicle_from_camera: by the camera's name.
        vehicle_from_lidar: of the lidar.
    """

    vehicle_from_camera: dict[Name, Mounting]
    vehicle_from_lidar: Mounting


class RecordingHead(FileModel):
    """`recording.json`.

    Attributes:
        schema_version: of this format.
        name: of the recording, the same as its folder's.
        licence: of the data.
        frame_interval_ns: nominal time between images.
        conventions: frames and orders of numbers in words, for readers of the file.
        annotated: "complete", "none", or which times and areas are; null for complete where there are annotations.
    """

    schema_version: Literal[1]
    name: FolderName
    licence: str
    frame_interval_ns: int = Field(gt=0, le=LONGEST_INTERVAL_NS)
    conventions: str = CONVENTIONS
    annotated: Statement | None = None
    vehicle: VehicleHead
    cameras: dict[Name, CameraHead] = Field(min_length=1)
    lidar: LidarHead


Source = Literal["recorded", "exact"]


def _with_places(columns: tuple[str, ...]) -> tuple[str, ...]:
    if not set("xyz") <= set(columns) or len(set(columns)) < len(columns):
        raise ValueError("each column once, x, y and z among them")
    return columns


BinColumns = Of[tuple[str, ...], Field(min_length=3, max_length=32), AfterValidator(_with_places)]


class NativeOptions(FileModel):
    """The card's `options`.

    Attributes:
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        ego_motion: "recorded", what the car reports, or "exact", the true poses of a synthetic recording.
        calibration: "recorded", what `recording.json` says, or "exact", where the sensors of a synthetic recording are.
        bin_columns: names of the columns of sweeps in .bin; null for x, y, z, intensity.
    """

    evaluated_size_px: EvaluatedSize = None
    ego_motion: Source = "recorded"
    calibration: Source = "recorded"
    bin_columns: BinColumns | None = None


def open_native(root: Path, *, annotations: Path | None = None, **options: Any) -> Recording:
    """Open a native recording.

    Args:
        root: its folder.
        annotations: annotation file that stands in for the recording's own; None for none.
        options: those of a card.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    chosen = validated(NativeOptions, options, file=root / HEAD, field="options")
    head = _read_head(root, chosen)
    images = {name: _images(root, name, entry.white_level) for name, entry in head.cameras.items()}
    read = read_sweep if chosen.bin_columns is None else partial(read_sweep, bin_columns=chosen.bin_columns)
    sweep_files = _timed_files(root, "lidar", SWEEP_SUFFIXES)
    sweeps = tuple(SweepRef(timestamp_ns=t, path=path, reader=read) for t, path in sweep_files.items())
    tracks, annotated = _tracks(root, head.annotated, annotations)
    beams = head.lidar.lidar_from_sensor
    return Recording(
        name=root.resolve().name,
        root=root,
        frame_interval_ns=head.frame_interval_ns,
        cameras={name: _camera(root, name, head, chosen) for name in head.cameras},
        images=images,
        trajectory=_trajectory(root, chosen),
        vehicle_from_lidar=head.lidar.vehicle_from_lidar.transform,
        sweeps=sweeps,
        tracks=tracks,
        annotated=annotated,
        vehicle_outline_m=np.array(head.vehicle.outline_m, dtype=np.float64),
        lidar_from_sensor=RigidTransform.identity() if beams is None else beams.transform,
        contents=tuple(_contents(root, images, sweeps)),
    )


def _inside(root: Path, name: str) -> Path:
    """A file of the folder, which no link may lead out of."""
    file = root / name
    refuse_escape(root, file, file=file)
    return file


def _truth(root: Path, name: str, option: str) -> Path:
    """A file of the exact truth, which only synthetic recordings have."""
    file = _inside(root, name)
    if not file.is_file():
        hint = f"set the card's option {option}: recorded, or render the recording again"
        raise DataError(file, expected=f"the truth for {option}: exact", got="no such file", hint=hint)
    return file


def _read_head(root: Path, options: NativeOptions) -> RecordingHead:
    """`recording.json`, with the true mountings where the card asks for these."""
    file = _inside(root, HEAD)
    head = read_json(RecordingHead, file)
    if head.name != root.resolve().name:
        expected = f"{root.resolve().name!r}, as its folder"
        raise DataError(file, field="name", expected=expected, got=repr(head.name))
    folder = root / "images"
    if not folder.is_dir():
        raise DataError(folder, expected="a folder with one folder of images per camera", got="no such folder")
    for name in sorted(path.name for path in folder.iterdir() if path.is_dir() and path.name not in head.cameras):
        expected = f"a calibration for images/{name}"
        raise DataError(file, field=f"cameras.{name}", expected=expected, got="none")
    return head if options.calibration == "recorded" else _truly_calibrated(root, head)


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


def _camera(root: Path, name: str, head: RecordingHead, options: NativeOptions) -> MountedCamera:
    """A camera, at the size at which it is evaluated."""
    file, place, entry = root / HEAD, f"cameras.{name}", head.cameras[name]
    ego_body = None
    if entry.ego_body_mask is not None:
        path = path_inside(root, entry.ego_body_mask, file=file, field=f"{place}.ego_body_mask")
        ego_body = read_mask(path, entry.image_size)
    with located(file, f"{place}.model"):
        model = camera_model(entry.model, entry.image_size)
    with located(file, f"{place}.vehicle_from_camera"):
        return mounted_camera(
            name,
            model,
            entry.vehicle_from_camera.transform,
            ground_height_m=head.vehicle.ground_height_m,
            ego_body=ego_body,
            evaluated_size_px=options.evaluated_size_px,
            rolling_shutter=entry.rolling_shutter,
        )


def _images(root: Path, camera: str, white_level: int | None) -> tuple[ImageRef, ...]:
    """The images of a camera, by time."""
    paths = _timed_files(root, f"images/{camera}", IMAGE_SUFFIXES)
    if not paths:
        raise DataError(root / "images" / camera, expected="images named <timestamp_ns>.png or .jpg", got="none")
    truth = _timed_files(root, f"truth/{camera}", (".png",))
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


def _timed_files(root: Path, folder: str, suffixes: tuple[str, ...]) -> dict[int, Path]:
    """Files named by their time; hidden ones are not finished and passed over."""

    def time_ns(path: Path) -> int | None:
        if path.name.startswith(".") or path.suffix.lower() not in suffixes:
            return None
        if not path.stem.isascii() or not path.stem.isdigit() or int(path.stem) > LATEST_NS:
            seconds = path.stem.replace(".", "", 1).isdigit() and "." in path.stem
            hint = "these would be seconds: multiply them by 1000000000" if seconds else ""
            raise DataError(path, expected="a name that is a time in nanoseconds", got=repr(path.stem), hint=hint)
        return int(path.stem)

    return numbered_files(root, root / folder, time_ns, each="time")


def _trajectory(root: Path, options: NativeOptions) -> Trajectory:
    """The motion that the car reports, or the true poses."""
    if options.ego_motion == "exact":
        return read_tum(_truth(root, TRUE_POSES, "ego_motion"))
    present = [name for name in EGOMOTION_FILES if (root / name).is_file()]
    if len(present) != 1:
        expected = f"one of {' and '.join(EGOMOTION_FILES)}"
        hint = "" if present else "the reference cannot do without: it moves lidar points to the time of the image"
        raise DataError(root, expected=expected, got="both" if present else "neither", hint=hint)
    file = _inside(root, present[0])
    return read_bus_signals(file) if present[0] == "egomotion.csv" else read_tum(file)


def _tracks(root: Path, stated: Statement | None, annotations: Path | None) -> tuple[tuple[Track, ...], Annotated]:
    """The objects of `annotations`, else of the recording's own file, and what they cover; without one nothing."""
    file = root / "annotations.json"
    if annotations is not None:  # what "none" is said of is the recording's own file
        return read_annotations(annotations), annotated_as("complete" if stated in {None, "none"} else stated)
    if lexists(file):
        return read_annotations(_inside(root, file.name)), annotated_as(stated or "complete")
    if stated not in {None, "none"}:
        hint = f'write it, without objects where nothing moves, or state "annotated": "none" in {HEAD}'
        raise DataError(file, expected=f"annotations, as {HEAD} states them", got="no such file", hint=hint)
    return (), NOT_ANNOTATED


def _contents(
    root: Path, images: Mapping[str, tuple[ImageRef, ...]], sweeps: tuple[SweepRef, ...]
) -> Iterator[Content]:
    """The files of the folder, those that are read and the others."""
    yield from file_contents(root, root, [root / name for name in READ], "part of the recording")
    for name, refs in images.items():
        folder, truth = root / "images" / name, root / "truth" / name
        yield from file_contents(root, folder, [ref.path for ref in refs], "images", suffixes=IMAGE_SUFFIXES)
        yield from file_contents(root, truth, [r.truth_path for r in refs if r.truth_path], "exact instances")
    yield from file_contents(root, root / "lidar", [ref.path for ref in sweeps], "sweeps", suffixes=SWEEP_SUFFIXES)


def native_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `native`: each folder of `root` that looks like a recording, or `root` itself.

    One without `recording.json` but with images or annotations is listed too: opening it says what is missing.

    Raises:
        DataError: options that do not exist.
    """
    validated(NativeOptions, options, file=card, field="options")
    names = [root] if (root / HEAD).is_file() else sorted(path for path in root.glob("[!.]*/") if _is_recording(path))
    return handles_of(names, partial(open_native, **options), annotations)


def _is_recording(folder: Path) -> bool:
    return any((folder / name).exists() for name in (HEAD, "images", "annotations.json"))

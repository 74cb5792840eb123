"""WoodScape (Yogamani et al. 2019): pairs of images of four surround-view cameras with masks of what moves.

```
rgb_images/<index>_<camera>.png            previous_images/<index>_<camera>_prev.png
motion_annotations/gtLabels/<index>_<camera>.png
calibration_data/calibration/<index>_<camera>.json
vehicle_data/{rgb_images,previous_images}/<index>_<camera>.json
```

What is translated here, once:

- The data set has no drives, only pairs (WoodScape #120), and times repeat from one of its drives to the next (#102): a
  pair is a recording of its own, with two images of which the later is scored.
- The vehicle frame is ours (ISO 8855, origin on the ground below the rear axle), quaternions are x, y, z, w, and the
  principal point is an offset from the middle of the image.
- Vehicle data are text: microseconds, km/h and degrees per second (#55). Over the pair the car runs an arc.
  Acceleration and steering are of unknown unit and not read.
- Any value of a mask that is not 0 moves; names and numbers of its classes do not line up. There is no lidar, so
  range, speed and kind of motion are unknown.
- Archives, readme and loader disagree on the folders (#16): a file is looked for in each of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from bench.atomic import linked_folder, refuse_escape
from bench.cameras.angular import RadialPolynomialCamera
from bench.egomotion.trajectory import Trajectory, planar_trajectory
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.catalogue import RecordingHandle
from bench.recordings.mounting import FisheyeOptions, Polygon, Quaternion
from bench.recordings.validation import (
    LARGEST_SIDE_PX,
    FileModel,
    ForeignModel,
    located,
    number_from_text,
    read_json,
    validated,
)
from bench.records.recording import COMPLETELY, ImageRef, MountedCamera, Recording

CameraName = Literal["FV", "RV", "MVL", "MVR"]

# Of a pair: the annotated image, the one before it, what moves in the annotated one, the calibration of the camera, and
# speed and yaw rate at both images.
Kind = Literal["current", "previous", "mask", "calibration", "vehicle", "vehicle_before"]
FOLDERS: Mapping[Kind, tuple[str, ...]] = {  # the likeliest first
    "current": ("rgb_images",),
    "previous": ("previous_images",),
    "mask": ("motion_annotations/gtLabels", "motion_annotations"),
    "calibration": ("calibration_data/calibration", "calibration", "calibration_data"),
    "vehicle": ("vehicle_data/rgb_images", "vehicle_info/rgb_images", "vehicle_data", "vehicle_info"),
    "vehicle_before": ("vehicle_data/previous_images", "vehicle_info/previous_images"),
}
PLACES: Mapping[Kind, tuple[str, ...]] = {  # archives unpacked into a folder of their own name give a folder twice
    kind: (*folders, *(f"{folder.partition('/')[0]}/{folder}" for folder in folders))
    for kind, folders in FOLDERS.items()
}
IMAGE = re.compile(r"(\d{5})_(FV|RV|MVL|MVR)\.png")
LATEST_US = 9_000_000_000_000_000  # in nanoseconds still an int64
LONGEST_PAIR_NS = 500_000_000
FASTEST_MPS = 100.0


class WoodscapeOptions(FisheyeOptions[CameraName]):
    """The card's `options`.

    Attributes:
        cameras: front, rear, left mirror and right mirror.
        vehicle_outline_m: the ego vehicle seen from above, vehicle frame.
        yaw_rate_positive: to which side the car turns where `ego_yawRate` is positive; the data set does not say.
    """

    cameras: tuple[CameraName, ...] = Field(default=("FV", "RV", "MVL", "MVR"), min_length=1)
    vehicle_outline_m: Polygon = Field(default=((-1.0, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.0, 0.95)), min_length=3)
    yaw_rate_positive: Literal["left", "right"] = "left"


def woodscape_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `woodscape`: each pair of images is a recording, named `<index>_<camera>`.

    Raises:
        DataError: options that are wrong, annotations apart from the data, or a folder without images.
    """
    chosen = validated(WoodscapeOptions, options, file=card, field="options")
    if annotations is not None:
        raise DataError(card, field="annotations", expected="none: this data set has masks", got=str(annotations))
    present = [root / place for place in PLACES["current"] if (root / place).is_dir()]
    if not present:
        folder = root / PLACES["current"][0]
        raise DataError(folder, expected="images <index>_<camera>.png", got="no such folder")
    names: set[str] = set()
    for folder in present:
        refuse_escape(linked_folder(root, folder, levels=chosen.follow_links), folder, file=folder)
        matches = [IMAGE.fullmatch(path.name) for path in folder.iterdir()]
        names |= {f"{m[1]}_{m[2]}" for m in matches if m is not None and m[2] in chosen.cameras}
    return tuple(
        RecordingHandle(name=name, opener=partial(open_woodscape, root, name, chosen)) for name in sorted(names)
    )


def open_woodscape(root: Path, pair: str, options: WoodscapeOptions) -> Recording:
    """Open a pair.

    Args:
        root: folder of the data set.
        pair: `<index>_<camera>`.
        options: as in the card.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    names: dict[Kind, list[str]] = {
        "current": [f"{pair}.png"],
        "previous": [f"{pair}{suffix}.png" for suffix in ("_prev", "_PREV", "_Prev")],
        "mask": [f"{pair}.png"],
        "calibration": [f"{pair}.json"],
        "vehicle": [f"{pair}.json"],
        "vehicle_before": [f"{pair}.json", f"{pair}_prev.json"],  # mostly it has the name of the later one
    }
    files = {kind: _file(root, PLACES[kind], these, options.follow_links) for kind, these in names.items()}
    camera = read_camera(files["calibration"], pair, options)
    trajectory, times_ns = _arc(files["vehicle_before"], files["vehicle"], options)
    images = (
        ImageRef(camera=camera.name, timestamp_ns=times_ns[0], path=files["previous"], scored=False),
        ImageRef(camera=camera.name, timestamp_ns=times_ns[1], path=files["current"], moving_path=files["mask"]),
    )
    return Recording(
        name=pair,
        root=root,
        frame_interval_ns=times_ns[1] - times_ns[0],
        cameras={camera.name: camera},
        images={camera.name: images},
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=(),
        tracks=(),
        annotated=COMPLETELY,
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def _file(root: Path, folders: tuple[str, ...], names: list[str], levels: int) -> Path:
    """The file of one of the names in one of the folders."""
    for path in (root / folder / name for folder in folders for name in names):
        if path.is_file():
            refuse_escape(linked_folder(root, path, levels=levels), path, file=path)
            return path
    got = "none of this name"
    raise DataError(root / folders[0] / names[0], expected=f"a file in {' or '.join(folders)}", got=got)


# Calibration


class Extrinsic(FileModel):
    """Mounting of the camera, camera to vehicle; the quaternion is x, y, z, w."""

    quaternion: Quaternion
    translation: tuple[float, float, float]


class Intrinsic(FileModel):
    """The lens, by name: the order of the keys is not the same in all files."""

    model: Literal["radial_poly"]
    poly_order: Literal[4]
    k1: float
    k2: float
    k3: float
    k4: float
    cx_offset: float
    cy_offset: float
    width: float = Field(ge=1, le=LARGEST_SIDE_PX)
    height: float = Field(ge=1, le=LARGEST_SIDE_PX)
    aspect_ratio: float = Field(gt=0)

    def lens(self, max_angle_rad: float | None) -> RadialPolynomialCamera:
        """The lens, whose principal point is stated as an offset from the middle of the image."""
        return RadialPolynomialCamera(
            width=int(self.width),
            height=int(self.height),
            coefficients=(self.k1, self.k2, self.k3, self.k4),
            principal_point=(self.cx_offset + self.width / 2 - 0.5, self.cy_offset + self.height / 2 - 0.5),
            aspect_ratio=self.aspect_ratio,
            max_angle_rad=max_angle_rad,
        )


class CalibrationFile(ForeignModel):
    """A file of `calibration_data`."""

    name: CameraName
    extrinsic: Extrinsic
    intrinsic: Intrinsic


def read_camera(file: Path, pair: str, options: WoodscapeOptions) -> MountedCamera:
    """Read the calibration of a pair.

    Args:
        file: JSON file.
        pair: `<index>_<camera>`.
        options: sizes and outlines.

    Raises:
        DataError: missing, of another camera, or not what the format asks for.
    """
    content = read_json(CalibrationFile, file)
    if content.name != (name := pair.split("_")[1]):
        raise DataError(file, field="name", expected=repr(name), got=repr(content.name))
    x, y, z, w = content.extrinsic.quaternion
    with located(file, content.name):
        vehicle_from_camera = RigidTransform.from_quaternion((w, x, y, z), content.extrinsic.translation)
        lens = content.intrinsic.lens(options.max_angle_rad(content.name))
        return options.mounted(content.name, lens, vehicle_from_camera)


# Vehicle data


FromText = BeforeValidator(number_from_text)  # the data set writes numbers as text
Number = Annotated[float, FromText]


class VehicleFile(ForeignModel):
    """The keys of a file of `vehicle_data` that are used."""

    timestamp: Annotated[int, FromText, Field(ge=0, le=LATEST_US)]
    ego_speed: Number
    ego_yaw_rate: Number = Field(alias="ego_yawRate")
    ego_gear: str = "D"


def _arc(file_before: Path, file: Path, options: WoodscapeOptions) -> tuple[Trajectory, tuple[int, int]]:
    """The motion from the earlier to the later image of a pair, and the times of both, ns."""
    before, after = (read_json(VehicleFile, path) for path in (file_before, file))
    times_ns = before.timestamp * 1000, after.timestamp * 1000
    wait_ns = times_ns[1] - times_ns[0]
    if not 0 < wait_ns <= LONGEST_PAIR_NS:
        expected = f"a time up to {LONGEST_PAIR_NS // 1000} microseconds after that of {file_before.parent.name}"
        raise DataError(file, field="timestamp", expected=expected, got=f"one {wait_ns // 1000} after it")
    speeds_mps = np.array([before.ego_speed, after.ego_speed]) / 3.6
    if np.abs(speeds_mps).max() > FASTEST_MPS:
        got = f"{before.ego_speed} and {after.ego_speed}"
        raise DataError(file, field="ego_speed", expected=f"at most {FASTEST_MPS * 3.6:g} km/h", got=got)
    turn = 1.0 if options.yaw_rate_positive == "left" else -1.0
    trajectory = planar_trajectory(
        source=str(file),
        timestamps_ns=np.array(times_ns, dtype=np.int64),
        speed_mps=speeds_mps,
        yaw_rate_radps=turn * np.deg2rad([before.ego_yaw_rate, after.ego_yaw_rate]),
        gear=[before.ego_gear, after.ego_gear],
    )
    return trajectory, times_ns

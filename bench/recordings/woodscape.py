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
- Any value of a mask that is not 0 moves; names and numbers of its classes do not line up. There is no lidar, so
  nothing tells range, speed or kind of motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from bench.cameras import RadialPolynomialCamera
from bench.egomotion import Trajectory, planar_trajectory
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.body_polygons import body_mask
from bench.recordings.handles import RecordingHandle
from bench.recordings.records import ImageRef, MountedCamera, Recording
from bench.recordings.resizing import scaled_camera
from bench.recordings.validation import FileModel, data_error, read_json, validated
from bench.recordings.woodscape_files import PairFiles, find_pair, list_pairs
from bench.recordings.woodscape_options import CameraName, WoodscapeOptions

LATEST_US = 9_000_000_000_000_000  # in nanoseconds still an int64
LONGEST_PAIR_NS = 500_000_000
FASTEST_MPS = 100.0
LONGEST_NUMBER = 40


def _from_text(value: object) -> object:
    """The data set writes numbers as text."""
    if not isinstance(value, str) or len(value) > LONGEST_NUMBER:
        return value
    try:
        return float(value)
    except ValueError:
        return value


def _whole_from_text(value: object) -> object:
    return int(value) if isinstance(value, str) and value.isascii() and value.isdigit() and len(value) < 20 else value


Number = Annotated[float, BeforeValidator(_from_text)]


class VehicleFile(FileModel):
    """A file of `vehicle_data`; acceleration and steering are of unknown unit and passed over."""

    model_config = ConfigDict(extra="ignore")

    timestamp: Annotated[int, BeforeValidator(_whole_from_text), Field(ge=0, le=LATEST_US)]
    ego_speed: Number
    ego_yaw_rate: Number = Field(alias="ego_yawRate")
    ego_gear: str = "D"


class Extrinsic(FileModel):
    """Where the camera sits, camera to vehicle."""

    quaternion: tuple[float, float, float, float]
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
    width: float = Field(ge=1, le=20_000)
    height: float = Field(ge=1, le=20_000)
    aspect_ratio: float = Field(gt=0)


class CalibrationFile(FileModel):
    """A file of `calibration_data`."""

    model_config = ConfigDict(extra="ignore")

    name: CameraName
    extrinsic: Extrinsic
    intrinsic: Intrinsic


def woodscape_recordings(
    root: Path, *, options: Mapping[str, Any], card: Path, annotations: Path | None
) -> tuple[RecordingHandle, ...]:
    """The adapter `woodscape`: each pair of images is a recording, named `<index>_<camera>`.

    Raises:
        DataError: options that are wrong, annotations apart from the data, or a folder without images.
    """
    chosen = validated(WoodscapeOptions, options, file=card, field="options")
    if annotations is not None:
        raise DataError(card, field="annotations", wanted="none: this data set has masks", came=str(annotations))
    return tuple(
        RecordingHandle(name=name, opener=partial(open_woodscape, root, pair=name, options=chosen))
        for name in list_pairs(root, chosen.cameras)
    )


def open_woodscape(root: Path, *, pair: str, options: WoodscapeOptions) -> Recording:
    """Open a pair.

    Args:
        root: folder of the data set.
        pair: `<index>_<camera>`.
        options: as in the card.

    Raises:
        DataError: a file that is missing or not what the format asks for.
    """
    files = find_pair(root, pair)
    camera = read_camera(files.calibration, options)
    if camera.name != pair.split("_")[1]:
        raise DataError(files.calibration, field="name", wanted=repr(pair.split("_")[1]), came=repr(camera.name))
    trajectory, times_ns = _trajectory(files, options)
    return Recording(
        name=pair,
        root=root,
        licence=options.licence,
        frame_interval_ns=times_ns[1] - times_ns[0],
        cameras={camera.name: camera},
        images={
            camera.name: (
                ImageRef(camera=camera.name, timestamp_ns=times_ns[0], path=files.previous, scored=False),
                ImageRef(camera=camera.name, timestamp_ns=times_ns[1], path=files.current, moving_path=files.mask),
            )
        },
        trajectory=trajectory,
        vehicle_from_lidar=RigidTransform.identity(),
        sweeps=(),
        tracks=(),
        vehicle_outline_m=np.array(options.vehicle_outline_m, dtype=np.float64),
    )


def read_camera(file: Path, options: WoodscapeOptions) -> MountedCamera:
    """Read a calibration.

    Args:
        file: JSON file.
        options: sizes and masks.

    Raises:
        DataError: missing, or not what the format asks for.
    """
    content = read_json(CalibrationFile, file)
    x, y, z, w = content.extrinsic.quaternion
    field_deg = options.field_of_view_deg.get(content.name)
    try:
        vehicle_from_camera = RigidTransform.from_quaternion((w, x, y, z), content.extrinsic.translation)
        model = RadialPolynomialCamera.from_woodscape(content.intrinsic.model_dump())
        if field_deg is not None:
            model = _narrowed(model, float(np.deg2rad(field_deg / 2)))
        road = RoadPlane.below(vehicle_from_camera)
    except ShapeError as error:
        raise data_error(error, file=file, field=content.name) from error
    size_px = model.width, model.height
    camera = MountedCamera(
        name=content.name,
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=road,
        stored_size_px=size_px,
        ego_body=body_mask(size_px, options.body_polygons.get(content.name, ())),
    )
    return scaled_camera(camera, options.evaluated_size_px)


def _narrowed(model: RadialPolynomialCamera, max_angle_rad: float) -> RadialPolynomialCamera:
    return RadialPolynomialCamera(
        width=model.width,
        height=model.height,
        principal_point=model.principal_point,
        coefficients=model.coefficients,
        aspect_ratio=model.aspect_ratio,
        max_angle_rad=max_angle_rad,
    )


def _trajectory(files: PairFiles, options: WoodscapeOptions) -> tuple[Trajectory, tuple[int, int]]:
    before, after = (read_json(VehicleFile, file) for file in (files.vehicle_before, files.vehicle))
    times_ns = before.timestamp * 1000, after.timestamp * 1000
    wait_ns = times_ns[1] - times_ns[0]
    if not 0 < wait_ns <= LONGEST_PAIR_NS:
        wanted = f"a time up to {LONGEST_PAIR_NS // 1000} microseconds after that of {files.vehicle_before.parent.name}"
        raise DataError(files.vehicle, field="timestamp", wanted=wanted, came=f"one {wait_ns // 1000} after it")
    speeds_mps = np.array([before.ego_speed, after.ego_speed]) / 3.6
    if np.abs(speeds_mps).max() > FASTEST_MPS:
        came = f"{before.ego_speed} and {after.ego_speed}"
        raise DataError(files.vehicle, field="ego_speed", wanted=f"at most {FASTEST_MPS * 3.6:g} km/h", came=came)
    turn = 1.0 if options.yaw_rate_positive == "left" else -1.0
    trajectory = planar_trajectory(
        source=str(files.vehicle),
        timestamps_ns=np.array(times_ns, dtype=np.int64),
        speed_mps=speeds_mps,
        yaw_rate_radps=turn * np.deg2rad([before.ego_yaw_rate, after.ego_yaw_rate]),
        gear=[before.ego_gear, after.ego_gear],
    )
    return trajectory, times_ns

"""The aiMotive data set's calibration file: cameras and the lidar, brought into mountings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, Field

from bench.atomic import MOST_LINK_LEVELS
from bench.cameras import camera_from_parameters
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.files import read_object
from bench.recordings.mounting import EvaluatedSize, Polygon, body_mask, mounted_camera
from bench.recordings.schema import RollingShutterHead
from bench.recordings.validation import FileModel, SidePx, located, validated
from bench.records.recording import MountedCamera

LICENCE = "CC BY-NC-SA 4.0"
FRAME_INTERVAL_NS = 66_666_667
CALIBRATION = "sensor/calibration/calibration.json"
MODELS = ("mei", "opencv_pinhole")


class EgoMotionOptions(FileModel):
    """Source of ego-motion.

    Attributes:
        file: CSV file, relative to the data set's root; `{sequence}` stands for the sequence's name.
        columns: as `bench.egomotion.read_bus_signals` takes them.
    """

    file: str
    columns: dict[str, str | float | tuple[str, ...]] = Field(default_factory=dict)


class AimotiveOptions(FileModel):
    """The card's `options`.

    Attributes:
        cameras: those to evaluate; null for every camera that has images.
        ego_motion: where ego-motion comes from; null for the data set's own `egomotion.json`.
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        field_of_view_deg: per camera, full angle of the lens, beyond which the image is dark; absent for as far as the
            calibration holds.
        body_polygons: per camera, outlines of the ego vehicle's body, (u, v) in stored pixels.
        rolling_shutter: per camera, its readout; the data do not state it. Absent where all rows are exposed at once.
        ground_height_m: height of the road in the body frame.
        vehicle_outline_m: the ego vehicle seen from above, body frame, where the size of the ego vehicle is known.
        follow_links: how many levels below `root` links to folders are followed; 1 for those in `root` itself.
        licence: of the data.
    """

    cameras: tuple[str, ...] | None = None
    ego_motion: EgoMotionOptions | None = None
    evaluated_size_px: EvaluatedSize = None
    field_of_view_deg: dict[str, float] = Field(default_factory=dict)
    body_polygons: dict[str, tuple[Polygon, ...]] = Field(default_factory=dict)
    rolling_shutter: dict[str, RollingShutterHead] = Field(default_factory=dict)
    ground_height_m: float = 0.0
    vehicle_outline_m: Polygon = Field(default=((-1.1, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.1, 0.95)), min_length=3)
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)
    licence: str = LICENCE


class SensorCalibration(FileModel):
    """The key of any sensor's calibration that is used; the file has many more."""

    model_config = ConfigDict(extra="ignore")

    RT_body_from_sensor: tuple[tuple[float, float, float, float], ...] = Field(min_length=4, max_length=4)


class CameraCalibration(SensorCalibration):
    """The keys of a camera's calibration that are used."""

    model: str
    xi: float | None = None
    focal_length_px: tuple[float, float]
    principal_point_px: tuple[float, float]
    distortion_coeffs: tuple[float, ...] = Field(min_length=4)
    image_resolution_px: tuple[SidePx, SidePx]


def read_cameras(root: Path, folder: Path, options: AimotiveOptions) -> dict[str, MountedCamera]:
    """Read the calibration of a sequence.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.
        options: which cameras, at which size, with which masks.

    Raises:
        DataError: a missing file, a camera without a calibration, or one of another model.
    """
    file = folder / CALIBRATION
    content = read_object(root, file, expected="calibrations by sensor name")
    names = _camera_names(folder, content) if options.cameras is None else options.cameras
    if not names:
        raise DataError(folder / "sensor/camera", expected="images of a camera with a known model", got="none")
    for name in names:
        if name not in content:
            raise DataError(file, field=name, expected="a calibration of this camera", got="none")
    return {name: _camera(name, content[name], file, options) for name in names}


def _is_known(entry: Any) -> bool:
    """Also an entry that is no object, so that it is reported."""
    return not isinstance(entry, dict) or entry.get("model") in MODELS


def _camera_names(folder: Path, content: Mapping[str, Any]) -> tuple[str, ...]:
    present = sorted(path.name for path in folder.glob("sensor/camera/*") if path.is_dir())
    return tuple(n for n in present if n not in content or _is_known(content[n]))


def _camera(name: str, content: Mapping[str, Any], file: Path, options: AimotiveOptions) -> MountedCamera:
    entry = validated(CameraCalibration, content, file=file, field=name)
    if entry.model not in MODELS:
        raise DataError(file, field=f"{name}.model", expected=" or ".join(map(repr, MODELS)), got=repr(entry.model))
    k1, k2, p1, p2, k3 = (*entry.distortion_coeffs, 0.0)[:5]
    if any(entry.distortion_coeffs[5:]) or (k3 and entry.model == "mei"):
        expected = "k1, k2, p1, p2, 0" if entry.model == "mei" else "k1, k2, p1, p2, k3"
        got = "further ones that are not 0"
        raise DataError(file, field=f"{name}.distortion_coeffs", expected=expected, got=got)
    if entry.xi is None and entry.model == "mei":
        raise DataError(file, field=f"{name}.xi", expected="a value", got="nothing")
    field_deg = options.field_of_view_deg.get(name)
    with located(file, name):
        vehicle_from_camera = RigidTransform.from_matrix(entry.RT_body_from_sensor)
        lens: dict[str, Any] = {
            "width": entry.image_resolution_px[0],
            "height": entry.image_resolution_px[1],
            "focal": entry.focal_length_px,
            "principal_point": entry.principal_point_px,
            "tangential": (p1, p2),
            "max_angle_rad": None if field_deg is None else float(np.deg2rad(field_deg / 2)),
        }
        if entry.model == "mei":
            model = camera_from_parameters("unified", **lens, xi=entry.xi, radial=(k1, k2))
        else:
            model = camera_from_parameters("brown_conrady", **lens, radial=(k1, k2, k3))
    return mounted_camera(
        name,
        model,
        vehicle_from_camera,
        ground_height_m=options.ground_height_m,
        ego_body=body_mask(entry.image_resolution_px, options.body_polygons.get(name, ())),
        evaluated_size_px=options.evaluated_size_px,
        rolling_shutter=options.rolling_shutter.get(name),
        file=file,
        field=name,
    )


def read_lidar_mounting(root: Path, folder: Path) -> RigidTransform:
    """`body_from_beams` of the one lidar that the calibration names.

    Points come in body axes, so it serves only to find rows and columns of beams. Where the calibration names no lidar,
    or several whose points are mixed, it is the identity: surface-patch polygons then have no rows.

    Args:
        root: folder of the data set, which the file must not leave.
        folder: of the sequence.

    Raises:
        DataError: missing, not a calibration, or a mounting that is none.
    """
    file = folder / CALIBRATION
    content = read_object(root, file, expected="calibrations by sensor name")
    names = [n for n, entry in content.items() if isinstance(entry, dict) and entry.get("sensor_type") == "lidar"]
    if len(names) != 1:
        return RigidTransform.identity()
    entry = validated(SensorCalibration, content[names[0]], file=file, field=names[0])
    with located(file, f"{names[0]}.RT_body_from_sensor"):
        return RigidTransform.from_matrix(entry.RT_body_from_sensor)

"""WoodScape's calibration files, brought into mounted cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from bench.cameras import RadialPolynomialCamera
from bench.errors import DataError, ShapeError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.body_polygons import body_mask
from bench.recordings.images import read_mask
from bench.recordings.paths import path_inside
from bench.recordings.records import MountedCamera
from bench.recordings.resizing import scaled_camera
from bench.recordings.validation import LARGEST_SIDE_PX, FileModel, data_error, read_json
from bench.recordings.woodscape.options import CameraName, WoodscapeOptions


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
    width: float = Field(ge=1, le=LARGEST_SIDE_PX)
    height: float = Field(ge=1, le=LARGEST_SIDE_PX)
    aspect_ratio: float = Field(gt=0)


class CalibrationFile(FileModel):
    """A file of `calibration_data`."""

    model_config = ConfigDict(extra="ignore")

    name: CameraName
    extrinsic: Extrinsic
    intrinsic: Intrinsic


def read_camera(root: Path, file: Path, pair: str, options: WoodscapeOptions) -> MountedCamera:
    """Read the calibration of a pair.

    Args:
        root: folder of the data set, that masks stay inside.
        file: JSON file.
        pair: `<index>_<camera>`.
        options: sizes and masks.

    Raises:
        DataError: missing, of another camera, or not what the format asks for; a mask that is not.
    """
    content = read_json(CalibrationFile, file)
    index, name = pair.split("_")
    if content.name != name:
        raise DataError(file, field="name", expected=repr(name), got=repr(content.name))
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
    camera = MountedCamera(
        name=content.name,
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=road,
        stored_size_px=(model.width, model.height),
        ego_body=_ego_body(root, content.name, int(index), (model.width, model.height), options),
    )
    return scaled_camera(camera, options.evaluated_size_px)


def _ego_body(
    root: Path, name: CameraName, index: int, size_px: tuple[int, int], options: WoodscapeOptions
) -> NDArray[np.bool_] | None:
    """What the card draws for every car, with what it has for the car of this index."""
    car = options.car(index)
    drawn = body_mask(size_px, (*options.body_polygons.get(name, ()), *car.body_polygons.get(name, ())))
    if name not in car.body_masks:
        return drawn
    field = f"options.cars.body_masks.{name}"
    stored = read_mask(path_inside(root, car.body_masks[name], file=root, field=field), size_px)
    return stored if drawn is None else stored | drawn


def _narrowed(model: RadialPolynomialCamera, max_angle_rad: float) -> RadialPolynomialCamera:
    return RadialPolynomialCamera(
        width=model.width,
        height=model.height,
        principal_point=model.principal_point,
        coefficients=model.coefficients,
        aspect_ratio=model.aspect_ratio,
        max_angle_rad=max_angle_rad,
    )

"""WoodScape's calibration files, brought into mounted cameras."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from bench.atomic import MOST_LINK_LEVELS, path_inside
from bench.cameras import RadialPolynomialCamera
from bench.errors import DataError
from bench.geometry import RigidTransform
from bench.recordings.images import read_mask
from bench.recordings.mounting import EvaluatedSize, Polygon, body_mask, mounted_camera
from bench.recordings.validation import LARGEST_SIDE_PX, FileModel, located, read_json
from bench.records.recording import MountedCamera

LICENCE = "Valeo WoodScape licence: research, teaching and benchmarking, not commercial"
OUTLINE_M = ((-1.0, -0.95), (3.9, -0.95), (3.9, 0.95), (-1.0, 0.95))
CameraName = Literal["FV", "RV", "MVL", "MVR"]
Index = Annotated[int, Field(ge=0, le=99_999)]


class CarOptions(FileModel):
    """One of the cars that the images were taken from; only the index identifies them.

    Attributes:
        indices: first and last index of its images, both included; null for open.
        body_polygons: per camera, outlines of this car's own body, (u, v) in stored pixels.
        body_masks: per camera, an image below the data set's root that is not 0 on this car's own body.
        vehicle_outline_m: this car seen from above, vehicle frame; null for that of all cars.
    """

    indices: tuple[Index | None, Index | None] = (None, None)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    body_masks: dict[CameraName, str] = Field(default_factory=dict)
    vehicle_outline_m: Annotated[Polygon, Field(min_length=3)] | None = None

    @model_validator(mode="after")
    def _is_ordered(self) -> CarOptions:
        first, last = self.span
        if first > last:
            raise ValueError("the first index not after the last")
        return self

    @property
    def span(self) -> tuple[int, int]:
        """First and last index."""
        first, last = self.indices
        return 0 if first is None else first, 99_999 if last is None else last


class WoodscapeOptions(FileModel):
    """The card's `options`.

    Attributes:
        cameras: front, rear, left mirror and right mirror.
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        field_of_view_deg: per camera, full angle of the lens; absent for as far as the calibration is one-to-one.
        body_polygons: per camera, outlines of the ego vehicle's body in the images of every car, (u, v) in stored
            pixels.
        cars: what differs from car to car; an index that none of them has is of a car without masks of its own.
        vehicle_outline_m: the ego vehicle seen from above, vehicle frame.
        yaw_rate_positive: to which side the car turns where `ego_yawRate` is positive; the data set does not say.
        follow_links: how many levels below `root` links to folders are followed; 1 for those in `root` itself.
        licence: of the data.
    """

    cameras: tuple[CameraName, ...] = Field(default=("FV", "RV", "MVL", "MVR"), min_length=1)
    evaluated_size_px: EvaluatedSize = None
    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    cars: tuple[CarOptions, ...] = ()
    vehicle_outline_m: Polygon = Field(default=OUTLINE_M, min_length=3)
    yaw_rate_positive: Literal["left", "right"] = "left"
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)
    licence: str = LICENCE

    @model_validator(mode="after")
    def _cars_apart(self) -> WoodscapeOptions:
        spans = sorted(car.span for car in self.cars)
        if any(later[0] <= earlier[1] for earlier, later in pairwise(spans)):
            raise ValueError("cars whose indices do not overlap")
        return self

    def car(self, index: int) -> CarOptions:
        """The car that an image was taken from."""
        return next((car for car in self.cars if car.span[0] <= index <= car.span[1]), CarOptions())

    def outline_m(self, index: int) -> Polygon:
        """The car seen from above."""
        return self.car(index).vehicle_outline_m or self.vehicle_outline_m


class Extrinsic(FileModel):
    """Mounting of the camera, camera to vehicle."""

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
    with located(file, content.name):
        vehicle_from_camera = RigidTransform.from_quaternion((w, x, y, z), content.extrinsic.translation)
        model = RadialPolynomialCamera.from_woodscape(content.intrinsic.model_dump())
        if field_deg is not None:
            model = replace(model, max_angle_rad=float(np.deg2rad(field_deg / 2)))
    return mounted_camera(
        content.name,
        model,
        vehicle_from_camera,
        ego_body=_ego_body(root, content.name, int(index), (model.width, model.height), options),
        evaluated_size_px=options.evaluated_size_px,
        file=file,
        field=content.name,
    )


def _ego_body(
    root: Path, name: CameraName, index: int, size_px: tuple[int, int], options: WoodscapeOptions
) -> NDArray[np.bool_] | None:
    """Mask of the body: as the card draws it for every car, with the card's mask for the car of this index."""
    car = options.car(index)
    drawn = body_mask(size_px, (*options.body_polygons.get(name, ()), *car.body_polygons.get(name, ())))
    if name not in car.body_masks:
        return drawn
    field = f"options.cars.body_masks.{name}"
    stored = read_mask(path_inside(root, car.body_masks[name], file=root, field=field), size_px)
    return stored if drawn is None else stored | drawn

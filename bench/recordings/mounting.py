"""Cameras on the vehicle: lens, mounting, the road below, the evaluated size, masks of the vehicle itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from bench.atomic import MOST_LINK_LEVELS
from bench.cameras.model import LONGEST_READOUT_S, CameraModel, ReadoutDirection, RollingShutter
from bench.cameras.stored import camera_from_parameters
from bench.errors import ShapeError, UnknownNameError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.images import MOST_WHITE
from bench.recordings.validation import FileModel, Measured, SidePx
from bench.records.recording import MountedCamera

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
WhiteLevel = Annotated[int, Field(ge=255, le=MOST_WHITE)]
Quaternion = tuple[float, float, float, float]
Polygon = tuple[tuple[Measured, Measured], ...]
SizePx = tuple[SidePx, SidePx]  # width, height
EvaluatedSize = SizePx | dict[str, SizePx] | None  # of all cameras, or by camera


class Mounting(FileModel):
    """A rigid transform as files state it, for example where a sensor sits on the vehicle.

    Attributes:
        quaternion_wxyz: of length 1.
        translation_m: x, y and z.
    """

    quaternion_wxyz: Quaternion
    translation_m: tuple[Measured, Measured, Measured]

    @field_validator("quaternion_wxyz")
    @classmethod
    def _unit(cls, wxyz: Quaternion) -> Quaternion:
        length = sum(part * part for part in wxyz) ** 0.5
        if abs(length - 1.0) > 1e-3:
            raise ValueError(f"a quaternion w, x, y, z of length 1 (this one has {length:.4g})")
        return wxyz

    @classmethod
    def of(cls, transform: RigidTransform) -> Mounting:
        """Return the file's form of a transform."""
        w, x, y, z = transform.quaternion_wxyz.tolist()
        along_x, along_y, along_z = transform.translation_m.tolist()
        return cls(quaternion_wxyz=(w, x, y, z), translation_m=(along_x, along_y, along_z))

    @property
    def transform(self) -> RigidTransform:
        """The transform that a file states."""
        return RigidTransform.from_quaternion(self.quaternion_wxyz, self.translation_m)


class RollingShutterHead(FileModel):
    """A rolling shutter as files state it; keys as of `RollingShutter`."""

    readout_s: float = Field(gt=0, le=LONGEST_READOUT_S)
    direction: ReadoutDirection = "down"

    @property
    def shutter(self) -> RollingShutter:
        """The shutter that a file states."""
        return RollingShutter(readout_s=self.readout_s, direction=self.direction)


CameraName = TypeVar("CameraName", bound=str)


class CameraOptions(FileModel, Generic[CameraName]):
    """What a card says of the cameras of a published data set.

    Attributes:
        evaluated_size_px: (width, height) at which images are evaluated, of all cameras or by camera; null for as
            stored.
        body_polygons: per camera, outlines of the ego vehicle's body, (u, v) in stored pixels.
        rolling_shutter: per camera, its readout; the data do not state it. Absent where all rows are exposed at once.
        follow_links: how many levels below `root` links to folders are followed; 1 for those in `root` itself.
    """

    evaluated_size_px: EvaluatedSize = None
    body_polygons: dict[CameraName, tuple[Polygon, ...]] = Field(default_factory=dict)
    rolling_shutter: dict[CameraName, RollingShutterHead] = Field(default_factory=dict)
    follow_links: int = Field(default=1, ge=0, le=MOST_LINK_LEVELS)

    def mounted(
        self,
        camera: CameraName,
        model: CameraModel,
        vehicle_from_camera: RigidTransform,
        *,
        ground_height_m: float = 0.0,
    ) -> MountedCamera:
        """A camera with these options; arguments and errors as of `mounted_camera`."""
        return mounted_camera(
            camera,
            model,
            vehicle_from_camera,
            ground_height_m=ground_height_m,
            ego_body=body_mask((model.width, model.height), self.body_polygons.get(camera, ())),
            evaluated_size_px=self.evaluated_size_px,
            rolling_shutter=self.rolling_shutter.get(camera),
        )


class FisheyeOptions(CameraOptions[CameraName], Generic[CameraName]):
    """The same of cameras whose lenses see less than their calibration says.

    Attributes:
        field_of_view_deg: per camera, full angle of the lens, beyond which the image is dark; absent for as far as the
            calibration holds.
    """

    field_of_view_deg: dict[CameraName, float] = Field(default_factory=dict)

    def max_angle_rad(self, camera: CameraName) -> float | None:
        """Half of the field of view; None where the card does not say it."""
        field_deg = self.field_of_view_deg.get(camera)
        return None if field_deg is None else float(np.deg2rad(field_deg / 2))


def mounted_camera(
    name: str,
    model: CameraModel,
    vehicle_from_camera: RigidTransform,
    *,
    ground_height_m: float = 0.0,
    ego_body: NDArray[np.bool_] | None,
    evaluated_size_px: EvaluatedSize,
    rolling_shutter: RollingShutterHead | None = None,
) -> MountedCamera:
    """A camera at the size at which it is evaluated.

    Args:
        name: unique in the recording.
        model: the lens, at the size of the stored images.
        vehicle_from_camera: the mounting.
        ground_height_m: height of the road in the vehicle frame.
        ego_body: as of the camera, at the size of the stored images.
        evaluated_size_px: of all cameras, or by camera; as stored without.
        rolling_shutter: as a file states it; None where all rows are exposed at once.

    Raises:
        ShapeError: a camera that is not above the road, or images that would be squeezed.
    """
    road = RoadPlane.below(vehicle_from_camera, ground_height_m=ground_height_m)
    camera = MountedCamera(
        name=name,
        model=model,
        vehicle_from_camera=vehicle_from_camera,
        road=road,
        stored_size_px=(model.width, model.height),
        ego_body=ego_body,
        rolling_shutter=None if rolling_shutter is None else rolling_shutter.shutter,
    )
    size_px = evaluated_size_px.get(name) if isinstance(evaluated_size_px, dict) else evaluated_size_px
    return camera if size_px is None else _scaled(camera, size_px)


def _scaled(camera: MountedCamera, size_px: SizePx) -> MountedCamera:
    """Return the camera evaluated at another size; the images on disk stay as they are."""
    (width, height), (stored_width, stored_height) = size_px, camera.stored_size_px
    if (width, height) == (stored_width, stored_height):
        return camera
    kept = width, round(width * stored_height / stored_width)
    if abs(height - kept[1]) > 1:
        images = f"the images of {camera.name!r}, {stored_width} x {stored_height} px"
        hint = f"give a size by camera: evaluated_size_px: {{{camera.name}: [{kept[0]}, {kept[1]}]}}"
        raise ShapeError(
            f"expected an option evaluated_size_px in the shape of {images}, got {width} x {height} px; {hint}"
        )
    body = camera.ego_body
    if body is not None:
        body = cv2.resize(body.astype(np.uint8), size_px, interpolation=cv2.INTER_NEAREST).astype(bool)
    return replace(camera, model=camera.model.scaled(width, height), ego_body=body)


def body_mask(size_px: tuple[int, int], polygons: Sequence[Polygon]) -> NDArray[np.bool_] | None:
    """Fill polygons.

    Args:
        size_px: (width, height) of the stored images.
        polygons: corners (u, v) in stored pixels.

    Returns:
        (height, width) bool, True inside; None without polygons.
    """
    if not polygons:
        return None
    filled = np.zeros((size_px[1], size_px[0]), dtype=np.uint8)
    for polygon in polygons:  # one call for all leaves out where two overlap
        cv2.fillPoly(filled, [np.rint(polygon).astype(np.int32)], 1)
    return filled.astype(bool)


def camera_model(stated: Mapping[str, Any], image_size: tuple[int, int]) -> CameraModel:
    """The lens of a camera.

    Args:
        stated: `model` is the name of a camera model, the rest are its parameters without the image size.
        image_size: (width, height), px.

    Raises:
        ShapeError: no such model, or values that make none.
    """
    model, parameters = stated.get("model"), {key: value for key, value in stated.items() if key != "model"}
    if not isinstance(model, str):
        raise ShapeError(f"model: expected the name of a camera model, got {model!r}")
    if taken := {"width", "height"} & set(stated):
        raise ShapeError(f"{taken.pop()}: expected no such key, got one; image_size says it")
    try:
        return camera_from_parameters(model, width=image_size[0], height=image_size[1], **parameters)
    except UnknownNameError as error:
        raise ShapeError(f"model: expected one of {', '.join(error.known)}, got {model!r}") from error
    except ShapeError:
        raise
    except (TypeError, ValueError) as error:
        raise ShapeError(f"expected numbers, got {error}") from error

"""Cameras on the vehicle: lens, mounting, the road below, the evaluated size, masks of the vehicle itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel, camera_from_parameters
from bench.errors import DataError, UnknownNameError
from bench.geometry import RigidTransform, RoadPlane
from bench.recordings.schema import RollingShutterHead
from bench.recordings.validation import SidePx, located
from bench.records.recording import MountedCamera

Polygon = tuple[tuple[float, float], ...]
SizePx = tuple[SidePx, SidePx]  # width, height
EvaluatedSize = SizePx | dict[str, SizePx] | None  # of all cameras, or by camera


def mounted_camera(
    name: str,
    model: CameraModel,
    vehicle_from_camera: RigidTransform,
    *,
    ground_height_m: float = 0.0,
    ego_body: NDArray[np.bool_] | None,
    evaluated_size_px: EvaluatedSize,
    rolling_shutter: RollingShutterHead | None = None,
    file: Path,
    field: str,
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
        file: that says where the camera is, for messages.
        field: the same.

    Raises:
        DataError: a camera that is not above the road, or images that would be squeezed.
    """
    height_m = float(vehicle_from_camera.translation_m[2]) - ground_height_m
    if not height_m > 0.0:
        inverse_m = float(vehicle_from_camera.inverse().translation_m[2]) - ground_height_m
        inverse = f"the inverse of the mounting stands {inverse_m:.2f} m above it"
        raise DataError(
            file,
            field=field,
            expected="a camera above the road",
            got=f"a height of {height_m:.2f} m",
            hint=f"{inverse}: give vehicle_from_camera, not camera_from_vehicle" if inverse_m > 0.0 else "",
        )
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
    return camera if size_px is None else _scaled(camera, size_px, file)


def _scaled(camera: MountedCamera, size_px: SizePx, file: Path) -> MountedCamera:
    """Return the camera evaluated at another size; the images on disk stay as they are."""
    (width, height), (stored_width, stored_height) = size_px, camera.stored_size_px
    if (width, height) == (stored_width, stored_height):
        return camera
    kept = width, round(width * stored_height / stored_width)
    if abs(height - kept[1]) > 1:
        raise DataError(
            file,
            field=f"camera {camera.name!r}",
            expected=f"options.evaluated_size_px in the shape of its images, {stored_width} x {stored_height} px",
            got=f"{width} x {height} px, which squeeze them",
            hint=f"give a size by camera: evaluated_size_px: {{{camera.name}: [{kept[0]}, {kept[1]}]}}",
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


def camera_model(stated: Mapping[str, Any], image_size: tuple[int, int], *, file: Path, field: str) -> CameraModel:
    """The lens of a camera.

    Args:
        stated: `model` is the name of a camera model, the rest are its parameters without the image size.
        image_size: (width, height), px.
        file: that holds them, for messages.
        field: the same.

    Raises:
        DataError: no such model, or values that make none.
    """
    model = stated.get("model")
    if not isinstance(model, str):
        raise DataError(file, field=f"{field}.model", expected="the name of a camera model", got=repr(model))
    if taken := {"width", "height"} & set(stated):
        raise DataError(file, field=f"{field}.{taken.pop()}", expected="no such key", got="one; image_size says it")
    parameters = {key: value for key, value in stated.items() if key != "model"}
    try:
        with located(file, field):
            return camera_from_parameters(model, width=image_size[0], height=image_size[1], **parameters)
    except UnknownNameError as error:
        raise DataError(
            file, field=f"{field}.model", expected=f"one of {', '.join(error.known)}", got=repr(model)
        ) from error
    except (TypeError, ValueError) as error:
        raise DataError(file, field=field, expected="numbers", got=str(error)) from error

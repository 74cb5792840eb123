"""The input of a method with injected errors; the reference keeps the true calibration and ego-motion."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.model import CameraModel
from bench.egomotion.trajectory import camera_motion
from bench.errors import UnknownNameError, UsageError
from bench.geometry import RigidTransform, RoadPlane, advance_twist, twist_between
from bench.records.recording import NO_INPUT_ERRORS, ImageRef, InputErrors, MountedCamera


def named_input_errors(errors: Mapping[str, object]) -> InputErrors:
    """Errors of a method's input by the names of their fields.

    Raises:
        UnknownNameError: no such error.
        UsageError: not a finite number, or noise below 0.
    """
    known = asdict(NO_INPUT_ERRORS)
    for name, error in errors.items():
        if name not in known:
            raise UnknownNameError("input error", name, known)
        if isinstance(error, bool) or not isinstance(error, int | float) or not math.isfinite(error):
            raise UsageError(f"input error {name}: expected a number, got {error!r}")
        if name == "image_noise_grey" and error < 0:
            raise UsageError(f"input error {name}: expected a number of at least 0, got {error!r}")
    return replace(NO_INPUT_ERRORS, **{name: float(error) for name, error in errors.items()})  # type: ignore[arg-type]


def perturbed_camera(camera: MountedCamera, errors: InputErrors) -> MountedCamera:
    """The camera as a method receives it: lens, mounting, and the road below.

    Its field and the body of the ego vehicle stay: they define the evaluated region.
    """
    if not _reach_calibration_or_motion(errors):
        return camera
    vehicle_from_camera = camera.vehicle_from_camera @ _pitched(-errors.pitch_deg)
    perturbed_from_true = vehicle_from_camera.inverse() @ camera.vehicle_from_camera
    return replace(
        camera,
        model=_perturbed_lens(camera.model, errors),
        vehicle_from_camera=vehicle_from_camera,
        road=RoadPlane(perturbed_from_true.rotate(camera.road.down), camera.road.height_m),
    )


def perturbed_time_ns(timestamp_ns: int, errors: InputErrors) -> int:
    """Time of the pose that a method receives for an image of a time."""
    return timestamp_ns + round(errors.time_offset_ms * 1e6)


def perturbed_motion(
    world_from_vehicle_previous: RigidTransform,
    world_from_vehicle_current: RigidTransform,
    *,
    seconds: float,
    vehicle_from_camera: RigidTransform,
    errors: InputErrors,
) -> RigidTransform:
    """`current_from_previous` of the camera as a method receives it.

    Args:
        world_from_vehicle_previous: pose at `perturbed_time_ns` of the previous image.
        world_from_vehicle_current: pose at `perturbed_time_ns` of the current image.
        seconds: between the images.
        vehicle_from_camera: mounting with its error, see `perturbed_camera`.
        errors: to inject.
    """
    if not _reach_calibration_or_motion(errors):
        return camera_motion(
            world_from_vehicle_previous=world_from_vehicle_previous,
            world_from_vehicle_current=world_from_vehicle_current,
            vehicle_from_camera=vehicle_from_camera,
        )
    return (
        vehicle_from_camera.inverse()
        @ _vehicle_motion(world_from_vehicle_previous, world_from_vehicle_current, seconds=seconds, errors=errors)
        @ vehicle_from_camera
        @ _pitched(errors.pitch_rate_degps * seconds)
    )


def perturbed_pixels(
    pixels: NDArray[np.uint8], image: ImageRef, *, recording: str, errors: InputErrors
) -> NDArray[np.uint8]:
    """An image as a method receives it: with normal noise, rounded and cut to 0 ... 255.

    Args:
        pixels: (H, W) or (H, W, 3) uint8.
        image: which; its camera and time, with the name of the recording, are the seed.
        recording: name.
        errors: to inject.
    """
    if errors.image_noise_grey == 0:
        return pixels
    seed = zlib.crc32(f"{recording} {image.camera}".encode()), image.timestamp_ns
    noise = np.random.default_rng(seed).standard_normal(pixels.shape, dtype=np.float32)
    return np.clip(np.rint(pixels + errors.image_noise_grey * noise), 0, 255).astype(np.uint8)


def _reach_calibration_or_motion(errors: InputErrors) -> bool:
    return replace(errors, image_noise_grey=0.0) != NO_INPUT_ERRORS


def _pitched(pitch_deg: float) -> RigidTransform:
    """A rotation about the camera's x axis."""
    return RigidTransform(Rotation.from_rotvec([math.radians(pitch_deg), 0.0, 0.0]).as_matrix(), np.zeros(3))


def _vehicle_motion(
    previous: RigidTransform, current: RigidTransform, *, seconds: float, errors: InputErrors
) -> RigidTransform:
    """`current_from_previous` of the vehicle with a biased yaw rate and a scaled path."""
    turns_rad, paths_m = twist_between(*_row(previous), *_row(current))
    bias_rad = np.array([0.0, 0.0, math.radians(errors.yaw_rate_bias_degps) * seconds])
    scale = 1.0 + errors.speed_scale_percent / 100.0
    rotations, advances_m = advance_twist(turns_rad + bias_rad, scale * paths_m, np.ones(1))
    return RigidTransform(rotations[0].as_matrix(), advances_m[0]).inverse()


def _row(world_from_vehicle: RigidTransform) -> tuple[Rotation, NDArray[np.float64]]:
    return Rotation.from_matrix(world_from_vehicle.rotation[None]), world_from_vehicle.translation_m[None]


def _perturbed_lens(lens: CameraModel, errors: InputErrors) -> CameraModel:
    """The lens with a shifted principal point and a scaled focal length, at the same image size."""
    u, v = lens.principal_point
    centre = u + errors.principal_point_u_px, v + errors.principal_point_v_px
    return replace(lens.zoomed(1.0 + errors.focal_scale_percent / 100.0), principal_point=centre)

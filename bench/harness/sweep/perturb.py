"""Errors that are injected into what a method is told; the reference keeps the true calibration and ego-motion."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras import CameraModel
from bench.egomotion import Trajectory
from bench.geometry import RigidTransform, RoadPlane, advance_twist, twist_between
from bench.methods import MethodInput
from bench.recordings import MountedCamera

SIZE_FACTOR = 1000  # a focal scale is applied as a change of image size, which must be whole: this is its fineness


@dataclass(frozen=True, slots=True, kw_only=True)
class Injection:
    """Errors of the method's input, all 0 by default; believed minus true.

    Attributes:
        yaw_rate_bias_degps: added to the yaw rate, deg/s, positive to the left; about the vehicle's origin, as
            odometry integrates it, also while the host stands.
        speed_scale_percent: of the vehicle's path between two images.
        pitch_deg: of the camera's mounting, positive down, about the camera itself.
        pitch_rate_degps: turn of the camera about its own transverse axis between two images that the ego-motion does
            not know of, deg/s; the road below the current image stays right.
        principal_point_u_px: shift to the right.
        principal_point_v_px: shift down.
        focal_scale_percent: of the focal length in both directions.
        time_offset_ms: the ego-motion is read this much later than the images were exposed.
        image_noise_grey: standard deviation of normal noise of the images, grey levels; the same noise for the same
            image in every run, only its strength differs.
    """

    yaw_rate_bias_degps: float = 0.0
    speed_scale_percent: float = 0.0
    pitch_deg: float = 0.0
    pitch_rate_degps: float = 0.0
    principal_point_u_px: float = 0.0
    principal_point_v_px: float = 0.0
    focal_scale_percent: float = 0.0
    time_offset_ms: float = 0.0
    image_noise_grey: float = 0.0


NONE = Injection()


def believed(
    given: MethodInput, *, mounted: MountedCamera, trajectory: Trajectory, injection: Injection
) -> MethodInput:
    """What the method is told in place of the truth; its images stay, see `with_noise`.

    V, the pixels that count, stays true as well: it says where is scored.

    Raises:
        DataError: no ego-motion at the shifted times.
    """
    if replace(injection, image_noise_grey=0.0) == NONE:
        return given
    vehicle_from_camera = mounted.vehicle_from_camera @ _turn(-injection.pitch_deg)
    camera_from_true = vehicle_from_camera.inverse() @ mounted.vehicle_from_camera
    offset_ns = round(injection.time_offset_ms * 1e6)
    poses = [trajectory.world_from_vehicle(time_ns + offset_ns) for time_ns in given.timestamps_ns]
    seconds = np.diff(given.timestamps_ns) / 1e9
    motions = tuple(
        vehicle_from_camera.inverse()
        @ _vehicle_motion(previous, current, seconds=float(step), injection=injection)
        @ vehicle_from_camera
        @ _turn(injection.pitch_rate_degps * float(step))
        for (previous, current), step in zip(pairwise(poses), seconds, strict=True)
    )
    return replace(
        given,
        camera=_believed_lens(given.camera, injection),
        road=RoadPlane(camera_from_true.rotate(given.road.down), given.road.height_m),
        current_from_previous=motions,
    )


def with_noise(given: MethodInput, *, name: str, strength_grey: float) -> MethodInput:
    """The images with normal noise, rounded and cut to 0 ... 255.

    Args:
        given: true images.
        name: of recording and camera; with the time of the image it seeds the noise.
        strength_grey: standard deviation, grey levels.
    """
    if strength_grey == 0:
        return given
    images = tuple(
        _noisy(image, seed=(zlib.crc32(name.encode()), time_ns), strength_grey=strength_grey)
        for image, time_ns in zip(given.images, given.timestamps_ns, strict=True)
    )
    return replace(given, images=images)


def _noisy(image: NDArray[np.uint8], *, seed: tuple[int, int], strength_grey: float) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(image + strength_grey * noise), 0, 255).astype(np.uint8)


def _turn(pitch_deg: float) -> RigidTransform:
    """A turn about the camera's x axis."""
    return RigidTransform(Rotation.from_rotvec([math.radians(pitch_deg), 0.0, 0.0]).as_matrix(), np.zeros(3))


def _vehicle_motion(
    previous: RigidTransform, current: RigidTransform, *, seconds: float, injection: Injection
) -> RigidTransform:
    """`current_from_previous` of the vehicle with a biased yaw rate and a scaled path."""
    turns_rad, paths_m = twist_between(*_row(previous), *_row(current))
    bias_rad = np.array([0.0, 0.0, math.radians(injection.yaw_rate_bias_degps) * seconds])
    scale = 1.0 + injection.speed_scale_percent / 100.0
    rotations, advances_m = advance_twist(turns_rad + bias_rad, scale * paths_m, np.ones(1))
    return RigidTransform(rotations[0].as_matrix(), advances_m[0]).inverse()


def _row(world_from_vehicle: RigidTransform) -> tuple[Rotation, NDArray[np.float64]]:
    return Rotation.from_matrix(world_from_vehicle.rotation[None]), world_from_vehicle.translation_m[None]


@lru_cache(maxsize=64)
def _believed_lens(lens: CameraModel, injection: Injection) -> CameraModel:
    """The lens with a shifted principal point and a scaled focal length, at the same image size."""
    u, v = lens.principal_point
    centre = u + injection.principal_point_u_px, v + injection.principal_point_v_px
    if injection.focal_scale_percent == 0:
        return replace(lens, principal_point=centre)
    # A lens seen in a larger image has a longer focal length; the image is then cut to its size again.
    width, height, scale = lens.width, lens.height, 1.0 + injection.focal_scale_percent / 100.0
    large = replace(lens, width=SIZE_FACTOR * width, height=SIZE_FACTOR * height)
    zoomed = large.scaled(round(large.width * scale), round(large.height * scale))
    return replace(zoomed, width=width, height=height, principal_point=centre)

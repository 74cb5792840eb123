"""Inputs of the network: images and what geometry knows of them without learning, as channels of bytes of two sizes.

What geometry and flow tell is computed about 320 px across; the image itself, and what is left of it where the rigid
scene is taken out, also at twice that size, since a person some metres away is ten pixels wide. Rays, road and motion
enter through the camera model, so the network itself holds no lens. A byte of 128 stands for 0; bytes make what was
prepared for training small, and the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel
from bench.flow import cell_mean
from bench.methods.contract import MethodInput, UnansweredImage
from bench.methods.rigid_scene.deviation import LEAST_NOISE, noise_of
from bench.methods.rigid_scene.evidence import Evidence
from bench.methods.rigid_scene.method import RigidSceneMethod
from bench.methods.rigid_scene.scene import OUTSIDE_PX, RigidScene, at_every_pixel, sampled
from bench.methods.rigid_scene.views import Views
from bench.methods.spherical.likelihood import CONSTRAINTS, PAPER_ANGLE_RAD
from bench.methods.spherical.method import SphericalMethod

Image = NDArray[np.float32]
Bytes = NDArray[np.uint8]

ZERO = 128  # the byte of 0
PARALLAX_M = 4.0  # distance of the points whose parallax is told
CELL_PX = 2  # on which the paper's deviations are measured
RIGID_SCENE = RigidSceneMethod()  # whose evidence the network is shown

# Channels by what they come from: training can leave a group out, which tells what it is worth.
GROUPS: dict[str, tuple[str, ...]] = {
    "rays": ("valid", "angle", "fall"),
    "parallax": ("road_parallax", "parallax_u", "parallax_v"),
    "images": ("current", "rotated_difference", "road_difference"),
    "flow": ("flow_u", "flow_v", "flow_difference"),
    "constraints": CONSTRAINTS,
    "scene": ("sigmas", "misfit", "texture", "road_seen"),
    "fine": ("fine_current", "fine_rotated", "fine_road", "fine_flow"),
}
FINE = GROUPS["fine"]
COARSE = tuple(name for names in GROUPS.values() for name in names if name not in FINE)
MIRRORED = ("parallax_u", "flow_u")  # that change their sign when the image is mirrored left to right

# Byte steps per unit of each quantity.
GREY_STEPS = 32.0  # per standard deviation of the image
NOISE_STEPS = 12.0  # per standard deviation of the noise
FLOW_STEPS = 36.0  # per unit of asinh(2 px), 1 for 0.6 px
RAY_STEPS = 70.0  # per radian, and per unit of a cosine
DEVIATION_STEPS = 22.0  # per unit of log(1 + deviation / the paper's angle), of log(1 + sigmas) and of log(1 + texture)
MISFIT_STEPS = 24.0  # per unit of asinh(misfit)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channels:
    """Input of the network: an image of bytes of each name.

    Attributes:
        coarse: (C, h, w) uint8.
        fine: (F, H, W) uint8; H and W are twice h and w, or one more.
    """

    coarse: Bytes
    fine: Bytes


def network_input(views: Views, coarse: Sequence[str] = COARSE, fine: Sequence[str] = FINE) -> Channels:
    """Channels of the last two images.

    Args:
        views: the images.
        coarse: names of `COARSE`, in the order of the answer.
        fine: names of `FINE`.

    Raises:
        UnansweredImage: there is no ego-motion, without which there is no geometry.
    """
    given = views.given
    if not given.current_from_previous:
        raise UnansweredImage("learned: expected the ego-motion between the images, got none")
    last = RIGID_SCENE.evidence(given)
    far = _flow_of(last.scene, 0.0)
    small = (
        _ray_channels(last, given.valid, far)
        | _image_channels(given, last, far)
        | _constraint_channels(given, last)
        | _scene_channels(last)
    )
    large = _fine_channels(views, last, far)
    return Channels(
        coarse=np.stack([small[name] for name in coarse]),
        fine=np.stack([large[name] for name in fine]) if fine else np.empty((0, *views.fine[-1].shape), np.uint8),
    )


def _ray_channels(last: Evidence, valid: NDArray[np.bool_], far: Image) -> dict[str, Bytes]:
    """Directions of rays, and motion of the road and of near points."""
    scene, road = last.scene, _without_jumps(last.road - far)
    parallax = _without_jumps(_flow_of(scene, 1 / PARALLAX_M) - far)
    angle = np.nan_to_num(np.arccos(np.clip(scene.grid.rays_camera[..., 2], -1, 1))).astype(np.float32)
    return {
        "valid": _as_bytes(valid.astype(np.float32), GREY_STEPS),
        "angle": _as_bytes(at_every_pixel(angle, scene.camera), RAY_STEPS),
        "fall": _as_bytes(last.fall, RAY_STEPS),
        "road_parallax": _flow_bytes(np.hypot(road[..., 0], road[..., 1])),
        "parallax_u": _flow_bytes(parallax[..., 0]),
        "parallax_v": _flow_bytes(parallax[..., 1]),
    }


def _image_channels(given: MethodInput, last: Evidence, far: Image) -> dict[str, Bytes]:
    """The image, what is left of its difference to the last one, and flow beyond the road's."""
    found = _differences(given.images[-2:], given.valid, last, given.camera, far)
    rest = np.where(last.edge[..., None], np.float32(0), last.flow - last.road)
    return {
        "current": _grey(given.images[-1], given.valid),
        "rotated_difference": found["rotated"],
        "road_difference": found["road"],
        "flow_difference": found["flow"],
        "flow_u": _flow_bytes(rest[..., 0]),
        "flow_v": _flow_bytes(rest[..., 1]),
    }


def _constraint_channels(given: MethodInput, last: Evidence) -> dict[str, Bytes]:
    """The paper's deviations; a stationary camera's stands for the epipolar one."""
    method, scene = SphericalMethod(cell_size_px=CELL_PX), last.scene
    corrected = replace(
        given,
        images=given.images[-2:],
        timestamps_ns=given.timestamps_ns[-2:],
        current_from_previous=(scene.current_from_previous,),
        road=scene.road,
    )
    found = method.likelihood_map(corrected, cell_mean(last.flow, CELL_PX))
    none = np.zeros(found.likelihood.shape)
    measured = {CONSTRAINTS[0]: found.likelihood} if found.stationary else found.deviations
    channels, (height, width) = {}, given.valid.shape
    for name in CONSTRAINTS:
        on_cells = np.log1p(np.where(found.seen, measured.get(name, none), 0.0) / PAPER_ANGLE_RAD).astype(np.float32)
        spread = on_cells.repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)[:height, :width]
        channels[name] = _as_bytes(np.where(last.edge, 0, spread), DEVIATION_STEPS)
    return channels


def _scene_channels(last: Evidence) -> dict[str, Bytes]:
    """Distance from all rigid scenes, and what it rests on: texture carries a flow, a shadow moves over the road's."""
    uu, uv, vv = last.tensor
    smaller = np.maximum((uu + vv) / 2 - np.hypot((uu - vv) / 2, uv), 0) / last.noise**2
    return {
        "sigmas": _as_bytes(np.log1p(last.sigmas), DEVIATION_STEPS),
        "misfit": _as_bytes(np.arcsinh(last.misfit), MISFIT_STEPS),
        "texture": _as_bytes(np.log1p(smaller), DEVIATION_STEPS),
        "road_seen": _as_bytes(last.road_seen.astype(np.float32), GREY_STEPS),
    }


def _fine_channels(views: Views, last: Evidence, far: Image) -> dict[str, Bytes]:
    """The image and its differences, at the size of the answer."""
    current = views.fine[-1]
    height, width = current.shape
    camera = views.given.camera.scaled(width, height)
    valid = cv2.resize(views.given.valid.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    found = _differences(views.fine[-2:], valid, last, camera, far)
    return {
        "fine_current": _grey(current, valid),
        "fine_rotated": found["rotated"],
        "fine_road": found["road"],
        "fine_flow": found["flow"],
    }


def _differences(
    images: Sequence[Bytes], valid: NDArray[np.bool_], evidence: Evidence, camera: CameraModel, far: Image
) -> dict[str, Bytes]:
    """Differences of an image to the one before it, moved in three ways, in units of the noise of that of the road.

    Args:
        images: both, (H, W) uint8.
        valid: (H, W) bool.
        evidence: of both images, of this size or a smaller one.
        camera: the lens at this size.
        far: motion of what is infinitely far, at the size of the evidence.

    Returns:
        By what moves the image before: "road", "rotated" for the rotation alone, "flow".
    """
    before, now = (image.astype(np.float32) for image in images)
    outside, left, noise = (~valid).astype(np.float32), {}, 1.0
    for name, move in {"road": evidence.road, "rotated": far, "flow": evidence.flow}.items():
        flow = _at_size(move, camera)
        difference = now - sampled(before, flow)
        seen = (sampled(outside, flow, outside=1.0) < 0.01) & valid
        if name == "road":
            noise = noise_of(difference, seen, least=LEAST_NOISE)
        left[name] = _as_bytes(np.where(seen, difference, np.float32(0)) / noise, NOISE_STEPS)
    return left


def _flow_of(scene: RigidScene, inverse_depth: NDArray[np.floating] | float) -> Image:
    """Motion of static points, (h, w, 2) px; far outside of the image where the lens has no ray."""
    return at_every_pixel(np.nan_to_num(scene.flow_at(inverse_depth), nan=OUTSIDE_PX), scene.camera)


def _at_size(flow: Image, camera: CameraModel) -> Image:
    """A flow at the size of a lens's images, in its pixels."""
    height, width = flow.shape[:2]
    if (width, height) == (camera.width, camera.height):
        return flow
    scaled = flow * np.array((camera.width / width, camera.height / height), np.float32)
    return np.asarray(cv2.resize(scaled, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR))


def _grey(image: Bytes, valid: NDArray[np.bool_]) -> Bytes:
    """Roots of grey values, in which shot noise is the same everywhere, by their own mean and deviation."""
    roots = np.sqrt(image.astype(np.float32))
    seen = roots[valid]
    mean, deviation = (float(seen.mean()), max(float(seen.std()), 0.3)) if len(seen) else (0.0, 1.0)
    return _as_bytes((roots - mean) / deviation, GREY_STEPS)


def _without_jumps(flow: Image) -> Image:
    """0 where one of the ends lies outside of the lens's field."""
    return np.where(np.abs(flow) < -OUTSIDE_PX / 4, flow, np.float32(0))


def _flow_bytes(values: NDArray[np.floating]) -> Bytes:
    return _as_bytes(np.arcsinh(2 * values), FLOW_STEPS)


def _as_bytes(values: NDArray[np.floating], steps: float) -> Bytes:
    return np.asarray(np.clip(np.rint(values * steps + ZERO), 0, 255), dtype=np.uint8)

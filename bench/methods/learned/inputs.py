"""Inputs of the network: two images and what geometry knows of them without learning, as channels of bytes.

Everything is computed at a working size of about 320 px across, whatever the image's size and lens: rays, road and
motion enter through the camera model, so the network itself holds no lens. A byte of 128 stands for 0; bytes make what
was prepared for training small, and the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.flow import DisFlow, cell_mean
from bench.methods.contract import MethodInput, UnansweredImage
from bench.methods.rigid_scene.deviation import LEAST_NOISE, noise_of
from bench.methods.rigid_scene.first_guess import guided_flow, warp
from bench.methods.rigid_scene.motion import MotionAccuracy, correspondences, refine_motion
from bench.methods.rigid_scene.scene import OUTSIDE_PX, RigidScene, at_every_pixel, sampled
from bench.methods.spherical.likelihood import CONSTRAINTS, PAPER_ANGLE_RAD
from bench.methods.spherical.method import SphericalMethod

Image = NDArray[np.float32]
Bytes = NDArray[np.uint8]
InputSet = Literal["images", "geometry", "likelihood"]
INPUT_SETS: tuple[InputSet, ...] = get_args(InputSet)

WORKING_PX = 320  # width about which everything is computed
ZERO = 128  # the byte of 0
PARALLAX_M = 4.0  # distance of the points whose parallax is told
FLOW = DisFlow(preset="fast", finest_scale=0)  # matched up to the working size itself
FLOW_CELL_PX = 2  # on which deviations are measured, at the working size

_VALID = ("valid",)
_GEOMETRY = (
    "current", "rotated", "on_road", "rotated_difference", "road_difference", "angle", "fall", "road_parallax",
    "parallax_u", "parallax_v",
)  # fmt: skip
_LIKELIHOOD = ("flow_u", "flow_v", "flow_difference", *CONSTRAINTS)
CHANNELS: dict[InputSet, tuple[str, ...]] = {
    "images": ("current", "previous", "difference", *_VALID),
    "geometry": (*_GEOMETRY, *_VALID),
    "likelihood": (*_GEOMETRY, *_LIKELIHOOD, *_VALID),
}
ALL_CHANNELS = tuple(dict.fromkeys(name for names in CHANNELS.values() for name in names))
MIRRORED = ("parallax_u", "flow_u")  # that change their sign when the image is mirrored left to right

# Byte steps per unit of each quantity.
GREY_STEPS = 32.0  # per standard deviation of the image
NOISE_STEPS = 12.0  # per standard deviation of the noise
FLOW_STEPS = 36.0  # per unit of asinh(2 px), 1 for 0.6 px
RAY_STEPS = 70.0  # per radian, and per unit of a cosine
DEVIATION_STEPS = 22.0  # per unit of log(1 + deviation / the paper's angle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkingPair:
    """The last two images at the working size.

    Attributes:
        current: (h, w) uint8, grey.
        previous: (h, w) uint8, grey.
        valid: (h, w) bool.
        given: all that the method is given, at the working size.
        cell_size_px: pixels of the given images for one of the working size.
    """

    current: Bytes
    previous: Bytes
    valid: NDArray[np.bool_]
    given: MethodInput
    cell_size_px: int


def working_pair(frame: MethodInput) -> WorkingPair:
    """The last two images at the working size, with the lens scaled alike."""
    height, width = frame.valid.shape
    cell = cell_size_px(width)
    size = -(-width // cell), -(-height // cell)
    previous, current = (at_working_size(image, size) for image in frame.images[-2:])
    valid = at_working_size(frame.valid.astype(np.uint8) * 255, size) > 250
    given = replace(
        frame,
        images=(previous, current),
        timestamps_ns=frame.timestamps_ns[-2:],
        current_from_previous=frame.current_from_previous[-1:],
        camera=frame.camera.scaled(*size),
        valid=valid,
    )
    return WorkingPair(current=current, previous=previous, valid=valid, given=given, cell_size_px=cell)


def cell_size_px(width: int) -> int:
    """Side of the cells that the network answers on, for images of a width."""
    return max(round(width / WORKING_PX), 1)


def at_working_size(image: Bytes, size: tuple[int, int]) -> Bytes:
    """An image at a smaller size (width, height), each pixel the mean of those that it stands for."""
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def network_input(pair: WorkingPair, names: Sequence[str]) -> Bytes:
    """Channels of a pair of images.

    Args:
        pair: from `working_pair`.
        names: of `ALL_CHANNELS`; only what they need is computed.

    Returns:
        (C, h, w) uint8, in the order of the names.

    Raises:
        UnansweredImage: there is no ego-motion, without which there is no geometry.
    """
    channels = _image_channels(pair)
    if set(names) - channels.keys():
        if not pair.given.current_from_previous:
            raise UnansweredImage("learned: expected the ego-motion between the images, got none")
        channels |= _geometry_channels(pair)
    if set(names) - channels.keys():
        channels |= _likelihood_channels(pair)
    return np.stack([channels[name] for name in names])


def _image_channels(pair: WorkingPair) -> dict[str, Bytes]:
    grey = _standardised(pair)
    difference = pair.current.astype(np.float32) - pair.previous
    noise = noise_of(difference, pair.valid, least=LEAST_NOISE)
    return {
        "current": _as_bytes(grey(pair.current), GREY_STEPS),
        "previous": _as_bytes(grey(pair.previous), GREY_STEPS),
        "difference": _as_bytes(difference / noise, NOISE_STEPS),
        "valid": _as_bytes(pair.valid.astype(np.float32), GREY_STEPS),
    }


def _geometry_channels(pair: WorkingPair) -> dict[str, Bytes]:
    """Compensated images, their differences, and where rays point; all by the recorded motion."""
    scene = RigidScene.of(pair.given)
    grey, now = _standardised(pair), pair.current.astype(np.float32)
    far, near = (np.nan_to_num(scene.flow_at(rho), nan=OUTSIDE_PX) for rho in (0.0, 1 / PARALLAX_M))
    rotation = at_every_pixel(far, scene.camera)
    _, on_road, hidden = warp(pair.current, pair.previous, valid=pair.valid, scene=scene)
    noise = noise_of(now - on_road, ~hidden, least=LEAST_NOISE)
    unseen = (sampled((~pair.valid).astype(np.float32), rotation, outside=1.0) > 0.01) | ~pair.valid
    rotated = np.rint(sampled(pair.previous.astype(np.float32), rotation)).astype(np.uint8)
    rotated[unseen] = pair.current[unseen]
    parallax = _without_jumps(at_every_pixel(near - far, scene.camera))
    road = np.nan_to_num(scene.flow_at(scene.road_inverse_depth(scene.fall())), nan=OUTSIDE_PX)
    road_parallax = _without_jumps(at_every_pixel(road - far, scene.camera))
    angle = np.nan_to_num(np.arccos(np.clip(scene.grid.rays_camera[..., 2], -1, 1))).astype(np.float32)
    return {
        "rotated": _as_bytes(grey(rotated), GREY_STEPS),
        "on_road": _as_bytes(grey(on_road), GREY_STEPS),
        "rotated_difference": _as_bytes((now - rotated) / noise, NOISE_STEPS),
        "road_difference": _as_bytes((now - on_road) / noise, NOISE_STEPS),
        "angle": _as_bytes(at_every_pixel(angle, scene.camera), RAY_STEPS),
        "fall": _as_bytes(at_every_pixel(scene.fall().astype(np.float32), scene.camera), RAY_STEPS),
        "road_parallax": _flow_bytes(np.hypot(road_parallax[..., 0], road_parallax[..., 1])),
        "parallax_u": _flow_bytes(parallax[..., 0]),
        "parallax_v": _flow_bytes(parallax[..., 1]),
    }


def _likelihood_channels(pair: WorkingPair) -> dict[str, Bytes]:
    """Flow beyond the rigid scene's first guess, and the paper's deviations by the motion that the flow corrects."""
    given, scene = pair.given, RigidScene.of(pair.given)
    found = guided_flow(pair.current, pair.previous, valid=pair.valid, scene=scene, flow=FLOW)
    seconds = (given.timestamps_ns[-1] - given.timestamps_ns[-2]) / 1e9
    seen = correspondences(found, pair.current, scene.camera)
    refined = refine_motion(scene, seen, seconds=seconds, accuracy=MotionAccuracy())
    guess, on_road, neutral = warp(pair.current, pair.previous, valid=pair.valid, scene=refined)
    neutral |= found.neutral
    rest = found.flow - guess
    rest[neutral] = 0
    left = pair.current - sampled(pair.previous.astype(np.float32), found.flow)
    left[neutral] = 0
    noise = noise_of(pair.current.astype(np.float32) - on_road, ~neutral, least=LEAST_NOISE)
    deviations = _deviations(pair, found.flow, refined)
    height, width = pair.valid.shape
    channels = {
        "flow_u": _flow_bytes(rest[..., 0]),
        "flow_v": _flow_bytes(rest[..., 1]),
        "flow_difference": _as_bytes(left / noise, NOISE_STEPS),
    }
    for name in CONSTRAINTS:
        on_cells = np.log1p(deviations[name] / PAPER_ANGLE_RAD).astype(np.float32)
        spread = on_cells.repeat(FLOW_CELL_PX, axis=0).repeat(FLOW_CELL_PX, axis=1)[:height, :width]
        channels[name] = _as_bytes(np.where(neutral, 0, spread), DEVIATION_STEPS)
    return channels


def _deviations(pair: WorkingPair, flow: Image, scene: RigidScene) -> dict[str, NDArray[np.float64]]:
    """The paper's deviations on cells; a stationary camera's stands for the epipolar one."""
    method = SphericalMethod(cell_size_px=FLOW_CELL_PX)
    given = replace(pair.given, current_from_previous=(scene.current_from_previous,), road=scene.road)
    found = method.likelihood_map(given, cell_mean(flow, FLOW_CELL_PX))
    none = np.zeros(found.likelihood.shape)
    measured = {CONSTRAINTS[0]: found.likelihood} if found.stationary else found.deviations
    return {name: np.where(found.seen, measured.get(name, none), 0.0) for name in CONSTRAINTS}


def _standardised(pair: WorkingPair) -> Callable[[Bytes], Image]:
    """Roots of grey values, in which shot noise is the same everywhere, by the current image's mean and deviation."""
    roots = np.sqrt(pair.current[pair.valid].astype(np.float32))
    mean, deviation = (float(roots.mean()), max(float(roots.std()), 0.3)) if len(roots) else (0.0, 1.0)
    return lambda image: np.asarray((np.sqrt(image.astype(np.float32)) - mean) / deviation)


def _without_jumps(flow: Image) -> Image:
    """0 where one of the ends lies outside of the lens's field."""
    return np.where(np.abs(flow) < -OUTSIDE_PX / 4, flow, np.float32(0))


def _flow_bytes(values: Image) -> Bytes:
    return _as_bytes(np.arcsinh(2 * values), FLOW_STEPS)


def _as_bytes(values: Image, steps: float) -> Bytes:
    return np.asarray(np.clip(np.rint(values * steps + ZERO), 0, 255), dtype=np.uint8)

"""Inputs of the network: images and what geometry knows of them without learning, as channels of bytes of two sizes.

What geometry and flow tell is computed about 320 px across; the image itself, and what is left of it where the rigid
scene is taken out, also at twice that size, since a person some metres away is ten pixels wide. Rays, road and motion
enter through the camera model, so the network itself holds no lens. A byte of 128 stands for 0; bytes make what was
prepared for training small, and the same on every machine.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.flow.dense import cell_mean
from bench.methods.contract import MethodInput
from bench.methods.rigid_scene.evidence import LEAST_NOISE, Evidence, noise_of
from bench.methods.rigid_scene.method import RigidSceneMethod
from bench.methods.rigid_scene.scene import OUTSIDE_PX, RigidScene, Views, at_every_pixel, sampled, spread
from bench.methods.spherical.likelihood import CONSTRAINTS, PAPER_ANGLE_RAD
from bench.methods.spherical.method import SphericalMethod

Image = NDArray[np.float32]
Bytes = NDArray[np.uint8]

ZERO = 128  # the byte of 0
BACK = 3  # images from the current one to the earlier one, fewer at the start of a drive
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
    "depth": ("inverse_depth", "from_road"),
    "earlier": (
        "earlier_road_difference",
        "earlier_static_difference",
        "fine_earlier_road_difference",
        "fine_earlier_static_difference",
    ),
    "fine": ("fine_current", "fine_rotated_difference", "fine_road_difference", "fine_flow_difference"),
}
_ALL = [name for names in GROUPS.values() for name in names]
FINE = tuple(name for name in _ALL if name.startswith("fine_"))
COARSE = tuple(name for name in _ALL if name not in FINE)
DIFFERENCES = tuple(name for name in _ALL if name.endswith("_difference"))
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
    """Channels of the last images.

    Args:
        views: the images.
        coarse: names of `COARSE`, in the order of the answer.
        fine: names of `FINE`.
    """
    given = views.given
    last = RIGID_SCENE.evidence(given)
    far = last.scene.dense_flow_at(0.0)
    nothing: dict[str, Bytes] = dict.fromkeys(GROUPS["earlier"], np.array(ZERO, np.uint8))  # at the start of a drive
    small = (
        nothing
        | _ray_channels(last, given.valid, far)
        | {"current": _grey(given.images[-1], given.valid)}
        | _flow_channels(last)
        | _constraint_channels(given, last)
        | _scene_channels(last)
    )
    large = nothing | {"fine_current": _grey(views.fine[-1], _at_size(given.valid, views.fine[-1].shape))}
    flows = {1: {"road": last.road, "rotated": far, "flow": last.flow}}  # by how many images they go back
    if (back := min(BACK, len(given.images) - 1)) > 1:
        flows[back] = _earlier_flows(given, last, back)
    for images, channels, prefix in ((given.images, small, ""), (views.fine, large, "fine_")):
        for steps, moves in flows.items():
            left = _differences(images[-1], images[-1 - steps], given.valid, moves)
            channels |= {f"{prefix}{name}_difference": difference for name, difference in left.items()}
    return Channels(coarse=_stacked(small, coarse, given.images[-1]), fine=_stacked(large, fine, views.fine[-1]))


def _stacked(channels: Mapping[str, Bytes], names: Sequence[str], image: Bytes) -> Bytes:
    """Channels of these names, (N, H, W), of an image's size."""
    stacked = np.empty((len(names), *image.shape), dtype=np.uint8)
    for row, name in zip(stacked, names, strict=True):
        row[:] = channels[name]
    return stacked


def _ray_channels(last: Evidence, valid: NDArray[np.bool_], far: Image) -> dict[str, Bytes]:
    """Directions of rays, and motion of the road and of near points."""
    scene, road = last.scene, _without_jumps(last.road - far)
    parallax = _without_jumps(scene.dense_flow_at(1 / PARALLAX_M) - far)
    angle = np.nan_to_num(np.arccos(np.clip(scene.grid.rays_camera[..., 2], -1, 1))).astype(np.float32)
    return {
        "valid": _as_bytes(valid.astype(np.float32), GREY_STEPS),
        "angle": _as_bytes(at_every_pixel(angle, scene.camera), RAY_STEPS),
        "fall": _as_bytes(last.fall, RAY_STEPS),
        "road_parallax": _flow_bytes(np.hypot(road[..., 0], road[..., 1])),
        "parallax_u": _flow_bytes(parallax[..., 0]),
        "parallax_v": _flow_bytes(parallax[..., 1]),
    }


def _flow_channels(last: Evidence) -> dict[str, Bytes]:
    """Flow beyond the road's."""
    rest = np.where(last.edge[..., None], np.float32(0), last.flow - last.road)
    return {"flow_u": _flow_bytes(rest[..., 0]), "flow_v": _flow_bytes(rest[..., 1])}


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
    likelihoods = method.likelihood_map(corrected, cell_mean(last.flow, CELL_PX))
    none = np.zeros(likelihoods.likelihood.shape)
    measured = {CONSTRAINTS[0]: likelihoods.likelihood} if likelihoods.stationary else likelihoods.deviations
    channels, (height, width) = {}, given.valid.shape
    for name in CONSTRAINTS:
        on_cells = np.log1p(np.where(likelihoods.seen, measured.get(name, none), 0.0) / PAPER_ANGLE_RAD).astype(
            np.float32
        )
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
        "inverse_depth": _as_bytes(np.arcsinh(8 * _doubled(last.inverse_depth, last.road)), FLOW_STEPS),
        "from_road": _as_bytes(np.log1p(_doubled(last.from_road_sigmas, last.road)), DEVIATION_STEPS),
    }


def _doubled(values: Image, like: Image) -> Image:
    """(h/2, w/2) -> (h, w), the size of another image."""
    rows, columns = like.shape[:2]
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_NEAREST), np.float32)


def _earlier_flows(given: MethodInput, last: Evidence, back: int) -> dict[str, Image]:
    """Motion since an earlier image of the road, and of static points where the last image's flow puts them."""
    scene = RigidScene.of(given, back=back, known=last.scene)
    rows, columns = scene.grid.valid.shape
    static = np.asarray(cv2.resize(last.inverse_depth, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
    return {
        "earlier_road": scene.road_flow(),
        "earlier_static": scene.dense_flow_at(static),
    }


def _differences(now: Bytes, before: Bytes, valid: NDArray[np.bool_], flows: Mapping[str, Image]) -> dict[str, Bytes]:
    """Differences of an image to one before it, moved in several ways, in units of the noise of the first.

    Args:
        now: (H, W) uint8.
        before: (H, W) uint8.
        valid: (h, w) bool, of this size or a smaller one.
        flows: (h, w, 2) px, at the size of `valid`, by name.
    """
    outside, left, steps = (~valid).astype(np.float32), {}, 0.0
    current, earlier = now.astype(np.float32), before.astype(np.float32)
    for name, flow in flows.items():
        shown = (sampled(outside, flow, outside=1.0) < 0.01) & valid
        seen = _at_size(cv2.erode(shown.astype(np.uint8), np.ones((3, 3))) > 0, now.shape)  # flows jump at the border
        moved = sampled(earlier, _at_size(flow, now.shape))
        steps = steps or NOISE_STEPS / noise_of(current - moved, seen, least=LEAST_NOISE)
        left[name] = np.asarray(cv2.addWeighted(current, steps, moved, -steps, ZERO, dtype=cv2.CV_8U), dtype=np.uint8)
        left[name][~seen] = ZERO
    return left


def _at_size(values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """A mask, or a flow in its pixels, at the size of other images, (H, W)."""
    height, width = values.shape[:2]
    if (height, width) == shape:
        return values
    if values.ndim == 2:
        return spread(values, shape)
    scaled = values * np.array((shape[1] / width, shape[0] / height), np.float32)
    return np.asarray(cv2.resize(scaled, shape[::-1], interpolation=cv2.INTER_LINEAR))


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

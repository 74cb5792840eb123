"""Ego-motion refined on the images: the recorded motion, corrected by what the static world shows.

The bus knows neither pitch nor roll, and half a degree of pitch moves the whole image by more than a pedestrian moves.
Eight corrections are estimated together: rotation, translation, and the tilt of the road, each with the accuracy of the
recorded motion as its prior. Every flow vector tells how far it lies off its epipolar curve; below the horizon it also
tells how far it lies from the road's motion along the curve. What moves, and what does not lie on the road, disagrees
and is left out. Where too little agrees, or the correction is not credible, the recorded motion stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.cameras.model import CameraModel
from bench.errors import UsageError
from bench.geometry import Floats, RigidTransform, RoadPlane, cross, dot, normalise
from bench.methods.rigid_scene.evidence import (
    LEAST_NOISE,
    TENSOR_PX,
    flow_information,
    gradients,
    noise_of,
    structure_tensor,
)
from bench.methods.rigid_scene.scene import GuidedFlow, RigidScene, pixel_positions
from bench.methods.two_views import seen_before

CORRECTIONS = 8  # about and along down, ahead and right; tilt of the road about ahead and right
CUTS_SIGMA = (12.0, 5.0, 3.0)  # of Tukey's weights, round by round
INDEPENDENT = 0.1  # neighbouring vectors share the flow's windows: they count as a tenth as many
LEAST_AGREEING = 0.3
LEAST_VECTORS = 100
CREDIBLE_SIGMA = 4.0  # a larger correction is no correction
EVERY_PX = 8
FLOOR_PX = 0.15  # of the flow's accuracy
ROAD_COSINE = 0.03  # rays that point down by this cosine may meet the road
STILL_M = 0.005
STEP = 1e-4  # of numeric derivatives
FARTHEST, NEAREST = 0.0, 2.0  # inverse depths, 1/m


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionAccuracy:
    """Standard deviations of the recorded motion of a planar odometry, and of the road's plane.

    Attributes:
        yaw_rate_degps: noise and rest of bias of an automotive yaw-rate sensor.
        tilt_rate_degps: pitch and roll, of which a planar odometry knows nothing; a car's body on its springs.
        speed_mps: a wheel tick more or less.
        speed_share: tyre wear and pressure.
        drift_mps: of a camera sideways and up, through the lever arm of pitch, roll and yaw.
        road_tilt_deg: between the camera and the road: pitch while braking, camber, calibration.

    Raises:
        UsageError: a number that is not positive.
    """

    yaw_rate_degps: float = 0.5
    tilt_rate_degps: float = 3.0
    speed_mps: float = 0.05
    speed_share: float = 0.01
    drift_mps: float = 0.1
    road_tilt_deg: float = 0.7

    def __post_init__(self) -> None:
        if min(getattr(self, name) for name in self.__slots__) <= 0:
            raise UsageError(f"accuracy: expected positive numbers, got {self}")

    def of(self, length_m: float, seconds: float) -> Floats:
        """Standard deviation of each correction, (8,), over a time in which the camera moved so far."""
        yaw, tilt = np.deg2rad([self.yaw_rate_degps, self.tilt_rate_degps]) * seconds
        along, drift = self.speed_mps * seconds + self.speed_share * length_m, self.drift_mps * seconds
        road = np.deg2rad(self.road_tilt_deg)
        return np.array([yaw, tilt, tilt, drift, along, drift, road, road])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correspondences:
    """Flow vectors of a pair of images, one row each.

    Attributes:
        rays: (N, 3) float64, unit rays of the current camera.
        pixels: (N, 2) float64, px, where their content was in the previous image.
        information: (N, 2, 2) float64, 1/px^2, inverse covariance of the pixels.
    """

    rays: Floats
    pixels: Floats
    information: Floats


def correspondences(guided: GuidedFlow, current: NDArray[np.uint8], camera: CameraModel) -> Correspondences:
    """Flow vectors with their accuracy, of every eighth pixel that both images show.

    Args:
        guided: dense flow.
        current: (H, W) uint8, grey, the image that it starts from.
        camera: the lens at the image's size.
    """
    every = (slice(EVERY_PX // 2, None, EVERY_PX),) * 2
    now = current.astype(np.float32)
    noise = noise_of(now - guided.warped.astype(np.float32), ~guided.neutral, least=LEAST_NOISE)
    tensor = structure_tensor(*gradients(now), side_px=TENSOR_PX, noise=noise)
    information = flow_information(
        (tensor[0][every], tensor[1][every], tensor[2][every]), noise=noise, floor_px=FLOOR_PX
    )
    positions = pixel_positions(camera.width, camera.height)[every].astype(np.float64)
    ends = positions + guided.flow[every]
    rays, seen = camera.unproject(positions.reshape(-1, 2))
    used = seen & camera.contains(ends.reshape(-1, 2)) & ~guided.neutral[every].reshape(-1)
    entries = [information.uu, information.uv, information.uv, information.vv]
    matrices = np.stack(entries, axis=-1).reshape(-1, 2, 2).astype(np.float64)
    return Correspondences(rays=rays[used], pixels=ends.reshape(-1, 2)[used], information=matrices[used])


def refine_motion(scene: RigidScene, given: Correspondences, *, seconds: float, accuracy: MotionAccuracy) -> RigidScene:
    """Correct the motion and the road of a scene by what most of the image shows.

    Args:
        scene: with the recorded motion.
        given: flow between the two images.
        seconds: between them.
        accuracy: of the recorded motion.

    Returns:
        The corrected scene; the given one where the images do not show a credible correction.
    """
    if len(given.rays) < LEAST_VECTORS:
        return scene
    axes = _axes(scene)
    sigma = accuracy.of(float(np.linalg.norm(scene.current_from_previous.translation_m)), seconds)
    prior = np.diag(1 / sigma**2)
    correction = np.zeros(CORRECTIONS)
    agreeing = 0.0
    for cut in CUTS_SIGMA:
        slopes, offsets, weights = _linearised(scene, axes, correction, given, cut=cut)
        agreeing = float((weights[: len(given.rays)] > 0).mean())
        normal = INDEPENDENT * (slopes * weights[:, None]).T @ slopes + prior
        gradient = INDEPENDENT * (slopes * weights[:, None]).T @ offsets - prior @ correction
        correction = correction + np.linalg.solve(normal, gradient)
    if agreeing < LEAST_AGREEING or np.abs(correction / sigma).max() > CREDIBLE_SIGMA:
        return scene
    return _corrected(scene, axes, correction)


def _linearised(
    scene: RigidScene, axes: Floats, correction: Floats, given: Correspondences, *, cut: float
) -> tuple[Floats, Floats, Floats]:
    """Slopes (2N, 8), offsets (2N,) and robust weights (2N,) across, then along the epipolar curves."""
    start = _corrected(scene, axes, correction)
    on_road = start.road_inverse_depth(dot(given.rays, start.road.down)).astype(np.float64)
    still = np.linalg.norm(scene.current_from_previous.translation_m) < STILL_M
    depth, tangent = (on_road, None) if still else _nearest_depth(start, given, on_road)
    if tangent is None:  # all depths look the same: both directions count everywhere
        tangent = np.broadcast_to([1.0, 0.0], given.pixels.shape)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    steps = np.vstack([np.zeros(CORRECTIONS), STEP * np.eye(CORRECTIONS)])
    at_depth, at_road = _seen_before(scene, axes, correction + steps, given.rays, depth)
    offsets = np.stack([_along(normal, given.pixels - at_depth[0]), _along(tangent, given.pixels - at_road[0])])
    slopes = np.stack([_along(normal, at_depth[1:] - at_depth[0]), _along(tangent, at_road[1:] - at_road[0])]) / STEP
    slopes = np.moveaxis(slopes, 1, 2)
    certain = np.stack([np.einsum("nd,nde,ne->n", d, given.information, d) for d in (normal, tangent)])
    used = np.isfinite(offsets) & np.isfinite(slopes).all(axis=-1)
    used[1] &= still | (dot(given.rays, scene.road.down) > ROAD_COSINE)
    with np.errstate(invalid="ignore"):
        weights = np.where(used, certain * np.maximum(1 - offsets**2 * certain / cut**2, 0) ** 2, 0.0)
    slopes[~used], offsets[~used] = 0.0, 0.0
    return slopes.reshape(-1, CORRECTIONS), offsets.reshape(-1), weights.reshape(-1)


def _seen_before(
    scene: RigidScene, axes: Floats, corrections: Floats, rays: Floats, depth: Floats
) -> tuple[Floats, Floats]:
    """Find where the previous image shows rays at a depth, and on the road, by each of K corrections.

    The same as `RigidScene.previous_pixels` of each corrected scene, but all points are projected in one call.

    Args:
        scene: to be corrected.
        axes: of the corrections.
        corrections: (K, 8).
        rays: (N, 3), unit rays of the current camera.
        depth: (N,), 1/m.

    Returns:
        at_depth, at_road: (K, N, 2) each, px; NaN where the lens does not see them.
    """
    rotations, translations, down = _correct(scene, axes, corrections)
    on_road = scene.road_inverse_depth(down @ rays.T)
    depths = np.stack([np.broadcast_to(depth, on_road.shape), on_road])  # (2, K, N)
    if scene.row_times is None:
        points = (rays - depths[..., None] * translations[:, None]) @ rotations
    else:
        points = _points_by_rows(_corrected(scene, axes, corrections[0]), rotations, translations, rays, depths)
    pixels = scene.camera.project(points.reshape(-1, 3))[0].reshape(*depths.shape, 2)
    return pixels[0], pixels[1]


def _points_by_rows(
    scene: RigidScene, rotations: Floats, translations_m: Floats, rays: Floats, depths: Floats
) -> Floats:
    """The points of `_seen_before`, (2, K, N, 3), at the rows that see them by the first of the K motions: the others
    differ too little from it to change rows."""
    points = np.empty((*depths.shape, 3))
    for sought, of_depth in zip(depths, points, strict=True):
        extra = scene.extra_motion(rays, sought[0])
        for k, motion in enumerate(RigidTransform.each(rotations, translations_m)):
            of_depth[k] = seen_before(rays, sought[k], current_from_previous=motion, extra_motion=extra)
    return points


def _axes(scene: RigidScene) -> Floats:
    """Rows: down, ahead and right of the vehicle, in the current camera frame; ahead is where it comes from or goes."""
    down = scene.road.down
    for ahead in (-scene.current_from_previous.translation_m, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        level = ahead - float(ahead @ down) * down
        if np.linalg.norm(level) > 1e-3 * max(float(np.linalg.norm(ahead)), STILL_M):
            break
    level = normalise(level)
    return np.stack([down, level, cross(down, level)])


def _correct(scene: RigidScene, axes: Floats, corrections: Floats) -> tuple[Floats, Floats, Floats]:
    """Rotation (..., 3, 3), translation (..., 3), m, and the road's down (..., 3) by corrections (..., 8)."""
    motion = scene.current_from_previous
    rotation = Rotation.from_rotvec(corrections[..., :3] @ axes).as_matrix()
    tilt = Rotation.from_rotvec(corrections[..., 6:] @ axes[1:]).as_matrix()
    translation_m = motion.translation_m + corrections[..., 3:6] @ axes
    return rotation @ motion.rotation, translation_m, tilt @ scene.road.down


def _corrected(scene: RigidScene, axes: Floats, correction: Floats) -> RigidScene:
    rotation, translation_m, down = _correct(scene, axes, correction)
    motion, road = RigidTransform(rotation, translation_m), RoadPlane(down, scene.road.height_m)
    return replace(scene, current_from_previous=motion, road=road)


def _nearest_depth(scene: RigidScene, given: Correspondences, start: Floats) -> tuple[Floats, Floats]:
    """Inverse depth of the point of each epipolar curve nearest to the flow, (N,), and the tangent there, (N, 2)."""
    depth = start
    for _ in range(2):
        here = scene.previous_pixels(given.rays, depth)
        slope = (scene.previous_pixels(given.rays, depth + 0.01) - here) / 0.01
        along = _along(slope, slope)
        change = _along(slope, given.pixels - here) / np.maximum(along, 1e-9)
        depth = np.clip(np.nan_to_num(depth + change), FARTHEST, NEAREST)
    return depth, slope / np.maximum(np.sqrt(along), 1e-9)[:, None]


def _along(direction: Floats, offset: Floats) -> Floats:
    return np.asarray(direction[..., 0] * offset[..., 0] + direction[..., 1] * offset[..., 1])

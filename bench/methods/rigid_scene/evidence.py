"""Evidence of two images against a rigid scene: sigmas of the flow, and a photometric test of every static depth.

The flow that a rigid scene allows at a pixel is a curve: from what is farthest there (infinitely far, or the road) to
what is as near as anything comes. A measured flow has a covariance, from the noise of the images and the structure
tensor of the texture. The deviation is the Mahalanobis distance of the flow from the curve: across it, it is the
paper's epipolar constraint; beyond its far end, positive depth above the horizon and positive height below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from bench.methods.rigid_scene.scene import GuidedFlow, RigidScene, at_every_pixel, box_mean, sampled, spread
from bench.methods.settings import Positive

Image = NDArray[np.float32]
GRADIENT_NOISE = 2 * (3**2 + 10**2 + 3**2) / 32**2  # variance of Scharr's gradient, for pixels of variance 1
MAD_TO_SIGMA = 1.4826
LEAST_NOISE = 0.7  # grey values, of the difference of two images of whole numbers
CELL = (slice(1, None, 2), slice(1, None, 2))  # curves are compared with the flow on every second pixel
WINDOW_PX = 3  # over which grey values are compared
TENSOR_PX = 5  # of the structure tensor; about the patch of the flow
TEXTURE_PX = 9  # over which the road's texture is recognised
SEARCHED = 10  # depths, denser towards the far end
CURVE_POINTS = 6
STILL_M = 0.01  # with less translation, all depths look the same
UNTESTED = 1e3  # misfit that stands for "the flow is believed"
BELOW_HORIZON = 0.02  # cosine to straight down from which a ray counts as meeting the road


def gradients(image: Image) -> tuple[Image, Image]:
    """Grey values per px along u and v, (H, W) each; Scharr's filter."""
    along_u = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32)
    along_v = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32)
    return np.asarray(along_u, dtype=np.float32), np.asarray(along_v, dtype=np.float32)


def noise_of(difference: Image, seen: NDArray[np.bool_], *, least: float) -> float:
    """Standard deviation of the difference of two registered images, grey values; robust to what does not fit.

    Args:
        difference: (H, W) float32.
        seen: (H, W) bool; where both images show the world.
        least: lower bound: pixels are whole numbers.
    """
    values = np.abs(difference.ravel()[np.flatnonzero(seen)[::5]])
    return max(float(MAD_TO_SIGMA * np.median(values)) if len(values) else 0.0, least)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Information:
    """Inverse covariance of flow vectors, 1/px^2: a symmetric 2 x 2 matrix each, (...) float32 by entry."""

    uu: Image
    uv: Image
    vv: Image

    def squared(self, u: Image, v: Image) -> Image:
        """Squared Mahalanobis length of vectors (u, v), px."""
        return np.asarray(self.uu * u * u + 2 * self.uv * u * v + self.vv * v * v)

    @classmethod
    def isotropic(cls, shape: tuple[int, ...], sigma_px: float) -> Information:
        """Return information that is equal everywhere and in all directions, of `shape`."""
        same = np.full(shape, 1 / sigma_px**2, np.float32)
        return cls(uu=same, uv=np.zeros_like(same), vv=same)


def structure_tensor(along_u: Image, along_v: Image, *, side_px: int, noise: float) -> tuple[Image, Image, Image]:
    """Sums of products of gradients over a square, without the share that noise has in them.

    Args:
        along_u: (H, W) float32, grey values per px.
        along_v: (H, W) float32.
        side_px: of the square.
        noise: standard deviation of a difference of two images, grey values.

    Returns:
        uu, uv, vv: (H, W) float32 each; positive semidefinite.
    """
    size = (side_px, side_px)
    uu, uv, vv = (
        cv2.boxFilter(a * b, -1, size, normalize=False)
        for a, b in ((along_u, along_u), (along_u, along_v), (along_v, along_v))
    )
    share = side_px**2 * GRADIENT_NOISE * noise**2 / 2
    middle, half = (uu + vv) / 2, np.hypot((uu - vv) / 2, uv) + 1e-6
    larger, smaller = np.maximum(middle + half - share, 0), np.maximum(middle - half - share, 0)  # eigenvalues
    middle, shrunk = (larger + smaller) / 2, (larger - smaller) / 2 / half
    parts = middle + shrunk * (uu - vv) / 2, shrunk * uv, middle - shrunk * (uu - vv) / 2
    first, second, third = (np.asarray(part, dtype=np.float32) for part in parts)
    return first, second, third


def flow_information(tensor: tuple[Image, Image, Image], *, noise: float, floor_px: float) -> Information:
    """Inverse of the flow's covariance `noise^2 J^-1 + floor^2 I`, without inverting J, which may be singular.

    Args:
        tensor: J, from `structure_tensor`.
        noise: standard deviation of a difference of two images, grey values.
        floor_px: what no texture gets below: interpolation, blur, the flow's own steps.

    Source:
        Simoncelli, Adelson and Heeger, Probability distributions of optical flow, 1991.
    """
    uu, uv, vv = (part / noise**2 for part in tensor)
    a, b, d = 1 + floor_px**2 * uu, floor_px**2 * uv, 1 + floor_px**2 * vv
    determinant = a * d - b * b  # (C + f I)^-1 = J (I + f J)^-1
    return Information(
        uu=(uu * d - uv * b) / determinant, uv=(uv * a - uu * b) / determinant, vv=(vv * a - uv * b) / determinant
    )


def nearest_on_curve(
    flow: Image, curve: Sequence[Image], information: Information | None
) -> tuple[Image, Image, NDArray[np.float32]]:
    """The point of a piecewise straight curve that lies nearest to a flow.

    Args:
        flow: (..., 2) float32, px.
        curve: at least one point of every curve, (..., 2) float32, px, far end first.
        information: what distances are measured by; None for pixels.

    Returns:
        squared: (...) float32, squared distance.
        point: (..., 2) float32, px.
        place: (...) float32; 0 at the far end, 1 at the second point, and so on.
    """
    metric = information or Information.isotropic(flow.shape[:-1], 1.0)
    flow_u, flow_v = flow[..., 0], flow[..., 1]
    point_u, point_v = curve[0][..., 0].copy(), curve[0][..., 1].copy()
    best = metric.squared(flow_u - point_u, flow_v - point_v)
    place = np.zeros(flow.shape[:-1], np.float32)
    for index, (start, end) in enumerate(pairwise(curve)):
        start_u, start_v = start[..., 0], start[..., 1]
        segment_u, segment_v = end[..., 0] - start_u, end[..., 1] - start_v
        weighted_u = metric.uu * segment_u + metric.uv * segment_v
        weighted_v = metric.uv * segment_u + metric.vv * segment_v
        along = weighted_u * (flow_u - start_u) + weighted_v * (flow_v - start_v)
        share = np.clip(along / np.maximum(weighted_u * segment_u + weighted_v * segment_v, 1e-9), 0, 1)
        candidate_u, candidate_v = start_u + share * segment_u, start_v + share * segment_v
        squared = metric.squared(flow_u - candidate_u, flow_v - candidate_v)
        nearer = squared < best
        for kept, candidate in (
            (best, squared),
            (point_u, candidate_u),
            (point_v, candidate_v),
            (place, share + index),
        ):
            np.copyto(kept, candidate, where=nearer)
    return best, np.stack([point_u, point_v], axis=-1), place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Everything that objects are made from, at the working size; (H, W) or on every second pixel, (H/2, W/2).

    Attributes:
        scene: the rigid scene that was tried.
        moves: the camera moved, so that depth matters.
        noise: standard deviation of the difference of the two registered images, grey values.
        tensor: uu, uv, vv of the current image's structure tensor, (H, W) float32 each.
        flow: (H, W, 2) float32, px, from the current to the previous image.
        nearest: (H, W, 2) float32, px, what of a rigid scene lies nearest to it.
        static: (H, W, 2) float32, px, motion at the depth that explains the grey values best.
        sigmas: (H, W) float32, distance of the flow from all rigid scenes in standard deviations.
        misfit: (H, W) float32; by how much the best rigid scene explains the grey values worse than the flow does, mean
            square in units of the noise; negative where it does better.
        edge: (H, W) bool; at the border of what both images show, where nothing is said.
        road_seen: (H, W) bool; the road's texture is recognised, whatever the light on it does.
        fall: (H, W) float32, cosine of each ray to straight down.
        too_low: (H, W) bool; a flow between the road's and that of infinitely far points: below the road.
        beyond: (H, W) bool; a flow beyond the far end of the curve.
        inverse_depth: (H/2, W/2) float32, 1/m, of the nearest point of the curve.
        from_road_px: (H/2, W/2) float32, px between the flow and the road's.
        from_road_sigmas: (H/2, W/2) float32, the same in standard deviations.
        road: (H, W, 2) float32, px, motion of the road below the horizon and of what is infinitely far above it.
    """

    scene: RigidScene
    moves: bool
    noise: float
    tensor: tuple[Image, Image, Image]
    flow: Image
    nearest: Image
    static: Image
    sigmas: Image
    misfit: Image
    edge: NDArray[np.bool_]
    road_seen: NDArray[np.bool_]
    fall: Image
    too_low: NDArray[np.bool_]
    beyond: NDArray[np.bool_]
    inverse_depth: Image
    from_road_px: Image
    from_road_sigmas: Image
    road: Image


@dataclass(frozen=True, kw_only=True)
class EvidenceSettings:
    """Settings of how images are compared with rigid scenes.

    Attributes:
        sigmas: the flow's own uncertainty is the unit of deviations; else `constant_px`.
        photometric: a cell is static where some static depth explains the grey values as well as its flow does; else
            the flow is believed.
        light: what shows the road's own texture is static, whatever shadow or headlight moves over it.
        nearest_m: nothing static is nearer to the camera.
        tilt_rad: uncertainty of the road's plane as the lower bound of heights.
        floor_px: accuracy of the flow where texture is plenty, at half the size.
        constant_px: unit of deviations without `sigmas`, at half the size; a third of the paper's 0.24 px at 165 px per
            radian, since the threshold is in standard deviations.
        texture: correlation from which the road's texture is recognised.
    """

    sigmas: bool = True
    photometric: bool = True
    light: bool = True
    nearest_m: Positive = 1.0
    tilt_rad: Annotated[float, Field(ge=0)] = 0.01
    floor_px: Positive = 0.1
    constant_px: Positive = 0.06
    texture: float = 0.5


def gather_evidence(
    current: NDArray[np.uint8],
    previous: NDArray[np.uint8],
    guided: GuidedFlow,
    scene: RigidScene,
    settings: EvidenceSettings,
) -> Evidence:
    """Compare flow and grey values with those of every rigid scene.

    Args:
        current: (H, W) uint8, grey.
        previous: (H, W) uint8, grey.
        guided: flow between them.
        scene: motion and road, at the images' size.
        settings: how.
    """
    now, before = current.astype(np.float32), previous.astype(np.float32)
    warped = guided.warped.astype(np.float32)
    noise = noise_of(now - warped, ~guided.neutral, least=LEAST_NOISE)
    slope_u, slope_v = gradients(now)
    tensor = structure_tensor(slope_u, slope_v, side_px=TENSOR_PX, noise=noise)
    cells = tensor[0][CELL], tensor[1][CELL], tensor[2][CELL]
    information = (
        flow_information(cells, noise=noise, floor_px=settings.floor_px)
        if settings.sigmas
        else Information.isotropic(cells[0].shape, settings.constant_px)
    )

    moves = bool(np.linalg.norm(scene.current_from_previous.translation_m) > STILL_M)
    depths = _searched_depths(scene, settings, moves=moves)
    flows = [np.nan_to_num(scene.flow_at(depth), nan=0.0) for depth in depths]
    chosen = sorted({round(k * (len(flows) - 1) / (CURVE_POINTS - 1)) for k in range(CURVE_POINTS)})
    curve = [at_every_pixel(flows[k], scene.camera)[CELL] for k in chosen]
    flow, road = guided.flow[CELL], guided.guess[CELL]
    squared, _, _ = nearest_on_curve(flow, curve, information)
    _, point, place = nearest_on_curve(flow, curve, None)
    height, width = now.shape
    nearest = _enlarged(point, width, height)
    edge = cv2.dilate(guided.neutral.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    off = _enlarged(np.sqrt(np.clip(squared, 0, 1e6)), width, height)
    off[edge] = 0

    static, cost = _best_static(now, before, flows, scene, (guided.guess, nearest))
    free = box_mean((now - sampled(before, guided.flow)) ** 2, WINDOW_PX)
    variance = box_mean(noise**2 + settings.floor_px**2 * (slope_u**2 + slope_v**2), WINDOW_PX)
    misfit = (
        (cost - free) / variance if settings.photometric else np.where(off > 0, np.float32(UNTESTED), np.float32(0))
    )
    misfit[edge] = 0

    fall = at_every_pixel(scene.fall().astype(np.float32), scene.camera)
    too_low = _too_low(flow, curve[0], scene, fall) if moves else np.zeros(flow.shape[:2], dtype=bool)
    offset = flow - road
    return Evidence(
        scene=scene,
        moves=moves,
        noise=noise,
        tensor=tensor,
        flow=guided.flow,
        nearest=nearest,
        static=static,
        sigmas=off,
        misfit=misfit,
        edge=edge,
        road_seen=_road_seen(now, warped, noise, fall, settings),
        fall=fall,
        too_low=spread(too_low, now.shape),
        beyond=spread(place == 0, now.shape),
        inverse_depth=_at_places(place, [at_every_pixel(depths[k].astype(np.float32), scene.camera) for k in chosen]),
        from_road_px=np.hypot(offset[..., 0], offset[..., 1]),
        from_road_sigmas=np.sqrt(np.maximum(information.squared(offset[..., 0], offset[..., 1]), 0)),
        road=guided.guess,
    )


def _searched_depths(scene: RigidScene, settings: EvidenceSettings, *, moves: bool) -> list[NDArray[np.floating]]:
    """Inverse depths on the scene's grid, from the farthest that is possible to the nearest."""
    far = scene.road_inverse_depth(scene.fall(), tilt_rad=settings.tilt_rad)
    if not moves:
        return [far]
    near = np.maximum(1 / settings.nearest_m, 1.3 * far)
    return [far + (near - far) * (k / (SEARCHED - 1)) ** 2 for k in range(SEARCHED)]


def _best_static(
    now: Image, before: Image, flows: list[Image], scene: RigidScene, further: tuple[Image, ...]
) -> tuple[Image, Image]:
    """Motion at the depth whose grey values fit best, (H, W, 2), and the mean square of what is left, (H, W)."""
    best, cost = further[0].copy(), box_mean((now - sampled(before, further[0])) ** 2, WINDOW_PX)
    for candidate in (*further[1:], *(at_every_pixel(flow, scene.camera) for flow in flows)):
        left = box_mean((now - sampled(before, candidate)) ** 2, WINDOW_PX)
        better = cv2.compare(left, cost, cv2.CMP_LT)
        cost = np.minimum(cost, left)
        cv2.copyTo(candidate, better, best)
    return best, cost


def _road_seen(now: Image, warped: Image, noise: float, fall: Image, settings: EvidenceSettings) -> NDArray[np.bool_]:
    """The road's fine texture agrees, whatever its brightness: a shadow or a headlight moves over what stands still."""
    if not settings.light:
        return np.zeros(now.shape, dtype=bool)
    a, b = now - box_mean(now, WINDOW_PX), warped - box_mean(warped, WINDOW_PX)
    both, one, other = (box_mean(x * y, TEXTURE_PX) for x, y in ((a, b), (a, a), (b, b)))
    return np.asarray((fall > BELOW_HORIZON) & (both > settings.texture * np.sqrt(one * other + (0.5 * noise**2) ** 2)))


def _too_low(flow: Image, road: Image, scene: RigidScene, fall: Image) -> NDArray[np.bool_]:
    """Between the motion of the road and that of infinitely far points, below the horizon; on every second pixel."""
    infinity = at_every_pixel(np.nan_to_num(scene.flow_at(0.0)), scene.camera)[CELL]
    segment, offset = road - infinity, flow - infinity
    length = np.hypot(segment[..., 0], segment[..., 1])
    along = segment[..., 0] * offset[..., 0] + segment[..., 1] * offset[..., 1]
    share = along / np.maximum(length**2, 1e-6)
    across = np.abs(segment[..., 0] * offset[..., 1] - segment[..., 1] * offset[..., 0]) / np.maximum(length, 1e-3)
    below = fall[CELL] > BELOW_HORIZON
    return np.asarray(below & ((1 - share) * length > 2 * across) & (share > -0.6) & (share < 0.95))


def _at_places(place: Image, values: list[Image]) -> Image:
    """Values of the curve's points, interpolated at places along it."""
    stack = np.stack([value[CELL] for value in values])
    first = np.minimum(place.astype(np.intp), len(stack) - 1)
    second = np.minimum(first + 1, len(stack) - 1)
    a, b = (np.take_along_axis(stack, index[None], axis=0)[0] for index in (first, second))
    return np.asarray(a + (place - first) * (b - a), dtype=np.float32)


def _enlarged(cells: Image, width: int, height: int) -> Image:
    return np.asarray(cv2.resize(cells, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)

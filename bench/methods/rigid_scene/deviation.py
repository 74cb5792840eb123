"""Distance of a flow vector, in standard deviations, from anything that a rigid scene could show.

The flow that a rigid scene allows at a pixel is a curve: from what is farthest there (infinitely far, or the road) to
what is as near as anything comes. A measured flow has a covariance, from the noise of the images and the structure
tensor of the texture. The deviation is the Mahalanobis distance of the flow from the curve: across it, it is the
paper's epipolar constraint; beyond its far end, positive depth above the horizon and positive height below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
GRADIENT_NOISE = 2 * (3**2 + 10**2 + 3**2) / 32**2  # variance of Scharr's gradient, for pixels of variance 1
MAD_TO_SIGMA = 1.4826
LEAST_NOISE = 0.7  # grey values, of the difference of two images of whole numbers


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

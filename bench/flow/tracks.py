"""Sparse tracks: corners of the newest image, followed back in time by pyramidal Lucas-Kanade."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError, UsageError
from bench.flow.dense import check_grey

CORNER_BLOCK_PX = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracks:
    """Positions of the newest image's corners in older images.

    Attributes:
        pixels: (K, N, 2) float64, px, (u, v) of N corners in K images, the newest first; NaN where not followed.
        followed: (K, N) bool; a corner that is not followed to an image is not followed to any older one. All True in
            the newest.
    """

    pixels: NDArray[np.float64]
    followed: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class LucasKanadeTracker:
    """Corners after Shi and Tomasi, followed by pyramidal Lucas-Kanade with a forward-backward check.

    The numbers are those of OpenCV's own example of sparse flow, but for corners (a quality of 0.01 finds few on a
    road) and the window, which is the one of `FarnebackFlow`.

    Attributes:
        corners: at most so many, the strongest.
        quality: a corner's smaller eigenvalue over that of the strongest corner, at least.
        min_distance_px: between corners.
        window_px: side of the square whose grey values are matched; odd.
        levels: of the pyramid, beside the image itself.
        max_return_px: how far from its start a corner may end that is followed there and back.

    Raises:
        UsageError: a number that is out of its domain.

    Source:
        Shi and Tomasi, Good features to track, 1994. Bouguet, Pyramidal implementation of the Lucas Kanade feature
        tracker, 2000. Kalal et al., Forward-backward error, 2010.
    """

    corners: int = 4000
    quality: float = 1e-3
    min_distance_px: float = 7.0
    window_px: int = 15
    levels: int = 3
    max_return_px: float = 0.5

    def __post_init__(self) -> None:
        if self.corners < 1 or self.window_px < 3 or self.window_px % 2 == 0 or not 0 <= self.levels <= 10:
            raise UsageError("lucas-kanade: expected corners >= 1, an odd window_px >= 3 and levels in 0 to 10")
        if not (0 < self.quality < 1 and self.min_distance_px >= 1 and self.max_return_px > 0):
            raise UsageError("lucas-kanade: expected quality in (0, 1), min_distance_px >= 1 and max_return_px > 0")

    @property
    def reach_px(self) -> int:
        """A corner's displacement is that of the pixels this far to each side of it."""
        return self.window_px // 2

    def __call__(self, images: Sequence[NDArray[np.uint8]], *, valid: NDArray[np.bool_] | None = None) -> Tracks:
        """Follow the corners of the first image through the others.

        Args:
            images: at least two, (H, W) uint8 grey, the newest first.
            valid: (H, W) bool; where corners are looked for; everywhere without it.

        Returns:
            N tracks, the strongest corner first; none in an image without corners.

        Raises:
            ShapeError: fewer than two images, images of different size, or not grey.
        """
        if len(images) < 2:
            raise ShapeError(f"tracks: expected at least two images, got {len(images)}")
        check_grey(images, "tracks")
        mask = None if valid is None else valid.astype(np.uint8)
        strongest = cv2.goodFeaturesToTrack(
            images[0], self.corners, self.quality, self.min_distance_px, mask=mask, blockSize=CORNER_BLOCK_PX
        )
        corners = (
            np.zeros((0, 1, 2), dtype=np.float32) if strongest is None else np.asarray(strongest, dtype=np.float32)
        )
        pixels = np.full((len(images), len(corners), 2), np.nan)
        followed = np.zeros(pixels.shape[:2], dtype=bool)
        pixels[0], followed[0] = corners[:, 0], True
        for age, (newer, older) in enumerate(pairwise(images), start=1):
            rows = np.flatnonzero(followed[age - 1])
            if not len(rows):
                break
            ends, kept = self._follow(newer, older, pixels[age - 1, rows].astype(np.float32)[:, None])
            pixels[age, rows[kept]], followed[age, rows[kept]] = ends[kept], True
        return Tracks(pixels=pixels, followed=followed)

    def _follow(
        self, start: NDArray[np.uint8], end: NDArray[np.uint8], points: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Positions of (N, 1, 2) points in `end`, (N, 2), and the result of the forward-backward check, (N,)."""
        ends, forward = self._step(start, end, points)
        back, backward = self._step(end, start, ends)
        height, width = end.shape
        off_px = np.linalg.norm((back - points)[:, 0], axis=-1)
        u, v = ends[:, 0, 0], ends[:, 0, 1]
        inside = (u >= -0.5) & (u < width - 0.5) & (v >= -0.5) & (v < height - 0.5)
        return ends[:, 0].astype(np.float64), forward & backward & inside & (off_px <= self.max_return_px)

    def _step(
        self, start: NDArray[np.uint8], end: NDArray[np.uint8], points: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        ends, status, _ = cv2.calcOpticalFlowPyrLK(
            start, end, points, np.empty_like(points), winSize=(self.window_px, self.window_px), maxLevel=self.levels
        )
        return np.asarray(ends, dtype=np.float32), np.asarray(status).reshape(-1).astype(bool)

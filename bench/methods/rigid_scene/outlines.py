"""Outlines of what may move, which follow the image: by the object's own motion against the background's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.rigid_scene.candidates import LEAST_KNOWN, LEAST_SEEDS, Candidates, Mask, ObjectSettings
from bench.methods.rigid_scene.evidence import CELL, WINDOW_PX, Evidence, Image, gradients
from bench.methods.rigid_scene.scene import box_mean, pixel_positions, remapped, spread

Window = tuple[slice, slice]
LEAST_PX = 48  # at the size of the answer; smaller regions are specks
FACTOR = 2  # size of the answer over that of the evidence
FINE_NOISE = 1.5  # noise of a pixel over that of a mean of four, which JPEG has made alike
MARGIN_PX = 5  # around a region, where its outline is looked for
CUT_SEED = 0  # of OpenCV's generator, which starts the colour clusters of GrabCut
LARGEST_CUT_PX = 6_000
SCORE_SCALE = 50.0  # of the score as the second channel in which outlines are looked for
# Least scores: of what is surely part of an object; of a region's other pixels, the rest of which is background at
# first; and of pixels beside the region. At 0 both motions explain the grey values alike.
SURE_SCORE, LIKELY_SCORE, BESIDE_SCORE = 0.05, -0.3, 0.4
BESIDE_PX = 9  # in which objects may reach beyond their regions
CARRIED_CELLS = (3, 5, 11, 21)  # squares over which the motion of objects and background is carried to what lies beside
GUIDED_PX = 7
LEAST_GUIDING = 5.5  # grey values; weaker edges are none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """The current image and an earlier one.

    Attributes:
        previous: (H, W) uint8, the earlier image at the size of the answer, about twice that of the evidence.
        evidence: of the two.
    """

    previous: NDArray[np.uint8]
    evidence: Evidence


def _windows(box: NDArray[np.int32], shape: tuple[int, int]) -> tuple[Window, Window]:
    """Rows and columns of a component with a margin, at the size of the evidence and at that of the answer."""
    left, top, width, height = box[:4].tolist()
    rows = max(top - MARGIN_PX, 0), min(top + height + MARGIN_PX, shape[0])
    columns = max(left - MARGIN_PX, 0), min(left + width + MARGIN_PX, shape[1])
    fine = slice(FACTOR * rows[0], FACTOR * rows[1]), slice(FACTOR * columns[0], FACTOR * columns[1])
    return (slice(*rows), slice(*columns)), fine


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Motions:
    """Motions that a pixel beside an object may have: each an earlier image and a flow to it, at the evidence's size.

    Attributes:
        own: the motion of the nearest object.
        static: the road, and the background beside the objects, in each of the earlier images: what a body has just
            uncovered is hidden in one, but not in all.
    """

    own: tuple[Image, Image]
    static: tuple[tuple[Image, Image], ...]

    @classmethod
    def of(cls, candidates: Candidates, pairs: Sequence[Pair], *, calm_sigmas: float) -> _Motions:
        first = pairs[0].evidence
        own = _carried(first.flow, candidates.sure & candidates.region)
        away = cv2.dilate(candidates.region.astype(np.uint8), np.ones((7, 7), np.uint8)) == 0
        away &= (first.sigmas < calm_sigmas) & ~first.edge
        static: list[tuple[Image, Image]] = []
        for pair in pairs:
            previous, seen = pair.previous.astype(np.float32), pair.evidence
            static += [(previous, _carried(seen.static, away & ~seen.edge)), (previous, seen.road)]
        return cls(own=(pairs[0].previous.astype(np.float32), own), static=tuple(static))

    def score(
        self, current: NDArray[np.uint8], coarse: Window, fine: Window, *, noise: float, floor_px: float
    ) -> Image:
        """By how much the object's own motion explains grey values better than the background's, in a window.

        The logarithm of the ratio of what each leaves over, smoothed as the image is (guided filter).

        Args:
            current: (H, W) uint8.
            coarse: the window, at the size of the evidence.
            fine: the window, at that of the image.
            noise: standard deviation of the difference of two images, grey values.
            floor_px: accuracy of the flow, px.

        Source:
            He, Sun and Tang, Guided image filtering, 2013.
        """
        now = current[fine].astype(np.float32)
        height, width = now.shape
        start = pixel_positions(current.shape[1], current.shape[0])[fine]
        slope_u, slope_v = gradients(now)
        variance = box_mean(noise**2 + floor_px**2 * (slope_u**2 + slope_v**2), WINDOW_PX)

        def left_over(previous: Image, flow: Image) -> Image:
            ends = start + FACTOR * cv2.resize(flow[coarse], (width, height), interpolation=cv2.INTER_LINEAR)
            return np.asarray(np.log(box_mean((now - remapped(previous, ends)) ** 2, WINDOW_PX) / variance + 0.5))

        static = np.minimum.reduce([left_over(*motion) for motion in self.static])
        return _guided(now, static - left_over(*self.own), noise=max(noise, LEAST_GUIDING))


def _carried(flow: Image, known: Mask) -> Image:
    """A flow where it is known, and its mean over the nearest known pixels elsewhere; as it is far from any."""
    height, width = known.shape
    carried, share = flow[CELL].copy(), known[CELL].astype(np.float32)
    weighted = carried * share[..., None]
    for side_px in reversed(CARRIED_CELLS):
        near = box_mean(share, side_px)
        mean = cv2.divide(box_mean(weighted, side_px), cv2.merge([near, near]))
        cv2.copyTo(mean, (near > LEAST_KNOWN).view(np.uint8), carried)
    return np.asarray(cv2.resize(carried, (width, height), interpolation=cv2.INTER_LINEAR))


def _guided(image: Image, values: Image, *, noise: float) -> Image:
    """Values smoothed over a square, but not over edges of an image that are higher than the noise."""
    mean, mean_values = box_mean(image, GUIDED_PX), box_mean(values, GUIDED_PX)
    variance = box_mean(image * image, GUIDED_PX) - mean * mean
    slope = np.asarray((box_mean(image * values, GUIDED_PX) - mean * mean_values) / (variance + noise**2), np.float32)
    return np.asarray(
        box_mean(slope, GUIDED_PX) * image + box_mean(mean_values - slope * mean, GUIDED_PX), dtype=np.float32
    )


def _cut(image: NDArray[np.uint8], score: Image, *, region: Mask, sure: Mask, own: Mask) -> Mask:
    """Outline of a region in a window by graph cut over grey values and score."""
    if not (sure & own).any() or (own & ~region).sum() < 5:
        return region & own
    labels: NDArray[np.uint8] = np.full(region.shape, cv2.GC_BGD, np.uint8)
    labels[own] = cv2.GC_PR_BGD
    labels[own & region] = cv2.GC_PR_FGD
    labels[own & sure] = cv2.GC_FGD
    second = np.clip(SCORE_SCALE * score + 128, 0, 255)
    channels = np.dstack([image, second.astype(np.uint8), np.zeros_like(image)])
    if image.size > LARGEST_CUT_PX:  # at half the size; a large object's outline is long enough
        height, width = image.shape
        channels = np.ascontiguousarray(channels[::2, ::2])
        halved = _graph_cut(channels, np.ascontiguousarray(labels[::2, ::2]))
        labels = np.asarray(cv2.resize(halved, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    else:
        labels = _graph_cut(channels, labels)
    return np.asarray((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)) & own


def _graph_cut(channels: NDArray[np.uint8], labels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """OpenCV's GrabCut, one iteration; without both kinds of pixels there is nothing to cut.

    Source:
        Rother, Kolmogorov and Blake, GrabCut, 2004.
    """
    inside = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    if inside.all() or not inside.any():
        return labels
    cv2.setRNGSeed(CUT_SEED)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(channels, labels, [0, 0, 0, 0], *models, iterCount=1, mode=cv2.GC_INIT_WITH_MASK)
    return labels


def _without_specks(mask: Mask, seeds: Mask) -> Mask:
    """Components that are large enough and hold a seed."""
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    keep = (boxes[:, cv2.CC_STAT_AREA] >= LEAST_PX) & (np.bincount(labels[seeds], minlength=count) > 0)
    keep[0] = False
    return np.asarray(keep[labels])


def draw_objects(
    candidates: Candidates,
    current: NDArray[np.uint8],
    pairs: Sequence[Pair],
    settings: ObjectSettings,
    *,
    floor_px: float,
) -> Mask:
    """Masks of the candidates at the size of the answer, without specks.

    Args:
        candidates: from `find_candidates`.
        current: (H, W) uint8, the current image at the size of the answer.
        pairs: the one that the candidates come from, and others in which the background may show.
        settings: thresholds and switches.
        floor_px: accuracy of the flow, at the size of the evidence.

    Returns:
        (H, W) bool, of the size of the images.
    """
    mask = np.zeros(current.shape, dtype=bool)
    around = cv2.dilate(
        candidates.region.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (BESIDE_PX, BESIDE_PX))
    )
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(around, connectivity=8)
    seeded = np.bincount(labels[candidates.seeds], minlength=count) >= LEAST_SEEDS // 2
    motions = (
        _Motions.of(candidates, pairs, calm_sigmas=settings.sigmas) if settings.outlines and seeded.any() else None
    )
    for index in (np.flatnonzero(seeded[1:]) + 1).tolist():
        coarse, fine = _windows(boxes[index], labels.shape)
        shape = mask[fine].shape
        own = labels[coarse] == index
        region, sure, seeds, around_it = (
            spread(part[coarse] & own, shape)
            for part in (candidates.region, candidates.sure, candidates.seeds, ~pairs[0].evidence.edge)
        )
        if motions is not None:
            noise = FINE_NOISE * pairs[0].evidence.noise
            score = motions.score(current, coarse, fine, noise=noise, floor_px=FACTOR * floor_px)
            region = around_it & (score > np.where(region, LIKELY_SCORE, BESIDE_SCORE))
            sure &= score > SURE_SCORE
            region = _cut(current[fine], score, region=region, sure=sure, own=around_it)
        mask[fine] |= _without_specks(region, seeds)
    return mask

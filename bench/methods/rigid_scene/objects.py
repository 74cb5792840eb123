"""From evidence to objects: hysteresis, growth by common motion and from feet, and outlines that follow the image."""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.methods.rigid_scene.deviation import Image, gradients
from bench.methods.rigid_scene.evidence import BELOW_HORIZON, WINDOW_PX, Evidence
from bench.methods.rigid_scene.scene import box_mean, pixel_positions, remapped
from bench.methods.rigid_scene.standing import floating, upright

Mask = NDArray[np.bool_]
Window = tuple[slice, slice]
REACH_PX = (5, 11, 21)  # squares over which the motion of seeds is carried to what lies around
COMMON = 0.6  # a pixel moves with an object if its deviation differs from the object's by less than this share
ROUNDS = 2
LEAST_SEEDS = 4
SEED_SHARE = 0.03
LEAST_PX = 48  # at the size of the answer; smaller regions are specks
FACTOR = 2  # size of the answer over that of the evidence
FINE_NOISE = 1.5  # noise of a pixel over that of a mean of four, which JPEG has made alike
INSIDE_PX = 9  # what is sure all around counts as sure, also without texture
MARGIN_PX = 5  # around a region, where its outline is looked for
CUT_SEED = 0  # of OpenCV's generator, which starts the colour clusters of GrabCut
LARGEST_CUT_PX = 6_000
MISFIT_SCALE, MISFIT_LIMIT = 10.0, 3.0  # misfit as the second channel in which outlines are looked for


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """How evidence becomes objects.

    Attributes:
        sigmas: the one threshold, in standard deviations: what lies further than this from all rigid scenes may move.
        misfit: a rigid scene explains the grey values of a seed worse by so many variances of the noise.
        mark: the same for a pixel beside seeds that surely moves with them.
        grow: what seems to lie below the road is grown up from where it stands on it.
        height_m: to which it is grown: people and cars.
        floating: an obstacle moves whose distance is less than this share of that of the road at its foot; 0 for never.
            What comes at a third of the ego vehicle's speed reaches 0.75.
        outlines: outlines follow the image, by graph cut; else they are those of the flow.

    Raises:
        UsageError: a number that is out of its domain.
    """

    sigmas: float = 3.0
    misfit: float = 2.0
    mark: float = 0.5
    grow: bool = True
    height_m: float = 1.6
    floating: float = 0.75
    outlines: bool = True

    def __post_init__(self) -> None:
        if min(self.sigmas, self.height_m) <= 0 or not 0 <= self.floating < 1:
            raise UsageError(
                "objects: expected sigmas and height_m > 0 and floating in [0, 1), "
                f"got {self.sigmas}, {self.height_m} and {self.floating}"
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """Regions that probably move, (H, W) bool each, at the size of the evidence.

    Attributes:
        seeds: where the evidence is strong; every object needs some.
        sure: surely part of an object.
        region: probably part of one.
        standing: regions that were grown up from the road.
        floating: obstacles that would have to float.
    """

    seeds: Mask
    sure: Mask
    region: Mask
    standing: Mask
    floating: Mask

    def within(self, mask: Mask) -> Candidates:
        """What of them lies in a mask."""
        return Candidates(**{field.name: getattr(self, field.name) & mask for field in fields(self)})


def find_candidates(evidence: Evidence, settings: ObjectSettings, *, slow_px: float = np.inf) -> Candidates:
    """Seeds and regions of objects.

    Args:
        evidence: of two images.
        settings: thresholds and switches.
        slow_px: only what deviates by less is looked for.
    """
    height, width = evidence.sigmas.shape
    deviation = evidence.flow - evidence.nearest
    usable = ~evidence.road_seen
    if np.isfinite(slow_px):
        usable &= np.hypot(deviation[..., 0], deviation[..., 1]) < slow_px
    likely = usable & (evidence.sigmas > settings.sigmas)
    seeds = likely & (box_mean(evidence.misfit, WINDOW_PX) > settings.misfit)
    blobs = _with_seeds(likely, seeds)
    hanging = np.zeros_like(blobs)
    if settings.floating > 0:
        cells = floating(evidence, at_most=settings.floating, calm_sigmas=2 * settings.sigmas).astype(np.uint8)
        hanging = cv2.resize(cells, (width, height), interpolation=cv2.INTER_NEAREST) > 0
    region = _moving_together(deviation, blobs) & ~evidence.edge & ~evidence.road_seen
    sure = (region & (evidence.misfit > settings.mark)) | hanging
    region |= hanging
    standing = np.zeros_like(region)
    if settings.grow and evidence.moves:
        standing = _below_road(region, sure, evidence.too_low | hanging, evidence.fall > BELOW_HORIZON)
        grown = upright(evidence.scene, evidence.fall, standing, evidence.edge, height_m=settings.height_m)
        region |= grown & ~evidence.edge
    return Candidates(seeds=(seeds & blobs) | hanging, sure=sure, region=region, standing=standing, floating=hanging)


def _with_seeds(likely: Mask, seeds: Mask) -> Mask:
    """Components that hold enough seeds."""
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(likely.astype(np.uint8), connectivity=8)
    held = np.bincount(labels[seeds], minlength=count)
    keep = (held >= LEAST_SEEDS) & (held >= SEED_SHARE * boxes[:, cv2.CC_STAT_AREA])
    keep[0] = False
    return np.asarray(keep[labels])


def _moving_together(deviation: Image, start: Mask) -> Mask:
    """Pixels around a start whose deviation from a rigid scene is nearer to the start's than to none."""
    region = start
    for _ in range(ROUNDS):
        weight = region.astype(np.float32)
        common, known = np.zeros_like(deviation), np.zeros(start.shape, dtype=bool)
        for side_px in REACH_PX:
            share = box_mean(weight, side_px)
            mean = box_mean(deviation * weight[..., None], side_px) / np.maximum(share, 1e-6)[..., None]
            new = ~known & (share > 0.05)
            np.copyto(common, mean, where=new[..., None])
            known |= new
        off = deviation - common
        size = np.hypot(common[..., 0], common[..., 1])
        region = known & (np.hypot(off[..., 0], off[..., 1]) < COMMON * size)
    return region


def _below_road(region: Mask, sure: Mask, too_low: Mask, below_horizon: Mask) -> Mask:
    """Components that violate positive height in a good part of what they show below the horizon."""
    opened = cv2.morphologyEx(region.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(opened)
    low = np.bincount(labels[sure & too_low], minlength=count)
    keep = (low > LEAST_SEEDS) & (low > 0.4 * np.bincount(labels[sure & below_horizon], minlength=count))
    keep[0] = False
    return np.asarray(keep[labels])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineImages:
    """The two images at the size of the answer, about twice that of the evidence; (H, W) uint8 each."""

    current: NDArray[np.uint8]
    previous: NDArray[np.uint8]


def draw_objects(
    candidates: Candidates, evidence: Evidence, images: FineImages, settings: ObjectSettings, *, floor_px: float
) -> Mask:
    """Masks of the candidates at the size of the answer, without specks.

    Args:
        candidates: from `find_candidates`.
        evidence: that they come from.
        images: the two images.
        settings: thresholds and switches.
        floor_px: accuracy of the flow, at the size of the evidence.

    Returns:
        (H, W) bool, of the size of the images.
    """
    mask = np.zeros(images.current.shape, dtype=bool)
    around = cv2.dilate(candidates.region.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5)))
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(around, connectivity=8)
    seeded = np.bincount(labels[candidates.seeds], minlength=count) >= LEAST_SEEDS // 2
    for index in (np.flatnonzero(seeded[1:]) + 1).tolist():
        coarse, fine = _windows(boxes[index], labels.shape)
        shape = mask[fine].shape
        own = labels[coarse] == index
        region, sure, seeds, around_it = (
            cv2.resize(part.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
            for part in (
                candidates.region[coarse] & own,
                candidates.sure[coarse] & own,
                candidates.seeds[coarse] & own,
                own & ~evidence.edge[coarse],
            )
        )
        if settings.outlines:
            misfit = _fine_misfit(evidence, images, coarse, fine, floor_px=floor_px)
            inside = box_mean(sure.astype(np.float32), INSIDE_PX) > 0.98
            sure &= (misfit > settings.mark) | inside
            region = _cut(images.current[fine], misfit, region=region, sure=sure, own=around_it)
        mask[fine] |= _without_specks(region, seeds)
    return mask


def _windows(box: NDArray[np.int32], shape: tuple[int, int]) -> tuple[Window, Window]:
    """Rows and columns of a component with a margin, at the size of the evidence and at that of the answer."""
    left, top, width, height = box[:4].tolist()
    rows = max(top - MARGIN_PX, 0), min(top + height + MARGIN_PX, shape[0])
    columns = max(left - MARGIN_PX, 0), min(left + width + MARGIN_PX, shape[1])
    fine = slice(FACTOR * rows[0], FACTOR * rows[1]), slice(FACTOR * columns[0], FACTOR * columns[1])
    return (slice(*rows), slice(*columns)), fine


def _fine_misfit(evidence: Evidence, images: FineImages, coarse: Window, fine: Window, *, floor_px: float) -> Image:
    """`Evidence.misfit` in a window at the size of the answer."""
    now = images.current[fine].astype(np.float32)
    height, width = now.shape
    start = pixel_positions(images.current.shape[1], images.current.shape[0])[fine]

    def left_over(flow: Image) -> Image:
        ends = start + FACTOR * cv2.resize(flow[coarse], (width, height), interpolation=cv2.INTER_LINEAR)
        return box_mean((now - remapped(images.previous.astype(np.float32), ends)) ** 2, WINDOW_PX)

    slope_u, slope_v = gradients(now)
    noise = FINE_NOISE * evidence.noise
    variance = box_mean(noise**2 + (FACTOR * floor_px) ** 2 * (slope_u**2 + slope_v**2), WINDOW_PX)
    static = np.minimum(left_over(evidence.static), left_over(evidence.nearest))
    return np.asarray((static - left_over(evidence.flow)) / variance, dtype=np.float32)


def _cut(image: NDArray[np.uint8], misfit: Image, *, region: Mask, sure: Mask, own: Mask) -> Mask:
    """Outline of a region in a window by graph cut over grey values and misfit."""
    if not (sure & own).any() or (own & ~region).sum() < 5:
        return region & own
    labels: NDArray[np.uint8] = np.full(region.shape, cv2.GC_BGD, np.uint8)
    labels[own] = cv2.GC_PR_BGD
    labels[own & region] = cv2.GC_PR_FGD
    labels[own & sure] = cv2.GC_FGD
    second = np.clip(misfit, -MISFIT_LIMIT, MISFIT_LIMIT) * MISFIT_SCALE + 128
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

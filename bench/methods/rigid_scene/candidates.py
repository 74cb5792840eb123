"""What may move: seeds and regions by hysteresis, common motion and feet on the road, without own shadow and light.

Objects stand on the road: the foot gives the distance, and so the height, and whether an object can be static.

The ego vehicle's own shadow and light on the road move with it and are no objects. Such a pattern stands still in the
image, or nearly so, while the road moves below it: the image is S(x) + T(x), with S fixed in it and T moving with the
road. The difference of two images at the same pixel is free of S, and it moves with the road: the last difference is
the one before it, displaced by the road's motion. A car ahead at the ego vehicle's speed stands still in the image as
well, but no road moves below its surface; it differs by noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import UsageError
from bench.methods.rigid_scene.evidence import BELOW_HORIZON, CELL, WINDOW_PX, Evidence, Image
from bench.methods.rigid_scene.scene import RigidScene, box_mean, sampled, shortened, spread

Mask = NDArray[np.bool_]
REACH_PX = (5, 11, 21)  # squares over which the motion of seeds is carried to what lies around
COMMON = 0.6  # a pixel moves with an object if its deviation differs from the object's by less than this share
ROUNDS = 2
LEAST_SEEDS = 4
SEED_SHARE = 0.03
LEAST_KNOWN = 0.05  # share of a square from which on its known pixels tell the motion of all
HIDDEN_PX = 4  # so near to the border of what is seen, a foot is cut off
NEAR_FEET = 1.35  # feet of one object lie at distances up to this factor apart
OBSTACLE_RATIO = 0.85  # a surface nearer than this share of the road behind it is an obstacle
CLEAR_SIGMAS = 4.0  # and its flow is so far from the road's
CLEAR_PX = 0.5
LEAST_COLUMNS = 5  # of cells, that an obstacle is wide
GROUNDED = 0.9  # of its columns have to float: wheels are at least a tenth of what is seen of a parked car
LOWER_CELLS = 10  # of an obstacle, from which its distance is taken
STEP_CELLS, GAP_CELLS = 4, 3  # from a sill to a wheel: rows between feet, columns between neighbours
LEAST_ROAD_PX = 4.0  # motion of the road, beyond its fine texture, from which it is told from what stands still
ON_ROAD = 0.7  # share of a region on road that moves so far
LEAST_CORRELATION = 0.3  # over a whole region, far above chance


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """Settings of how evidence becomes objects.

    Attributes:
        sigmas: the one threshold, in standard deviations: what lies further than this from all rigid scenes may move.
        misfit: a rigid scene explains the grey values of a seed worse by so many variances of the noise.
        mark: the same for a pixel beside seeds that surely moves with them.
        grow: what seems to lie below the road is grown up from where it stands on it.
        height_m: to which it is grown: people and cars.
        floating: an obstacle moves whose distance is less than this share of that of the road at its foot; 0 for never.
            What comes at a third of the ego vehicle's speed reaches 0.75.
        outlines: outlines lie where the object's own motion no longer explains the grey values better than the
            background's, by graph cut; else they are those of the flow.

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
        """Return the part of the candidates that lies in a mask."""
        return Candidates(**{field.name: getattr(self, field.name) & mask for field in fields(self)})


def upright(scene: RigidScene, fall: NDArray[np.float32], feet: Mask, hidden: Mask, *, height_m: float) -> Mask:
    """Pixels between the lower outline of regions, taken as standing on the road, and a height above it.

    Args:
        scene: with the road, at the mask's size.
        fall: (H, W) float32, cosine of each ray to straight down.
        feet: (H, W) bool, regions that reach down to the road.
        hidden: (H, W) bool; the image ends there, or the ego vehicle's body begins: no region has its foot there.
        height_m: of the objects.
    """
    filled = np.zeros(feet.shape, np.uint8)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(feet.astype(np.uint8), connectivity=8)
    for index in range(1, count):
        left, top, width, height, _ = boxes[index]
        inside = labels[top : top + height, left : left + width] == index
        columns = np.flatnonzero(inside.any(axis=0))
        u, v = left + columns, top + height - 1 - np.argmax(inside[::-1, columns], axis=0)
        reach = scene.road.height_m / np.maximum(fall[v, u], BELOW_HORIZON)
        ends = hidden[np.minimum(v + HIDDEN_PX, len(hidden) - 1), u] | (v + HIDDEN_PX >= len(hidden))
        stands = ~ends & (fall[v, u] > 2 * BELOW_HORIZON) & (reach < NEAR_FEET * reach.min())
        u, v, reach = u[stands], v[stands], reach[stands]
        pixels = np.stack([u, v], axis=1).astype(np.float64)
        rays, _ = scene.camera.unproject(pixels)
        heads, seen = scene.camera.project(rays * reach[:, None] - height_m * scene.road.down)
        heads = pixels + shortened(heads - pixels)
        for k in np.flatnonzero((np.diff(u) <= 2) & seen[:-1] & seen[1:]):
            corners = np.array([[u[k], v[k]], [u[k + 1], v[k + 1]], heads[k + 1], heads[k]])
            cv2.fillConvexPoly(filled, np.rint(corners).astype(np.int32), 1)
    return filled > 0


def floating(evidence: Evidence, *, at_most: float, calm_sigmas: float) -> Mask:
    """Obstacles that, if they were static, would hang in the air above the road where they begin.

    A static obstacle stands on the road: at its foot it is as far away as the road. What comes towards the ego vehicle
    looks nearer than it is, by the ratio of the ego vehicle's speed to the sum of both; the road below its wheels
    does not. Parked cars have ground clearance, but wheels, too: a column of the image counts with its neighbours. A
    foot counts only where the road below it is seen to be the road: a wall in the dark begins above its foot, and where
    the image ends, nothing is seen below.

    Args:
        evidence: of two images.
        at_most: distance of an obstacle over that of the road at its foot, below which it is not static.
        calm_sigmas: only what a rigid scene explains by itself is looked at.

    Returns:
        (H/2, W/2) bool.
    """
    hanging = np.zeros(evidence.inverse_depth.shape, dtype=bool)
    if not evidence.moves:
        return hanging
    fall = evidence.fall[CELL]
    road = evidence.scene.road_inverse_depth(fall)
    obstacle = road < OBSTACLE_RATIO * evidence.inverse_depth
    obstacle &= (evidence.from_road_sigmas > CLEAR_SIGMAS) & (evidence.from_road_px > CLEAR_PX)
    obstacle &= (evidence.sigmas[CELL] < calm_sigmas) & ~evidence.edge[CELL]
    opened = cv2.morphologyEx(obstacle.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    obstacle = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
    columns = _columns(evidence, obstacle, obstacle & (fall > 1.5 * BELOW_HORIZON), road)
    for group in _neighbours(columns):
        ratios = [columns[column].ratio for column in group]
        if len(group) >= LEAST_COLUMNS and np.quantile(ratios, GROUNDED) < at_most:
            for column in group:
                here = columns[column]
                rows = slice(here.top, here.foot + 1)
                same = np.abs(evidence.inverse_depth[rows, column] / here.inverse_depth - 1) < 0.5
                hanging[rows, column] = obstacle[rows, column] & same
    return hanging


@dataclass(frozen=True, slots=True, kw_only=True)
class _Column:
    """The lowest obstacle in a column of cells.

    Attributes:
        top: first row.
        foot: last row.
        ratio: its distance over that of the road at its foot.
        inverse_depth: 1/m; of what of it is nearest, for the flow blurs it with the road at its foot.
    """

    top: int
    foot: int
    ratio: float
    inverse_depth: float


def _columns(evidence: Evidence, obstacle: Mask, below: Mask, road: NDArray[np.floating]) -> dict[int, _Column]:
    """By column of cells, where what lies below the obstacle is seen to be the road."""
    columns = {}
    last = len(obstacle) - 1
    per_px = evidence.from_road_sigmas / np.maximum(evidence.from_road_px, 1e-3)
    for column in np.flatnonzero(below.any(axis=0)).tolist():
        foot = int(np.flatnonzero(below[:, column])[-1])
        free = np.flatnonzero(~obstacle[:foot, column])
        top = int(free[-1]) + 1 if len(free) else 0
        lower, under = slice(max(foot - LOWER_CELLS, top), foot), slice(min(foot + 2, last), min(foot + 6, last + 1))
        if foot - top < 2 or foot + HIDDEN_PX // 2 > last or evidence.edge[CELL][under, column].any():
            continue
        seen = _ranked(per_px[under, column], 0.5) * _ranked(evidence.from_road_px[lower, column], 0.5)
        if seen < CLEAR_SIGMAS:
            continue
        inverse_depth = _ranked(evidence.inverse_depth[lower, column], 0.8)
        ratio = float(road[min(foot + 1, last), column]) / max(inverse_depth, 1e-6)
        columns[column] = _Column(top=top, foot=foot, ratio=ratio, inverse_depth=inverse_depth)
    return columns


def _ranked(values: NDArray[np.floating], share: float) -> float:
    """The value that a share of all do not exceed; of a few values much faster than a quantile."""
    return float(np.sort(values)[int(share * (len(values) - 1))])


def _neighbours(columns: dict[int, _Column]) -> list[list[int]]:
    """Groups of columns side by side whose obstacles have feet side by side and about the same distance."""
    groups: list[list[int]] = []
    for column, here in columns.items():
        if groups and column - groups[-1][-1] <= GAP_CELLS:
            last = columns[groups[-1][-1]]
            if (
                abs(here.foot - last.foot) <= STEP_CELLS
                and 0.75 < here.inverse_depth / max(last.inverse_depth, 1e-6) < 4 / 3
            ):
                groups[-1].append(column)
                continue
        groups.append([column])
    return groups


def own_effects(
    region: NDArray[np.bool_], images: Sequence[NDArray[np.uint8]], evidence: Evidence
) -> NDArray[np.bool_]:
    """Components of a region through which the road is seen to move.

    Args:
        region: (H, W) bool, what may move.
        images: the last three, (H, W) uint8, grey, oldest first.
        evidence: of the last two.

    Returns:
        (H, W) bool.

    Source:
        Shizawa and Mase, Simultaneous multiple optical flow estimation, 1990: two transparent motions, one of them 0.
    """
    earlier, previous, current = (image.astype(np.float32) for image in images)
    now, before = current - previous, sampled(previous - earlier, evidence.road)
    now, before = now - box_mean(now, WINDOW_PX), before - box_mean(before, WINDOW_PX)
    moves = np.hypot(evidence.road[..., 0], evidence.road[..., 1]) > LEAST_ROAD_PX
    used = region & moves & (evidence.fall > BELOW_HORIZON) & ~evidence.edge
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=8)

    def summed(values: NDArray[np.float32]) -> NDArray[np.float64]:
        return np.bincount(labels[used], weights=values[used], minlength=count).astype(np.float64)

    pixels = np.bincount(labels[used], minlength=count)
    noise = pixels * evidence.noise**2 / 2
    seen_through = summed(now * before) > LEAST_CORRELATION * np.hypot(
        np.sqrt(summed(now * now) * summed(before * before)), noise
    )
    seen_through &= pixels > ON_ROAD * boxes[:, cv2.CC_STAT_AREA]
    seen_through[0] = False
    return np.asarray(seen_through[labels])


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
        weighted = deviation * weight[..., None]
        common, known = np.zeros_like(deviation), np.zeros(start.shape, dtype=bool)
        for side_px in REACH_PX:
            share = box_mean(weight, side_px)
            sums = box_mean(weighted, side_px)
            new = ~known & (share > LEAST_KNOWN)
            cv2.copyTo(cv2.divide(sums, cv2.merge([share, share])), new.view(np.uint8), common)
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


def find_candidates(
    evidence: Evidence,
    settings: ObjectSettings,
    *,
    images: Sequence[NDArray[np.uint8]] | None = None,
    slow_px: float = np.inf,
) -> Candidates:
    """Seeds and regions of objects.

    Args:
        evidence: of two images.
        settings: thresholds and switches.
        images: these two and the one before them, by which own shadow and light are left out; None to leave them in.
        slow_px: only what deviates by less is looked for.
    """
    deviation = evidence.flow - evidence.nearest
    usable = ~evidence.road_seen
    if np.isfinite(slow_px):
        usable &= np.hypot(deviation[..., 0], deviation[..., 1]) < slow_px
    likely = usable & (evidence.sigmas > settings.sigmas)
    seeds = likely & (box_mean(evidence.misfit, WINDOW_PX) > settings.misfit)
    blobs = _with_seeds(likely, seeds)
    hanging = np.zeros_like(blobs)
    if settings.floating > 0:
        cells = floating(evidence, at_most=settings.floating, calm_sigmas=2 * settings.sigmas)
        hanging = spread(cells, hanging.shape)
    region = _moving_together(deviation, blobs) & ~evidence.edge & ~evidence.road_seen
    sure = (region & (evidence.misfit > settings.mark)) | hanging
    region |= hanging
    seeds = (seeds & blobs) | hanging
    if images is not None:
        kept = ~own_effects(region, images, evidence)
        seeds, sure, region, hanging = seeds & kept, sure & kept, region & kept, hanging & kept
    standing = np.zeros_like(region)
    if settings.grow and evidence.moves:
        standing = _below_road(region, sure, evidence.too_low | hanging, evidence.fall > BELOW_HORIZON)
        grown = upright(evidence.scene, evidence.fall, standing, evidence.edge, height_m=settings.height_m)
        grown &= ~evidence.edge
        region, sure = region | grown, sure | grown
    return Candidates(seeds=seeds, sure=sure, region=region, standing=standing, floating=hanging)

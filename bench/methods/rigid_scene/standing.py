"""Objects that stand on the road: the foot gives the distance, and so the height, and whether it can be static."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.rigid_scene.evidence import BELOW_HORIZON, CELL, Evidence
from bench.methods.rigid_scene.scene import RigidScene, shortened

Mask = NDArray[np.bool_]
HIDDEN_PX = 4  # so near to the border of what is seen, a foot is cut off
NEAR_FEET = 1.35  # feet of one object lie at distances up to this factor apart
OBSTACLE_RATIO = 0.85  # a surface nearer than this share of the road behind it is an obstacle
CLEAR_SIGMAS = 4.0  # and its flow is so far from the road's
CLEAR_PX = 0.5
LEAST_COLUMNS = 5  # of cells, that an obstacle is wide
GROUNDED = 0.9  # of its columns have to float: wheels are at least a tenth of what is seen of a parked car
LOWER_CELLS = 10  # of an obstacle, from which its distance is taken
STEP_CELLS, GAP_CELLS = 4, 3  # from a sill to a wheel: rows between feet, columns between neighbours


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
    foot counts only where the road below it is seen to be the road: a wall in the dark begins above its foot.

    Args:
        evidence: of two images.
        at_most: distance of an obstacle over that of the road at its foot, below which it is not static.
        calm_sigmas: only what a rigid scene explains by itself is looked at.

    Returns:
        (H/2, W/2) bool.
    """
    found = np.zeros(evidence.inverse_depth.shape, dtype=bool)
    if not evidence.moves:
        return found
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
                found[rows, column] = obstacle[rows, column] & same
    return found


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
    found = {}
    last = len(obstacle) - 1
    per_px = evidence.from_road_sigmas / np.maximum(evidence.from_road_px, 1e-3)
    for column in np.flatnonzero(below.any(axis=0)).tolist():
        foot = int(np.flatnonzero(below[:, column])[-1])
        free = np.flatnonzero(~obstacle[:foot, column])
        top = int(free[-1]) + 1 if len(free) else 0
        lower, under = slice(max(foot - LOWER_CELLS, top), foot), slice(min(foot + 2, last), min(foot + 6, last + 1))
        if foot - top < 2 or evidence.edge[CELL][under, column].any():
            continue
        seen = _ranked(per_px[under, column], 0.5) * _ranked(evidence.from_road_px[lower, column], 0.5)
        if seen < CLEAR_SIGMAS:
            continue
        inverse_depth = _ranked(evidence.inverse_depth[lower, column], 0.8)
        ratio = float(road[min(foot + 1, last), column]) / max(inverse_depth, 1e-6)
        found[column] = _Column(top=top, foot=foot, ratio=ratio, inverse_depth=inverse_depth)
    return found


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

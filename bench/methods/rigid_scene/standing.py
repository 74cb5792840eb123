"""What stands on the road: its foot tells its distance, and so how high it reaches, and whether it can be static."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.rigid_scene.evidence import BELOW_HORIZON, CELL, Evidence
from bench.methods.rigid_scene.scene import RigidScene

Mask = NDArray[np.bool_]
HIDDEN_PX = 4  # so near to the border of what is seen, a foot is cut off
NEAR_FEET = 1.35  # feet of one object lie at distances up to this factor apart
OBSTACLE_RATIO = 0.85  # a surface nearer than this share of the road behind it is an obstacle
CLEAR_SIGMAS = 4.0  # and its flow is so far from the road's
CLEAR_PX = 0.5
LEAST_COLUMNS = 5  # of cells, that an obstacle is wide


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
        rays, _ = scene.camera.unproject(np.stack([u, v], axis=1).astype(np.float64))
        heads, seen = scene.camera.project(rays * reach[:, None] - height_m * scene.road.down)
        for k in np.flatnonzero((np.diff(u) <= 2) & seen[:-1] & seen[1:]):
            corners = np.array([[u[k], v[k]], [u[k + 1], v[k + 1]], heads[k + 1], heads[k]])
            cv2.fillConvexPoly(filled, np.rint(corners).astype(np.int32), 1)
    return filled > 0


def floating(evidence: Evidence, *, at_most: float, calm_sigmas: float) -> Mask:
    """Obstacles that, if they were static, would hang in the air above the road where they begin.

    A static obstacle stands on the road: at its foot it is as far away as the road. What comes towards the ego vehicle
    looks nearer than it is, by the ratio of the ego vehicle's speed to the sum of both; the road below its wheels
    does not. Parked cars have ground clearance, but wheels, too: a column of the image counts with its neighbours.

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
    road = np.maximum(fall, 0) / evidence.scene.road.height_m
    obstacle = road < OBSTACLE_RATIO * evidence.inverse_depth
    obstacle &= (evidence.from_road_sigmas > CLEAR_SIGMAS) & (evidence.from_road_px > CLEAR_PX)
    obstacle &= (evidence.sigmas[CELL] < calm_sigmas) & ~evidence.edge[CELL]
    obstacle = cv2.morphologyEx(obstacle.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0
    columns = _columns(obstacle, obstacle & (fall > 1.5 * BELOW_HORIZON), evidence.inverse_depth, road)
    for group in _neighbours(columns):
        ratios = [columns[column][2] for column in group]
        if len(group) >= LEAST_COLUMNS and np.quantile(ratios, 0.8) < at_most:
            for column in group:
                top, foot, _, depth = columns[column]
                rows = slice(top, foot + 1)
                same = np.abs(evidence.inverse_depth[rows, column] / depth - 1) < 0.5
                found[rows, column] = obstacle[rows, column] & same
    return found


def _columns(
    obstacle: Mask, below: Mask, inverse_depth: NDArray[np.floating], road: NDArray[np.floating]
) -> dict[int, tuple[int, int, float, float]]:
    """By column: first and last row of the lowest obstacle, ratio of its distance to the road's, and inverse depth."""
    found = {}
    last_row = len(obstacle) - 1
    for column in np.flatnonzero(below.any(axis=0)).tolist():
        foot = int(np.flatnonzero(below[:, column])[-1])
        free = np.flatnonzero(~obstacle[:foot, column])
        top = int(free[-1]) + 1 if len(free) else 0
        if foot - top < 2:
            continue
        depth = float(np.median(inverse_depth[max(foot - 5, top) : foot, column]))
        found[column] = top, foot, float(road[min(foot + 1, last_row), column]) / max(depth, 1e-6), depth
    return found


def _neighbours(columns: dict[int, tuple[int, int, float, float]]) -> list[list[int]]:
    """Groups of adjacent columns whose obstacles have feet side by side and about the same distance."""
    groups: list[list[int]] = []
    for column, (_, foot, _, depth) in columns.items():
        if groups and groups[-1][-1] == column - 1:
            _, last_foot, _, last_depth = columns[column - 1]
            if abs(foot - last_foot) <= 2 and 0.75 < depth / max(last_depth, 1e-6) < 4 / 3:
                groups[-1].append(column)
                continue
        groups.append([column])
    return groups

"""Motion blur: every pixel is the mean of the picture along the way that it moves while the shutter is open."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import compiled, looped
from bench.synthesis.imaging.shading import NOTHING

LEAST_PX = 0.3  # shorter ways change nothing that can be seen
MOST_TAPS = 16


class Shutter(NamedTuple):
    """Where everything is when the shutter opens and when it closes.

    Attributes:
        turns: (2, 3, 3) float64, camera from world, at opening and closing.
        origins_m: (2, 3) float64, the camera in the world.
        first: the first triangle that moves; those before it stand.
        corners_m: (2, M, 3, 3) float64, the moving triangles, world.
    """

    turns: NDArray[np.float64]
    origins_m: NDArray[np.float64]
    first: int
    corners_m: NDArray[np.float64]


@looped
def image_ways(
    triangles: NDArray[np.int32],
    valid: NDArray[np.bool_],
    rays: NDArray[np.float32],
    across: NDArray[np.float32],
    planes: NDArray[np.float32],
    turn: NDArray[np.float64],
    origin: NDArray[np.float64],
    shutter: Shutter,
    ways: NDArray[np.float32],
    place: NDArray[np.float64],
    moved: NDArray[np.float64],
) -> None:
    """How far what each pixel sees moves in the image while the shutter is open.

    Args:
        triangles: (H, W).
        valid: (H, W).
        rays: (3, H, W), camera frame.
        across: (H, W, 2, 3), see `Lens`.
        planes: (T, 9), see `visibility`.
        turn: (3, 3), world from camera, in the middle of the exposure.
        origin: (3,), m, the camera in the world, in the middle of the exposure.
        shutter: before and after.
        ways: (H, W, 2), px, (u, v), filled.
        place: (2, 3), room to work in.
        moved: (2, 3), room to work in.
    """
    height, width = triangles.shape
    for v in range(height):
        for u in range(width):
            ways[v, u, 0] = ways[v, u, 1] = 0.0
            if not valid[v, u]:
                continue
            x, y, z = rays[0, v, u], rays[1, v, u], rays[2, v, u]
            t = triangles[v, u]
            if t < shutter.first:
                distance = 1e6  # of the sky
                if t != NOTHING:
                    near = (planes[t, 0] + planes[t, 3] + planes[t, 6]) * x
                    near += (planes[t, 1] + planes[t, 4] + planes[t, 7]) * y
                    near += (planes[t, 2] + planes[t, 5] + planes[t, 8]) * z
                    distance = 1.0 / near
                for i in range(3):
                    along = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
                    place[0, i] = place[1, i] = origin[i] + distance * along
            else:
                a = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
                b = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
                c = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
                whole = a + b + c
                a, b, c = a / whole, b / whole, c / whole
                m = t - shutter.first
                for when in range(2):
                    for i in range(3):
                        place[when, i] = (
                            a * shutter.corners_m[when, m, 0, i]
                            + b * shutter.corners_m[when, m, 1, i]
                            + c * shutter.corners_m[when, m, 2, i]
                        )
            for when in range(2):
                dx = place[when, 0] - shutter.origins_m[when, 0]
                dy = place[when, 1] - shutter.origins_m[when, 1]
                dz = place[when, 2] - shutter.origins_m[when, 2]
                size = 1.0 / np.sqrt(dx * dx + dy * dy + dz * dz)
                for i in range(3):
                    turned = shutter.turns[when, i, 0] * dx + shutter.turns[when, i, 1] * dy
                    moved[when, i] = size * (turned + shutter.turns[when, i, 2] * dz)
            for i in range(3):
                step = moved[1, i] - moved[0, i]
                ways[v, u, 0] += across[v, u, 0, i] * step
                ways[v, u, 1] += across[v, u, 1, i] * step


@compiled
def blurred(grey: NDArray[np.float32], ways: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The mean along the ways, half of it before and half of it after, in steps of at most a pixel."""
    height, width = grey.shape
    image = grey.copy()
    for v in range(height):
        for u in range(width):
            way_u, way_v = ways[v, u, 0], ways[v, u, 1]
            length = np.sqrt(way_u * way_u + way_v * way_v)
            if not valid[v, u] or length < LEAST_PX:
                continue
            taps = min(int(length) + 2, MOST_TAPS)
            total, whole = 0.0, 0.0
            for tap in range(taps):
                share = (tap + 0.5) / taps - 0.5
                column, row = u + share * way_u, v + share * way_v
                if not (0 <= column < width - 1 and 0 <= row < height - 1):
                    continue
                i, j = int(row), int(column)
                if not (valid[i, j] and valid[i, j + 1] and valid[i + 1, j] and valid[i + 1, j + 1]):
                    continue
                a, b = row - i, column - j
                upper = grey[i, j] + b * (grey[i, j + 1] - grey[i, j])
                lower = grey[i + 1, j] + b * (grey[i + 1, j + 1] - grey[i + 1, j])
                total += upper + a * (lower - upper)
                whole += 1.0
            if whole > 0:
                image[v, u] = total / whole
    return image

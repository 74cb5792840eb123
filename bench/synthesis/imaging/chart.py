"""A table of the pixel of every direction: quick for any camera model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel
from bench.synthesis.imaging.compiled import inlined, looped

CHART = 513  # nodes along a side of the chart of all directions; odd, so that the chart's creases fall on nodes


def direction_chart(camera: CameraModel) -> NDArray[np.float32]:
    """The pixel of every direction, on the unfolded octahedron.

    A direction d with |x| + |y| + |z| = 1 lies at (x, y) of the square where z >= 0; the other half is folded outwards,
    x' = (1 - |y|) sign(x), y' = (1 - |x|) sign(y).

    Returns:
        (CHART, CHART, 2) float32, px, (u, v), rows along y'; NaN where the lens does not see.

    Source:
        Meyer et al. 2010, On floating-point normal vectors.
    """
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, CHART)])
    z = 1.0 - np.abs(x) - np.abs(y)
    folded = z < 0
    flat_x = np.where(folded, (1.0 - np.abs(y)) * np.where(x < 0, -1.0, 1.0), x)
    flat_y = np.where(folded, (1.0 - np.abs(x)) * np.where(y < 0, -1.0, 1.0), y)
    pixels, valid = camera.project(np.stack([flat_x, flat_y, z], axis=-1).reshape(-1, 3))
    return np.where(valid[:, None], pixels, np.nan).reshape(CHART, CHART, 2).astype(np.float32)


@inlined
def chart_pixel(x: float, y: float, z: float, chart: NDArray[np.float32]) -> tuple[float, float]:
    """The pixel of a direction, NaN where the lens does not see it."""
    size = abs(x) + abs(y) + abs(z)
    p, q = x / size, y / size
    if z < 0:
        p, q = (1.0 - abs(q)) * (-1.0 if p < 0 else 1.0), (1.0 - abs(p)) * (-1.0 if q < 0 else 1.0)
    half = (CHART - 1) / 2
    column, row = (p + 1.0) * half, (q + 1.0) * half
    i, j = min(int(row), CHART - 2), min(int(column), CHART - 2)
    a, b = row - i, column - j
    u = (1 - a) * ((1 - b) * chart[i, j, 0] + b * chart[i, j + 1, 0]) + a * (
        (1 - b) * chart[i + 1, j, 0] + b * chart[i + 1, j + 1, 0]
    )
    v = (1 - a) * ((1 - b) * chart[i, j, 1] + b * chart[i, j + 1, 1]) + a * (
        (1 - b) * chart[i + 1, j, 1] + b * chart[i + 1, j + 1, 1]
    )
    return u, v


@looped
def chart_error_px(chart: NDArray[np.float32], rays: NDArray[np.float32], valid: NDArray[np.bool_]) -> float:
    """How far the chart is off at most, over all pixels of an image, in u or v.

    Args:
        chart: see `direction_chart`.
        rays: (3, H, W), camera frame.
        valid: (H, W), where there is a ray.
    """
    height, width = valid.shape
    worst = 0.0
    for row in range(height):
        for column in range(width):
            if valid[row, column]:
                u, v = chart_pixel(rays[0, row, column], rays[1, row, column], rays[2, row, column], chart)
                if u == u:  # beside what the lens does not see, the chart says nothing
                    worst = max(worst, abs(u - column), abs(v - row))
    return worst

"""Smooth edges: where a pixel's neighbours see something else, its value is the mean over its four quarters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import inlined, looped
from bench.synthesis.imaging.faces import PLAIN
from bench.synthesis.imaging.visibility import NOTHING

EDGE_STEP = np.float32(0.03)  # of white, between neighbours without texture: an edge worth four rays
SKY_PLAIN = np.float32(2.0)
ZERO, QUARTER = np.float32(0.0), np.float32(0.25)


@looped
def smooth_edges(
    triangles: NDArray[np.int32],
    valid: NDArray[np.bool_],
    rays: NDArray[np.float32],
    along_u: NDArray[np.float32],
    along_v: NDArray[np.float32],
    planes: NDArray[np.float32],
    rows: NDArray[np.float32],
    centre: NDArray[np.float32],
    grey: NDArray[np.float32],
) -> None:
    """Mean over a pixel's quarters, where its neighbours see something else.

    Each quarter sees the nearest of the triangles that the pixel and the three neighbours next to the quarter see, and
    has the grey value that the centre of the pixel has that sees it.

    Args:
        triangles: (H, W).
        valid: (H, W).
        rays: (3, H, W).
        along_u: (H, W, 3), change of the ray to the right.
        along_v: (H, W, 3), downwards.
        planes: (T, 16), see `planes`.
        rows: (T, 16), see `faces`.
        centre: (H, W), what the centres see.
        grey: (H, W), filled.
    """
    height, width = grey.shape
    for v in range(height):
        for u in range(width):
            grey[v, u] = centre[v, u]
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            if not _on_edge(v, u, triangles, rows) or not valid[v, u]:
                continue
            total, whole, own = ZERO, ZERO, triangles[v, u]
            for quarter in range(4):
                step_u, step_v = (1 if quarter & 1 else -1), (1 if quarter & 2 else -1)
                du, dv = QUARTER * np.float32(step_u), QUARTER * np.float32(step_v)
                x = rays[0, v, u] + du * along_u[v, u, 0] + dv * along_v[v, u, 0]
                y = rays[1, v, u] + du * along_u[v, u, 1] + dv * along_v[v, u, 1]
                z = rays[2, v, u] + du * along_u[v, u, 2] + dv * along_v[v, u, 2]
                nearest, value, found = ZERO, ZERO, False
                for candidate in range(4):
                    row = v + step_v if candidate & 2 else v
                    column = u + step_u if candidate & 1 else u
                    t = triangles[row, column]
                    if (candidate > 0 and t == own) or not valid[row, column]:
                        continue
                    if t == NOTHING:
                        if not found:
                            value, found = centre[row, column], True
                        continue
                    i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
                    j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
                    k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
                    if i >= ZERO and j >= ZERO and k >= ZERO and i + j + k > nearest:
                        nearest, value, found = i + j + k, centre[row, column], True
                if found:  # and not between triangles that no centre sees
                    total += value
                    whole += np.float32(1.0)
            if whole > ZERO:
                grey[v, u] = total / whole


@inlined
def _on_edge(v: int, u: int, triangles: NDArray[np.int32], rows: NDArray[np.float32]) -> bool:
    """Whether a pixel and one of its four neighbours see faces of different brightness."""
    t = triangles[v, u]
    if triangles[v - 1, u] == t and triangles[v + 1, u] == t and triangles[v, u - 1] == t and triangles[v, u + 1] == t:
        return False
    plain = _plain(t, rows)
    return bool(
        abs(_plain(triangles[v - 1, u], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v + 1, u], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v, u - 1], rows) - plain) > EDGE_STEP
        or abs(_plain(triangles[v, u + 1], rows) - plain) > EDGE_STEP
    )


@inlined
def _plain(t: int, rows: NDArray[np.float32]) -> np.float32:
    return SKY_PLAIN if t == NOTHING else rows[t, PLAIN]

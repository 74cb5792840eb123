"""Motion blur: every pixel is the mean of the picture along the way that it moves while the shutter is open.

What lies at r / near, r a ray of unit length, is seen along A r + near b at another time, up to its length, with A the
camera's turn and b its way. Between the opening and the closing of the shutter the ray hence changes by D r + near e.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import looped

LEAST_PX = np.float32(0.3)  # shorter ways change nothing that can be seen
MOST_PX = np.float32(24.0)  # longer ways are cut
# What is nearer than a pixel by this share and 1 / m, and does not itself move that far, stays out of the pixel's mean.
NEARER_SHARE, NEARER = np.float32(1.05), np.float32(0.02)
ZERO, HALF, ONE, INFINITE = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(np.inf)


class Shutter(NamedTuple):
    """How everything moves in the camera frame while the shutter is open.

    Attributes:
        turn: (3, 3) float32, D above, of what stands.
        way: (3,) float32, m, e above.
        first: the first triangle that moves; those before it stand.
        steps_m: (M, 3, 3) float32, the change of the corners of the triangles that move, m.
    """

    turn: NDArray[np.float32]
    way: NDArray[np.float32]
    first: int
    steps_m: NDArray[np.float32]


@looped
def image_ways(
    triangles: NDArray[np.int32],
    nearness: NDArray[np.float32],
    rays: NDArray[np.float32],
    across: NDArray[np.float32],
    planes: NDArray[np.float32],
    shutter: Shutter,
    ways: NDArray[np.float32],
) -> None:
    """How far what each pixel sees moves in the image while the shutter is open.

    Args:
        triangles: (H, W).
        nearness: (H, W), 1 / m.
        rays: (3, H, W), camera frame; 0 where the lens sees nothing.
        across: (2, 3, H, W), see `Lens`.
        planes: (T, 16), see `planes`.
        shutter: what moves how.
        ways: (2, H, W), px, (u, v), filled.
    """
    height, width = triangles.shape
    turn, way = shutter.turn, shutter.way
    xx, xy, xz, yx, yy, yz = turn[0, 0], turn[0, 1], turn[0, 2], turn[1, 0], turn[1, 1], turn[1, 2]
    zx, zy, zz, ex, ey, ez = turn[2, 0], turn[2, 1], turn[2, 2], way[0], way[1], way[2]
    for v in range(height):
        for u in range(width):
            x, y, z, near = rays[0, v, u], rays[1, v, u], rays[2, v, u], nearness[v, u]
            dx = xx * x + xy * y + xz * z + near * ex
            dy = yx * x + yy * y + yz * z + near * ey
            dz = zx * x + zy * y + zz * z + near * ez
            ways[0, v, u] = across[0, 0, v, u] * dx + across[0, 1, v, u] * dy + across[0, 2, v, u] * dz
            ways[1, v, u] = across[1, 0, v, u] * dx + across[1, 1, v, u] * dy + across[1, 2, v, u] * dz
        for u in range(width):
            t = triangles[v, u]
            if t < shutter.first:
                continue
            x, y, z, m = rays[0, v, u], rays[1, v, u], rays[2, v, u], t - shutter.first
            i = planes[t, 0] * x + planes[t, 1] * y + planes[t, 2] * z
            j = planes[t, 3] * x + planes[t, 4] * y + planes[t, 5] * z
            k = planes[t, 6] * x + planes[t, 7] * y + planes[t, 8] * z
            way_u, way_v = ZERO, ZERO
            for axis in range(3):
                step = i * shutter.steps_m[m, 0, axis] + j * shutter.steps_m[m, 1, axis]
                step += k * shutter.steps_m[m, 2, axis]
                way_u += across[0, axis, v, u] * step
                way_v += across[1, axis, v, u] * step
            ways[0, v, u], ways[1, v, u] = way_u, way_v


def blur(
    grey: NDArray[np.float32],
    ways: NDArray[np.float32],
    nearness: NDArray[np.float32],
    valid: NDArray[np.bool_],
    blurred: NDArray[np.float32],
) -> None:
    """The mean along the ways, half of it before and half of it after.

    Along its longer axis a way steps from pixel to pixel, across it the picture is interpolated, and in between the
    mean is the integral of a straight line.

    Args:
        grey: (H, W).
        ways: (2, H, W), px.
        nearness: (H, W), 1 / m.
        valid: (H, W), where the lens sees anything.
        blurred: (H, W), contiguous, filled.
    """
    # What the lens does not see counts as nearer than anything: one comparison lets nearly every pixel into a mean.
    near = np.where(valid, nearness, INFINITE)
    height, width = grey.shape
    _blur(grey.ravel(), ways.reshape(2, -1), near.ravel(), height, width, blurred.reshape(-1))


@looped
def _blur(
    grey: NDArray[np.float32],
    ways: NDArray[np.float32],
    nearness: NDArray[np.float32],
    height: int,
    width: int,
    blurred: NDArray[np.float32],
) -> None:
    """The same with all rows behind each other, (H * W,), so that steps along and across are steps in one index.

    Where the lens sees nothing, the nearness is infinite.
    """
    for v in range(height):
        for u in range(width):
            here = np.uintp(v * width + u)
            way_u, way_v, own = ways[0, here], ways[1, here], grey[here]
            blurred[here] = own
            if way_u * way_u + way_v * way_v < LEAST_PX * LEAST_PX:
                continue
            if nearness[here] == INFINITE:
                continue
            flat = abs(way_u) >= abs(way_v)
            longer, shorter = (way_u, way_v) if flat else (way_v, way_u)
            slope, reach = shorter / longer, min(HALF * abs(longer), HALF * MOST_PX)
            steps = int(reach)
            part = reach - np.float32(steps)
            last, outermost = part - HALF * part * part, HALF * part * part
            place, edge, stride = (u, width, 1) if flat else (v, height, width)
            aside, side, across = (np.float32(v), height, width) if flat else (np.float32(u), width, 1)
            axis = np.uintp(0 if flat else 1)
            limit, furthest = nearness[here] * NEARER_SHARE + NEARER, np.float32(side - 1)
            whole = ONE if steps > 0 else last + last
            total = whole * own
            for n in range(1, steps + 2):
                weight = ONE if n < steps else (HALF + last if n == steps else outermost)
                short = np.float32(n) - HALF
                for sign in (-1, 1):
                    at, beside = place + sign * n, aside + np.float32(sign * n) * slope
                    if not (0 <= at < edge and ZERO <= beside < furthest):
                        continue
                    low = int(beside)
                    share = beside - np.float32(low)
                    one = np.uintp(at * stride + low * across)
                    other = one + np.uintp(across)
                    if nearness[one] > limit and (nearness[one] == INFINITE or abs(ways[axis, one]) * HALF < short):
                        continue
                    if nearness[other] > limit and (
                        nearness[other] == INFINITE or abs(ways[axis, other]) * HALF < short
                    ):
                        continue
                    a, b = grey[one], grey[other]
                    total += weight * (a + share * (b - a))
                    whole += weight
            blurred[here] = total / whole

"""From the grey values at pixel centres to those read out: anti-aliasing, motion blur, vignetting and noise.

Anti-aliasing: where a pixel's neighbours see something else, its value is the mean over its four quarters.

Motion blur: every pixel is the mean of the picture along the path that it moves while the shutter is open. What lies at
r / inverse_depth, r a ray of unit length, is seen along A r + inverse_depth b at another time, up to its length, with A
the camera's rotation and b its translation. Between the opening and the closing of the shutter the ray hence changes by
D r + inverse_depth e.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled, inlined
from bench.synthesis.imaging.faces import PLAIN, corner_weights, rows_of
from bench.synthesis.imaging.visibility import NOTHING, Lens
from bench.synthesis.scenario import SensorSpec

LEAST_PX = np.float32(0.3)  # shorter motion vectors change nothing that can be seen
MOST_PX = np.float32(24.0)  # longer ones are cut
# What is nearer than a pixel by this share and 1 / m, and does not itself move that far, stays out of the pixel's mean.
NEARER_SHARE, NEARER = np.float32(1.05), np.float32(0.02)
ZERO, HALF, ONE, INFINITE = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(np.inf)


class Shutter(NamedTuple):
    """Motion of everything in the camera frame while the shutter is open.

    Attributes:
        rotation: (3, 3) float32, D above, of what is stationary.
        translation: (3,) float32, m, e above.
        first: the first triangle that moves; those before it are stationary.
        steps_m: (M, 3, 3) float32, the change of the corners of the triangles that move, m.
    """

    rotation: NDArray[np.float32]
    translation: NDArray[np.float32]
    first: int
    steps_m: NDArray[np.float32]


@compiled
def find_motion_vectors(
    triangles: NDArray[np.int32],
    inverse_depth: NDArray[np.float32],
    rays: NDArray[np.float32],
    across: NDArray[np.float32],
    planes: NDArray[np.float32],
    shutter: Shutter,
    motion_vectors: NDArray[np.float32],
) -> None:
    """Motion in the image, while the shutter is open, of what each pixel sees.

    Args:
        triangles: (H, W).
        inverse_depth: (H, W), 1 / m.
        rays: (3, H, W), camera frame; 0 where the lens sees nothing.
        across: (2, 3, H, W), see `Lens`.
        planes: (T, 16), see `planes`.
        shutter: what moves how.
        motion_vectors: (2, H, W), px, (u, v), filled.
    """
    height, width = triangles.shape
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rows_of(shutter.rotation)
    ex, ey, ez = shutter.translation[0], shutter.translation[1], shutter.translation[2]
    for v in range(height):
        for u in range(width):
            x, y, z, near = rays[0, v, u], rays[1, v, u], rays[2, v, u], inverse_depth[v, u]
            dx = xx * x + xy * y + xz * z + near * ex
            dy = yx * x + yy * y + yz * z + near * ey
            dz = zx * x + zy * y + zz * z + near * ez
            motion_vectors[0, v, u] = across[0, 0, v, u] * dx + across[0, 1, v, u] * dy + across[0, 2, v, u] * dz
            motion_vectors[1, v, u] = across[1, 0, v, u] * dx + across[1, 1, v, u] * dy + across[1, 2, v, u] * dz
        for u in range(width):
            t = triangles[v, u]
            if t < shutter.first:
                continue
            x, y, z, m = rays[0, v, u], rays[1, v, u], rays[2, v, u], t - shutter.first
            i, j, k = corner_weights(planes, t, x, y, z)
            motion_u, motion_v = ZERO, ZERO
            for axis in range(3):
                step = i * shutter.steps_m[m, 0, axis] + j * shutter.steps_m[m, 1, axis]
                step += k * shutter.steps_m[m, 2, axis]
                motion_u += across[0, axis, v, u] * step
                motion_v += across[1, axis, v, u] * step
            motion_vectors[0, v, u], motion_vectors[1, v, u] = motion_u, motion_v


def blur(
    grey: NDArray[np.float32],
    motion_vectors: NDArray[np.float32],
    inverse_depth: NDArray[np.float32],
    valid: NDArray[np.bool_],
    blurred: NDArray[np.float32],
) -> None:
    """The mean along the motion vectors, half of it before and half of it after.

    Along its longer axis a motion vector steps from pixel to pixel, across it the picture is interpolated, and in
    between the mean is the integral of a straight line.

    Args:
        grey: (H, W).
        motion_vectors: (2, H, W), px.
        inverse_depth: (H, W), 1 / m.
        valid: (H, W), where the lens sees anything.
        blurred: (H, W), contiguous, filled.
    """
    # What the lens does not see counts as nearer than anything: one comparison lets nearly every pixel into a mean.
    near = np.where(valid, inverse_depth, INFINITE)
    height, width = grey.shape
    _blur(grey.ravel(), motion_vectors.reshape(2, -1), near.ravel(), height, width, blurred.reshape(-1))


@compiled
def _blur(
    grey: NDArray[np.float32],
    motion_vectors: NDArray[np.float32],
    inverse_depth: NDArray[np.float32],
    height: int,
    width: int,
    blurred: NDArray[np.float32],
) -> None:
    """Blur with all rows behind each other, (H * W,), so that steps along and across are steps in one index.

    Where the lens sees nothing, the inverse_depth is infinite.
    """
    for v in range(height):
        for u in range(width):
            here = np.uintp(v * width + u)
            motion_u, motion_v, own = motion_vectors[0, here], motion_vectors[1, here], grey[here]
            blurred[here] = own
            if motion_u * motion_u + motion_v * motion_v < LEAST_PX * LEAST_PX:
                continue
            if inverse_depth[here] == INFINITE:
                continue
            flat = abs(motion_u) >= abs(motion_v)
            longer, shorter = (motion_u, motion_v) if flat else (motion_v, motion_u)
            slope, reach = shorter / longer, min(HALF * abs(longer), HALF * MOST_PX)
            steps = int(reach)
            part = reach - np.float32(steps)
            last, outermost = part - HALF * part * part, HALF * part * part
            place, edge, stride = (u, width, 1) if flat else (v, height, width)
            aside, side, across = (np.float32(v), height, width) if flat else (np.float32(u), width, 1)
            axis = np.uintp(0 if flat else 1)
            limit, furthest = inverse_depth[here] * NEARER_SHARE + NEARER, np.float32(side - 1)
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
                    if inverse_depth[one] > limit and (
                        inverse_depth[one] == INFINITE or abs(motion_vectors[axis, one]) * HALF < short
                    ):
                        continue
                    if inverse_depth[other] > limit and (
                        inverse_depth[other] == INFINITE or abs(motion_vectors[axis, other]) * HALF < short
                    ):
                        continue
                    a, b = grey[one], grey[other]
                    total += weight * (a + share * (b - a))
                    whole += weight
            blurred[here] = total / whole


EDGE_STEP = np.float32(0.03)  # of white, between neighbours without texture: an edge worth four rays
SKY_PLAIN = np.float32(2.0)
QUARTER = np.float32(0.25)


@compiled
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
                    i, j, k = corner_weights(planes, t, x, y, z)
                    if i >= ZERO and j >= ZERO and k >= ZERO and i + j + k > nearest:
                        nearest, value, found = i + j + k, centre[row, column], True
                if found:  # and not between triangles that no centre sees
                    total += value
                    whole += np.float32(1.0)
            if whole > ZERO:
                grey[v, u] = total / whole


@inlined
def _on_edge(v: int, u: int, triangles: NDArray[np.int32], rows: NDArray[np.float32]) -> bool:
    """Mask of pixels that see another brightness than one of their four neighbours."""
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


WHITE = np.float32(255.0)


class Sensor:
    """The sensor behind a lens.

    Args:
        spec: what it does to the light.
        lens: before it.
        gain: of the recording; noise grows with it.
    """

    def __init__(self, spec: SensorSpec, lens: Lens, *, gain: float) -> None:
        angles = np.arccos(np.clip(lens.off_axis_cos, -1.0, 1.0)) / max(lens.projection.widest_rad, 1e-6)
        self._light = np.where(lens.valid, spec.edge_light ** (angles * angles), 0.0).astype(np.float32)
        self._read_variance = np.float32((spec.read_noise_grey * gain) ** 2)
        # N electrons vary by sqrt(N), and WHITE stands for full_well / gain of them.
        shot_variance = 0.0 if spec.full_well_electrons is None else 255.0 * gain / spec.full_well_electrons
        self._shot_variance = np.float32(shot_variance)

    def expose(self, grey: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the image that is read out, (H, W).

        Args:
            grey: (H, W), 1 is white.
            rng: the noise.
        """
        noise = rng.standard_normal(grey.shape, dtype=np.float32)
        signal = np.minimum(WHITE * grey * self._light, WHITE + WHITE)
        value = signal + noise * np.sqrt(self._read_variance + self._shot_variance * signal)
        return np.where(self._light > 0, np.clip(np.rint(value), 0, WHITE), 0).astype(np.uint8)

"""Triangles as a camera sees them: where in its image they lie, and the plane of each.

A ray r passes through a triangle with corners a, b, c, seen from the origin, where r = t (i a + j b + k c) with
i, j, k >= 0 and t > 0. With volume = a . (b x c), i, j and k are the products of r with (b x c), (c x a), (a x b) over
volume, up to the factor 1 / t that is their sum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import looped
from bench.synthesis.imaging.lens import chart_pixel

SMALL = 0.3  # chord of the longest edge on the unit sphere, of triangles that are looked for by their corners
BOW = 0.35  # rad of sagitta per rad^2 of edge length: straight edges bow in a fisheye image by less than this
HIDDEN, BIG = -1, -2  # first column of a triangle's box that is not seen, or not kept
# Columns of a triangle's plane, one cache line of 16 numbers: the three products above over the volume, then their sum,
# whose product with a ray is 1 over the distance, its length, and the lengths of the three.
NEAR_X, NEAR_Y, NEAR_Z, NEAR_SIZE, SIZES, COLUMNS = 9, 10, 11, 12, 13, 16
BUCKETS, KEPT_BITS = 4096, 20  # of a distance in single precision these bits say how early a triangle is drawn


@looped
def find_planes(
    corners: NDArray[np.float64],
    turn: NDArray[np.float64],
    origin: NDArray[np.float64],
    chart: NDArray[np.float32],
    chart_error_px: float,
    px_per_rad: float,
    widest_rad: float,
    reach_m: float,
    shape: tuple[int, int],
    planes: NDArray[np.float32],
    boxes: NDArray[np.int16],
    distances_m: NDArray[np.float32],
    seen: NDArray[np.float64],
) -> None:
    """Take triangles into the camera frame.

    Args:
        corners: (T, 3, 3), m, world.
        turn: (3, 3), camera from world.
        origin: (3,), m, the camera in the world.
        chart: see `direction_chart`.
        chart_error_px: how far it is off.
        px_per_rad: the largest there is.
        widest_rad: largest angle of a ray off the optical axis.
        reach_m: what looks small and lies further away is left out.
        shape: height and width of the image, px.
        planes: (T, 16), filled, columns as above.
        boxes: (T, 4), filled: first and last column, first and last row; or HIDDEN or BIG.
        distances_m: (T,), filled: of the nearest corner; where not hidden.
        seen: (3, 3), room to work in.
    """
    height, width = shape
    least_cos = np.cos(widest_rad)
    for t in range(len(corners)):
        boxes[t, 0] = HIDDEN
        inside = True
        low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
        for k in range(3):
            x, y, z = corners[t, k, 0] - origin[0], corners[t, k, 1] - origin[1], corners[t, k, 2] - origin[2]
            for i in range(3):
                seen[k, i] = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z
        ax, ay, az, bx, by, bz = seen[0, 0], seen[0, 1], seen[0, 2], seen[1, 0], seen[1, 1], seen[1, 2]
        cx, cy, cz = seen[2, 0], seen[2, 1], seen[2, 2]
        if least_cos > 0.0 and az <= 0.0 and bz <= 0.0 and cz <= 0.0:
            continue  # behind a lens that only looks ahead
        bcx, bcy, bcz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        volume = ax * bcx + ay * bcy + az * bcz
        if abs(volume) < 1e-12:
            continue  # seen edge on
        a, b, c = np.sqrt(ax**2 + ay**2 + az**2), np.sqrt(bx**2 + by**2 + bz**2), np.sqrt(cx**2 + cy**2 + cz**2)
        near = min((ax * bx + ay * by + az * bz) / (a * b), (bx * cx + by * cy + bz * cz) / (b * c))
        near = min(near, (cx * ax + cy * ay + cz * az) / (c * a))
        chord2 = 2.0 - 2.0 * near
        if chord2 < SMALL * SMALL:
            # All of the triangle lies within this angle of its first corner; half a tenth more than chord for arc. The
            # cosine of a sum is at least the cosine of one part, less the other part.
            if az < a * (least_cos - 1.05 * np.sqrt(max(chord2, 0.0))) or min(a, b, c) > reach_m:
                continue
            for k in range(3):
                u, v = chart_pixel(seen[k, 0], seen[k, 1], seen[k, 2], chart)
                inside = inside and u == u
                low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
            if inside:
                margin = chart_error_px + BOW * px_per_rad * chord2
                first_u, last_u = max(np.ceil(low_u - margin), 0), min(np.floor(high_u + margin), width - 1)
                first_v, last_v = max(np.ceil(low_v - margin), 0), min(np.floor(high_v + margin), height - 1)
                if first_u > last_u or first_v > last_v:
                    continue
                boxes[t, 0], boxes[t, 1], boxes[t, 2], boxes[t, 3] = first_u, last_u, first_v, last_v
            else:
                boxes[t, 0] = BIG
        else:
            boxes[t, 0] = BIG
        scale = 1.0 / volume
        planes[t, 0], planes[t, 1], planes[t, 2] = bcx * scale, bcy * scale, bcz * scale
        planes[t, 3] = (cy * az - cz * ay) * scale
        planes[t, 4] = (cz * ax - cx * az) * scale
        planes[t, 5] = (cx * ay - cy * ax) * scale
        planes[t, 6] = (ay * bz - az * by) * scale
        planes[t, 7] = (az * bx - ax * bz) * scale
        planes[t, 8] = (ax * by - ay * bx) * scale
        for i in range(3):
            planes[t, NEAR_X + i] = planes[t, i] + planes[t, 3 + i] + planes[t, 6 + i]
        for i in range(3):
            planes[t, SIZES + i] = np.sqrt(
                planes[t, 3 * i] ** 2 + planes[t, 3 * i + 1] ** 2 + planes[t, 3 * i + 2] ** 2
            )
        planes[t, NEAR_SIZE] = np.sqrt(planes[t, NEAR_X] ** 2 + planes[t, NEAR_Y] ** 2 + planes[t, NEAR_Z] ** 2)
        distances_m[t] = min(a, b, c)


@looped
def nearest_first(
    boxes: NDArray[np.int16],
    distance_bits: NDArray[np.int32],
    first: NDArray[np.int32],
    order: NDArray[np.int32],
) -> int:
    """Put triangles that are seen in order, roughly from near to far: what is hidden is then found early.

    Args:
        boxes: (T, 4), see `find_planes`.
        distance_bits: (T,), distances in single precision, read as whole numbers, which have the same order.
        first: (BUCKETS,), room to work in.
        order: (T,), filled.

    Returns:
        How many are seen.
    """
    first[:] = 0
    for t in range(len(boxes)):
        if boxes[t, 0] != HIDDEN:
            first[distance_bits[t] >> KEPT_BITS] += 1
    total = 0
    for bucket in range(BUCKETS):
        count = first[bucket]
        first[bucket] = total
        total += count
    for t in range(len(boxes)):
        if boxes[t, 0] != HIDDEN:
            bucket = distance_bits[t] >> KEPT_BITS
            order[first[bucket]] = t
            first[bucket] += 1
    return total

"""Which triangle each pixel sees: every triangle is drawn into the pixels whose rays pass through it.

A ray r passes through a triangle with corners a, b, c, seen from the origin, where r = t (i a + j b + k c) with
i, j, k >= 0 and t > 0. With volume = a . (b x c), i, j and k are the products of r with (b x c), (c x a), (a x b) over
volume, up to the factor 1 / t that is their sum. This holds for rays in any direction, so a fisheye image needs neither
an image plane nor a cut in front of the camera, and it is exact where a camera of straight lines would not be.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import compiled, inlined, looped
from bench.synthesis.imaging.lens import BLOCK_PX, CHART, REGION_PX, TILE_PX

SMALL = 0.3  # chord of the longest edge on the unit sphere, of triangles that are looked for by their corners
BOW = 0.35  # rad of sagitta per rad^2 of edge length: straight edges bow in a fisheye image by less than this
MARGIN_PX = 1.5  # the chart is a table
OUTSIDE, PARTLY, ALL_OVER = 0, 1, 2
SIMPLE_PX = 256  # boxes up to this area are drawn without looking at tiles
HIDDEN, BIG = -1, -2  # first column of a triangle's box that is not seen, or not kept


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


@compiled
def find_planes(
    corners: NDArray[np.float64],
    turn: NDArray[np.float64],
    origin: NDArray[np.float64],
    chart: NDArray[np.float32],
    px_per_rad: float,
    widest_rad: float,
    shape: tuple[int, int],
    planes: NDArray[np.float32],
    boxes: NDArray[np.int16],
) -> None:
    """Take triangles into the camera frame.

    Args:
        corners: (T, 3, 3), m, world.
        turn: (3, 3), camera from world.
        origin: (3,), m, the camera in the world.
        chart: see `direction_chart`.
        px_per_rad: the largest there is.
        widest_rad: largest angle of a ray off the optical axis.
        shape: height and width of the image, px.
        planes: (T, 9), filled: the three products above over the volume.
        boxes: (T, 4), filled: first and last column, first and last row; or HIDDEN or BIG.
    """
    height, width = shape
    seen = np.empty((3, 3))
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
        bcx, bcy, bcz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        volume = ax * bcx + ay * bcy + az * bcz
        if abs(volume) < 1e-12:
            continue  # seen edge on
        a, b, c = np.sqrt(ax**2 + ay**2 + az**2), np.sqrt(bx**2 + by**2 + bz**2), np.sqrt(cx**2 + cy**2 + cz**2)
        near = min((ax * bx + ay * by + az * bz) / (a * b), (bx * cx + by * cy + bz * cz) / (b * c))
        near = min(near, (cx * ax + cy * ay + cz * az) / (c * a))
        chord2 = 2.0 - 2.0 * near
        if chord2 < SMALL * SMALL:
            # All of the triangle lies within this angle of its first corner; half a tenth more than chord for arc.
            beyond = widest_rad + 1.05 * np.sqrt(max(chord2, 0.0))
            if beyond < np.pi and az < a * np.cos(beyond):
                continue
            for k in range(3):
                u, v = chart_pixel(seen[k, 0], seen[k, 1], seen[k, 2], chart)
                inside = inside and u == u
                low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
            if inside:
                margin = MARGIN_PX + BOW * px_per_rad * chord2
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


@inlined
def _overlap(planes: NDArray[np.float32], t: int, cones: NDArray[np.float32], v: int, u: int) -> int:
    """How a triangle lies to a cone: OUTSIDE if the cone lies beyond an edge, ALL_OVER if within every one."""
    cosine, sine = cones[v, u, 3], cones[v, u, 4]
    if cosine > 1.0:
        return OUTSIDE
    if cosine <= 0.0:
        return PARTLY
    overlap = ALL_OVER
    for k in range(0, 9, 3):
        x, y, z = planes[t, k], planes[t, k + 1], planes[t, k + 2]
        product = x * cones[v, u, 0] + y * cones[v, u, 1] + z * cones[v, u, 2]
        if product * product <= (x * x + y * y + z * z) * sine * sine:
            overlap = PARTLY
        elif product < 0.0:
            return OUTSIDE
    return overlap


@inlined
def _draw_box(
    t: int,
    planes: NDArray[np.float32],
    first_u: int,
    last_u: int,
    first_v: int,
    last_v: int,
    rays: NDArray[np.float32],
    nearness: NDArray[np.float32],
    triangles: NDArray[np.int32],
) -> None:
    ax, ay, az, bx, by, bz = planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3], planes[t, 4], planes[t, 5]
    cx, cy, cz = planes[t, 6], planes[t, 7], planes[t, 8]
    zero, end_u, number = np.float32(0.0), last_u + 1, np.int32(t)
    for v in range(first_v, last_v + 1):
        xs, ys, zs = rays[0, v, first_u:end_u], rays[1, v, first_u:end_u], rays[2, v, first_u:end_u]
        row, ids = nearness[v, first_u:end_u], triangles[v, first_u:end_u]
        # Without branches, for the compiler to take several pixels at once.
        for u in range(len(xs)):
            x, y, z = xs[u], ys[u], zs[u]
            i = ax * x + ay * y + az * z
            j = bx * x + by * y + bz * z
            k = cx * x + cy * y + cz * z
            near = i + j + k
            hit = (i >= zero) & (j >= zero) & (k >= zero) & (near > row[u])
            row[u] = near if hit else row[u]
            ids[u] = number if hit else ids[u]


@inlined
def _draw_tile(
    t: int,
    planes: NDArray[np.float32],
    v: int,
    u: int,
    rays: NDArray[np.float32],
    tiles: NDArray[np.float32],
    nearness: NDArray[np.float32],
    triangles: NDArray[np.int32],
    farthest: NDArray[np.float32],
) -> None:
    """Draw into a tile, unless all that is seen there is nearer."""
    overlap = _overlap(planes, t, tiles, v, u)
    if overlap == OUTSIDE:
        return
    x = planes[t, 0] + planes[t, 3] + planes[t, 6]
    y = planes[t, 1] + planes[t, 4] + planes[t, 7]
    z = planes[t, 2] + planes[t, 5] + planes[t, 8]
    largest = x * tiles[v, u, 0] + y * tiles[v, u, 1] + z * tiles[v, u, 2]
    largest += np.sqrt(x * x + y * y + z * z) * tiles[v, u, 4]
    if largest < farthest[v, u]:
        return
    first_u, first_v = u * TILE_PX, v * TILE_PX
    end_u, end_v = min(first_u + TILE_PX, nearness.shape[1]), min(first_v + TILE_PX, nearness.shape[0])
    if overlap == PARTLY:
        _draw_box(t, planes, first_u, end_u - 1, first_v, end_v - 1, rays, nearness, triangles)
        return
    far = np.float32(np.inf)
    for row in range(first_v, end_v):
        xs, ys, zs = rays[0, row, first_u:end_u], rays[1, row, first_u:end_u], rays[2, row, first_u:end_u]
        near_row, ids = nearness[row, first_u:end_u], triangles[row, first_u:end_u]
        for column in range(len(xs)):
            near = x * xs[column] + y * ys[column] + z * zs[column]
            hit = near > near_row[column]
            near_row[column] = near if hit else near_row[column]
            ids[column] = np.int32(t) if hit else ids[column]
            far = min(far, near_row[column])
    farthest[v, u] = far


@looped
def draw(
    planes: NDArray[np.float32],
    boxes: NDArray[np.int16],
    rays: NDArray[np.float32],
    regions: NDArray[np.float32],
    blocks: NDArray[np.float32],
    tiles: NDArray[np.float32],
    nearness: NDArray[np.float32],
    triangles: NDArray[np.int32],
    farthest: NDArray[np.float32],
) -> None:
    """Draw triangles into an image.

    Args:
        planes: (T, 9), see `find_planes`.
        boxes: (T, 4).
        rays: (3, H, W).
        regions: cones, see `Lens`.
        blocks: cones.
        tiles: cones.
        nearness: (H, W), 1 / m, 1 over the distance of what is seen; 0 where there is nothing; changed.
        triangles: (H, W), row of what is seen; changed.
        farthest: (tiles), nearness of the farthest that is seen in each tile; changed.
    """
    up, per = REGION_PX // BLOCK_PX, BLOCK_PX // TILE_PX
    for t in range(len(planes)):
        left, right, top, bottom = boxes[t, 0], boxes[t, 1], boxes[t, 2], boxes[t, 3]
        if left == HIDDEN:
            continue
        if left != BIG:
            if (right - left + 1) * (bottom - top + 1) <= SIMPLE_PX:
                _draw_box(t, planes, left, right, top, bottom, rays, nearness, triangles)
                continue
            for v in range(top // TILE_PX, bottom // TILE_PX + 1):
                for u in range(left // TILE_PX, right // TILE_PX + 1):
                    _draw_tile(t, planes, v, u, rays, tiles, nearness, triangles, farthest)
            continue
        for region_v in range(regions.shape[0]):
            for region_u in range(regions.shape[1]):
                if _overlap(planes, t, regions, region_v, region_u) == OUTSIDE:
                    continue
                for block_v in range(region_v * up, min((region_v + 1) * up, blocks.shape[0])):
                    for block_u in range(region_u * up, min((region_u + 1) * up, blocks.shape[1])):
                        if _overlap(planes, t, blocks, block_v, block_u) == OUTSIDE:
                            continue
                        for v in range(block_v * per, min((block_v + 1) * per, tiles.shape[0])):
                            for u in range(block_u * per, min((block_u + 1) * per, tiles.shape[1])):
                                _draw_tile(t, planes, v, u, rays, tiles, nearness, triangles, farthest)

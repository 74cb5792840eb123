"""Triangle that each pixel sees: every triangle is drawn into the pixels whose rays pass through it.

This holds for rays in any direction, so a fisheye image needs neither an image plane nor a cut in front of the camera,
and it is exact where a camera of straight lines would not be.

A ray r passes through a triangle with corners a, b, c, seen from the origin, where r = t (i a + j b + k c) with
i, j, k >= 0 and t > 0. With volume = a . (b x c), i, j and k are the products of r with (b x c), (c x a), (a x b) over
volume, up to the factor 1 / t that is their sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.machine_code import compiled, inlined
from bench.synthesis.imaging.lens import BLOCK_PX, REGION_PX, TILE_PX, Lens, chart_pixel

SMALL = 0.3  # chord of the longest edge on the unit sphere, of triangles that are looked for by their corners
BOW = 0.35  # rad of sagitta per rad^2 of edge length: straight edges bow in a fisheye image by less than this
HIDDEN, BIG = -1, -2  # first column of a triangle's box that is not seen, or not known
# Columns of a triangle's plane, one cache line of 16 numbers: the three products above over the volume, then their sum,
# whose product with a ray is 1 over the distance, its length, and the lengths of the three.
NEAR_X, NEAR_Y, NEAR_Z, NEAR_SIZE, SIZES, COLUMNS = 9, 10, 11, 12, 13, 16
DROPPED_BITS = 20  # of a distance in single precision; the others say how early a triangle is drawn


@compiled
def find_planes(
    corners: NDArray[np.float64],
    camera_from_world: NDArray[np.float64],
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
        camera_from_world: (3, 3), rotation.
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
        seen: (3, 3), scratch space.
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
                seen[k, i] = camera_from_world[i, 0] * x + camera_from_world[i, 1] * y + camera_from_world[i, 2] * z
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


@compiled
def draw(
    planes: NDArray[np.float32],
    boxes: NDArray[np.int16],
    order: NDArray[np.int32],
    rays: NDArray[np.float32],
    regions: NDArray[np.float32],
    blocks: NDArray[np.float32],
    tiles: NDArray[np.float32],
    inverse_depth_bits: NDArray[np.int32],
    triangles: NDArray[np.int32],
    farthest: NDArray[np.float32],
    farthest_bits: NDArray[np.int32],
    changed: NDArray[np.bool_],
) -> None:
    """Draw triangles into an image.

    Args:
        planes: (T, 16), see `find_planes`.
        boxes: (T, 4).
        order: (S,), in which to draw.
        rays: see `Lens.tile_rays`.
        regions: cones, see `Lens`.
        blocks: cones.
        tiles: cones.
        inverse_depth_bits: (H / 8, W / 8, 64), 1 / m, 1 over the distance of what is seen; 0 where there is nothing; in
            single precision, read as whole numbers, whose order is the same; changed.
        triangles: (H / 8, W / 8, 64), row of what is seen; changed.
        farthest: (H / 8, W / 8), at most the inverse_depth of all that is seen in each tile; changed.
        farthest_bits: the same memory.
        changed: (H / 8, W / 8), tiles that were drawn into since `farthest` was found; changed.
    """
    up, per = REGION_PX // BLOCK_PX, BLOCK_PX // TILE_PX
    for n in range(len(order)):
        t = order[n]
        left, right, top, bottom = boxes[t, 0], boxes[t, 1], boxes[t, 2], boxes[t, 3]
        if left != BIG:
            for v in range(top // TILE_PX, bottom // TILE_PX + 1):
                for u in range(left // TILE_PX, right // TILE_PX + 1):
                    _draw_tile(
                        t, planes, v, u, rays, tiles, inverse_depth_bits, triangles, farthest, farthest_bits,
                        changed,
                    )  # fmt: skip
            continue
        for region_v in range(regions.shape[0]):
            for region_u in range(regions.shape[1]):
                if _outside(planes, t, regions, region_v, region_u):
                    continue
                for block_v in range(region_v * up, min((region_v + 1) * up, blocks.shape[0])):
                    for block_u in range(region_u * up, min((region_u + 1) * up, blocks.shape[1])):
                        if _outside(planes, t, blocks, block_v, block_u):
                            continue
                        last_v, last_u = (
                            min((block_v + 1) * per, tiles.shape[0]),
                            min((block_u + 1) * per, tiles.shape[1]),
                        )
                        hidden_behind = np.float32(np.inf)
                        for v in range(block_v * per, last_v):
                            for u in range(block_u * per, last_u):
                                hidden_behind = min(hidden_behind, farthest[v, u])
                        if _largest(planes, t, blocks, block_v, block_u) < hidden_behind:
                            continue
                        for v in range(block_v * per, last_v):
                            for u in range(block_u * per, last_u):
                                _draw_tile(
                                    t, planes, v, u, rays, tiles, inverse_depth_bits, triangles, farthest,
                                    farthest_bits, changed,
                                )  # fmt: skip


@inlined
def _outside(planes: NDArray[np.float32], t: int, cones: NDArray[np.float32], v: int, u: int) -> bool:
    """Return True where a cone lies beyond an edge of a triangle."""
    cosine, sine = cones[v, u, 3], cones[v, u, 4]
    if cosine > 1.0:
        return True
    if cosine <= 0.0:
        return False
    beyond = False
    for edge in range(3):
        x, y, z = planes[t, 3 * edge], planes[t, 3 * edge + 1], planes[t, 3 * edge + 2]
        product = x * cones[v, u, 0] + y * cones[v, u, 1] + z * cones[v, u, 2]
        beyond |= product < -planes[t, SIZES + edge] * sine
    return beyond


@inlined
def _largest(planes: NDArray[np.float32], t: int, cones: NDArray[np.float32], v: int, u: int) -> np.float32:
    """Upper bound of a triangle's inverse depth within a cone."""
    product = (
        planes[t, NEAR_X] * cones[v, u, 0] + planes[t, NEAR_Y] * cones[v, u, 1] + planes[t, NEAR_Z] * cones[v, u, 2]
    )
    if product < 0.0:
        product *= max(cones[v, u, 3], np.float32(0.0))
    return np.float32(product + planes[t, NEAR_SIZE] * cones[v, u, 4])


@inlined
def _draw_tile(
    t: int,
    planes: NDArray[np.float32],
    v: int,
    u: int,
    rays: NDArray[np.float32],
    cones: NDArray[np.float32],
    inverse_depth_bits: NDArray[np.int32],
    triangles: NDArray[np.int32],
    farthest: NDArray[np.float32],
    farthest_bits: NDArray[np.int32],
    changed: NDArray[np.bool_],
) -> None:
    """Draw into a tile, unless all that is seen there is nearer."""
    largest = _largest(planes, t, cones, v, u)
    if largest < farthest[v, u] or _outside(planes, t, cones, v, u):
        return
    if changed[v, u]:
        least = inverse_depth_bits[v, u, 0]
        for n in range(1, TILE_PX * TILE_PX):
            least = min(least, inverse_depth_bits[v, u, n])
        farthest_bits[v, u], changed[v, u] = least, False
        if largest < farthest[v, u]:
            return
    ax, ay, az, bx, by, bz = planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3], planes[t, 4], planes[t, 5]
    cx, cy, cz = planes[t, 6], planes[t, 7], planes[t, 8]
    zero, number, nothing = np.float32(0.0), np.int32(t), np.int32(0)
    xs, ys, zs = rays[v, u, 0], rays[v, u, 1], rays[v, u, 2]
    near_here, seen_here = inverse_depth_bits[v, u], triangles[v, u]
    # Always all of a tile and without branches, for the compiler to take several pixels at once.
    for n in range(TILE_PX * TILE_PX):
        x, y, z = xs[n], ys[n], zs[n]
        i = ax * x + ay * y + az * z
        j = bx * x + by * y + bz * z
        k = cx * x + cy * y + cz * z
        inside = (i >= zero) & (j >= zero) & (k >= zero)
        bits = np.float32(i + j + k).view(np.int32) if inside else nothing
        former, seen = near_here[n], seen_here[n]
        near_here[n] = max(bits, former)
        seen_here[n] = number if bits > former else seen
    changed[v, u] = True


LEAST_MARGIN_PX = 0.05  # around boxes of triangles, beside what the chart is off
NOTHING = -1  # triangle of a pixel that sees the sky


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Visible faces of a camera.

    Attributes:
        planes: (T, 16) float32, columns as in `planes`; of triangles that are not hidden.
        triangles: (H / 8, W / 8, 64) int32, row of what each pixel sees, or NOTHING; tile by tile, see `untiled`.
        inverse_depth: (H / 8, W / 8, 64) float32, 1 / m, 1 over the distance of what is seen; 0 where there is nothing.
    """

    planes: NDArray[np.float32]
    triangles: NDArray[np.int32]
    inverse_depth: NDArray[np.float32]


def find_visible(
    corners_m: NDArray[np.float64],
    lens: Lens,
    *,
    camera_from_world: NDArray[np.float64],
    origin_m: NDArray[np.float64],
    reach_m: float = np.inf,
) -> View:
    """Find out what each pixel sees.

    Args:
        corners_m: (T, 3, 3), m, world.
        lens: of the camera.
        camera_from_world: (3, 3), rotation.
        origin_m: (3,), m, the camera in the world.
        reach_m: what looks small and lies further away is left out.
    """
    count, shape = len(corners_m), (lens.valid.shape[0], lens.valid.shape[1])
    planes, boxes = np.empty((count, COLUMNS), dtype=np.float32), np.empty((count, 4), dtype=np.int16)
    distances_m = np.empty(count, dtype=np.float32)
    find_planes(
        corners_m, camera_from_world, origin_m, lens.chart, 2.0 * lens.chart_error_px + LEAST_MARGIN_PX,
        lens.px_per_rad, lens.widest_rad, reach_m, shape, planes, boxes,
        distances_m, np.empty((3, 3)),
    )  # fmt: skip
    # Roughly from near to far: what is hidden is then found early. The highest bits of single precision are in order.
    seen = np.flatnonzero(boxes[:, 0] != HIDDEN)
    buckets = (distances_m.view(np.int32)[seen] >> DROPPED_BITS).astype(np.uint16)
    order = seen[np.argsort(buckets, kind="stable")].astype(np.int32)
    rows, columns = lens.tiles.shape[:2]
    inverse_depth = np.zeros((rows, columns, TILE_PX * TILE_PX), dtype=np.float32)
    triangles = np.full(inverse_depth.shape, NOTHING, dtype=np.int32)
    farthest, changed = np.zeros((rows, columns), dtype=np.float32), np.zeros((rows, columns), dtype=np.bool_)
    draw(
        planes, boxes, order, lens.tile_rays, lens.regions, lens.blocks, lens.tiles,
        inverse_depth.view(np.int32), triangles, farthest, farthest.view(np.int32), changed,
    )  # fmt: skip
    return View(planes=planes, triangles=triangles, inverse_depth=inverse_depth)

"""Triangles drawn into an image, tile by tile, each into the pixels whose rays pass through it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.synthesis.imaging.compiled import inlined, looped
from bench.synthesis.imaging.lens import BLOCK_PX, REGION_PX, TILE_PX
from bench.synthesis.imaging.planes import BIG, NEAR_SIZE, NEAR_X, NEAR_Y, NEAR_Z, SIZES


@looped
def draw(
    planes: NDArray[np.float32],
    boxes: NDArray[np.int16],
    order: NDArray[np.int32],
    rays: NDArray[np.float32],
    regions: NDArray[np.float32],
    blocks: NDArray[np.float32],
    tiles: NDArray[np.float32],
    nearness_bits: NDArray[np.int32],
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
        nearness_bits: (H / 8, W / 8, 64), 1 / m, 1 over the distance of what is seen; 0 where there is nothing; in
            single precision, read as whole numbers, whose order is the same; changed.
        triangles: (H / 8, W / 8, 64), row of what is seen; changed.
        farthest: (H / 8, W / 8), at most the nearness of all that is seen in each tile; changed.
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
                        t, planes, v, u, rays, tiles, nearness_bits, triangles, farthest, farthest_bits,
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
                                    t, planes, v, u, rays, tiles, nearness_bits, triangles, farthest,
                                    farthest_bits, changed,
                                )  # fmt: skip


@inlined
def _outside(planes: NDArray[np.float32], t: int, cones: NDArray[np.float32], v: int, u: int) -> bool:
    """Whether a cone lies beyond an edge of a triangle."""
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
    """What a triangle's nearness stays below within a cone."""
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
    nearness_bits: NDArray[np.int32],
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
        least = nearness_bits[v, u, 0]
        for n in range(1, TILE_PX * TILE_PX):
            least = min(least, nearness_bits[v, u, n])
        farthest_bits[v, u], changed[v, u] = least, False
        if largest < farthest[v, u]:
            return
    ax, ay, az, bx, by, bz = planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3], planes[t, 4], planes[t, 5]
    cx, cy, cz = planes[t, 6], planes[t, 7], planes[t, 8]
    zero, number, nothing = np.float32(0.0), np.int32(t), np.int32(0)
    xs, ys, zs = rays[v, u, 0], rays[v, u, 1], rays[v, u, 2]
    near_here, seen_here = nearness_bits[v, u], triangles[v, u]
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

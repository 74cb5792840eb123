"""Triangle that each pixel sees: every triangle is drawn into the pixels whose rays pass through it.

This holds for rays in any direction, so a fisheye image needs neither an image plane nor a cut in front of the camera,
and it is exact where a camera of straight lines would not be.

A ray r passes through a triangle with corners a, b, c, seen from the origin, where r = t (i a + j b + k c) with
i, j, k >= 0 and t > 0. With volume = a . (b x c), i, j and k are the products of r with (b x c), (c x a), (a x b) over
volume, up to the factor 1 / t that is their sum.

Tables of a lens hold the ray of every pixel, and the pixels near a direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel, ray_grid
from bench.geometry import normalise
from bench.machine_code import compiled, inlined

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


@compiled
def chart_error_px(chart: NDArray[np.float32], rays: NDArray[np.float32], valid: NDArray[np.bool_]) -> float:
    """Largest error of the chart over all pixels of an image, in u or v.

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


Number = TypeVar("Number", bound=np.generic)

REGION_PX, BLOCK_PX, TILE_PX = 128, 32, 8  # big triangles are looked for in squares of these sizes
SMALLEST_RAD = 1e-6  # per pixel, next to pixels without a ray


class Projection(NamedTuple):
    """Where a lens shows a triangle.

    Attributes:
        chart: (CHART, CHART, 2) float32, the pixel of every direction, see `direction_chart`.
        chart_error_px: how far the chart is off at most.
        px_per_rad: the largest there is.
        widest_rad: largest angle of a ray off the optical axis.
        height: of the image, px.
        width: of the image, px.
    """

    chart: NDArray[np.float32]
    chart_error_px: float
    px_per_rad: float
    widest_rad: float
    height: int
    width: int


class Tiles(NamedTuple):
    """The rays of a lens tile by tile, and cones around them, see `_cones`.

    Attributes:
        rays: (H / 8, W / 8, 3, 64) float32, the rays of each tile beside each other; 0 where not valid.
        cones: (H / 8, W / 8, 5) float32.
        blocks: (H / 32, W / 32, 5) float32, cones.
        regions: (H / 128, W / 128, 5) float32, cones.
    """

    rays: NDArray[np.float32]
    cones: NDArray[np.float32]
    blocks: NDArray[np.float32]
    regions: NDArray[np.float32]


class DepthImage(NamedTuple):
    """An image while triangles are drawn into it.

    Attributes:
        inverse_depth_bits: (H / 8, W / 8, 64) int32, 1 / m, 1 over the distance of what is seen; 0 where there is
            nothing; in single precision, read as whole numbers, whose order is the same.
        triangles: (H / 8, W / 8, 64) int32, row of what is seen.
        farthest: (H / 8, W / 8) float32, at most the inverse depth of all that is seen in each tile.
        farthest_bits: the same memory, read as whole numbers.
        changed: (H / 8, W / 8) bool, tiles that were drawn into since `farthest` was found.
    """

    inverse_depth_bits: NDArray[np.int32]
    triangles: NDArray[np.int32]
    farthest: NDArray[np.float32]
    farthest_bits: NDArray[np.int32]
    changed: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lens:
    """Lookups of a camera model.

    Attributes:
        valid: (H, W) bool, where the lens sees anything.
        rays: (3, H, W) float32, camera frame, unit length; 0 where not valid.
        along_u: (H, W, 3) float32, change of the ray from pixel to pixel to the right.
        along_v: (H, W, 3) float32, the same downwards.
        across: (2, 3, H, W) float32: times a small change of a ray it gives the change of its pixel.
        off_axis_cos: (H, W) float64, cosine of the angle between the ray and the optical axis.
        projection: where it shows what.
        tiles: rays and cones around them.
        tile_pixel_rad: (H / 8, W / 8, 64) float32, the widths of the pixels of each tile.
    """

    valid: NDArray[np.bool_]
    rays: NDArray[np.float32]
    along_u: NDArray[np.float32]
    along_v: NDArray[np.float32]
    across: NDArray[np.float32]
    off_axis_cos: NDArray[np.float64]
    projection: Projection
    tiles: Tiles
    tile_pixel_rad: NDArray[np.float32]


def lens_of(camera: CameraModel) -> Lens:
    """Build the lookups."""
    grid = ray_grid(camera)
    rays = np.where(grid.valid[..., None], grid.rays_camera, 0.0)
    along_u, along_v = _steps(grid.rays_camera, axis=1), _steps(grid.rays_camera, axis=0)
    pixel_rad = np.maximum(np.linalg.norm(along_u, axis=2), SMALLEST_RAD)
    widest = pixel_rad[grid.valid].max() if grid.valid.any() else SMALLEST_RAD
    narrowest = np.percentile(pixel_rad[grid.valid], 0.1) if grid.valid.any() else SMALLEST_RAD
    rays_by_axis = np.ascontiguousarray(np.moveaxis(rays, 2, 0), dtype=np.float32)
    chart = direction_chart(camera)
    return Lens(
        valid=grid.valid,
        rays=rays_by_axis,
        along_u=along_u.astype(np.float32),
        along_v=along_v.astype(np.float32),
        across=_across(along_u, along_v),
        off_axis_cos=rays[..., 2],
        projection=Projection(
            chart=chart,
            chart_error_px=chart_error_px(chart, rays_by_axis, grid.valid),
            px_per_rad=float(1.0 / narrowest),
            widest_rad=float(np.arccos(np.clip(rays[..., 2][grid.valid].min(initial=1.0), -1.0, 1.0))),
            height=camera.height,
            width=camera.width,
        ),
        tiles=Tiles(
            np.ascontiguousarray(_squares(rays, TILE_PX).swapaxes(2, 3), dtype=np.float32),
            *(_cones(rays, size_px, widest) for size_px in (TILE_PX, BLOCK_PX, REGION_PX)),
        ),
        tile_pixel_rad=_squares(pixel_rad[..., None], TILE_PX)[..., 0].astype(np.float32),
    )


def untiled(tiled: NDArray[Number], shape: tuple[int, int]) -> NDArray[Number]:
    """Bring an image that lies tile by tile, (H / 8, W / 8, 64), into rows, (H, W)."""
    rows, columns = tiled.shape[:2]
    whole = tiled.reshape(rows, columns, TILE_PX, TILE_PX).swapaxes(1, 2).reshape(rows * TILE_PX, columns * TILE_PX)
    return np.ascontiguousarray(whole[: shape[0], : shape[1]])


def _steps(rays_camera: NDArray[np.float64], *, axis: int) -> NDArray[np.float64]:
    """Change of the ray from pixel to pixel along an image axis; 0 next to pixels without one."""
    steps = np.gradient(rays_camera, axis=axis)
    return np.asarray(cv2.blur(np.nan_to_num(steps), (3, 3)), dtype=np.float64)


def _across(along_u: NDArray[np.float64], along_v: NDArray[np.float64]) -> NDArray[np.float32]:
    """The dual of the two steps, by the inverse of their 2 x 2 matrix of products."""
    uu, uv, vv = (np.einsum("hwi,hwi->hw", a, b) for a, b in ((along_u,) * 2, (along_u, along_v), (along_v,) * 2))
    area = uu * vv - uv * uv
    scale = np.where(area > SMALLEST_RAD**4, 1.0 / np.maximum(area, SMALLEST_RAD**4), 0.0)
    dual_u = (vv * scale)[..., None] * along_u - (uv * scale)[..., None] * along_v
    dual_v = (uu * scale)[..., None] * along_v - (uv * scale)[..., None] * along_u
    return np.ascontiguousarray(np.moveaxis(np.stack([dual_u, dual_v]), 3, 1), dtype=np.float32)


def _cones(rays: NDArray[np.float64], size_px: int, widest_rad: float) -> NDArray[np.float32]:
    """A cone around all rays of each square of pixels: axis, then cosine and sine of its half angle.

    Squares without a ray have a cosine of 2.
    """
    squares = _squares(rays, size_px)
    sums = squares.sum(axis=2)
    filled = np.linalg.norm(sums, axis=-1) > 0
    axes = normalise(np.where(filled[..., None], sums, (0.0, 0.0, 1.0)))
    products = np.where((squares != 0).any(axis=-1), np.einsum("rcni,rci->rcn", squares, axes), 1.0)
    half_rad = np.arccos(np.clip(products.min(axis=2), -1.0, 1.0)) + widest_rad
    half_rad = np.minimum(half_rad, np.pi)
    cosine = np.where(filled, np.cos(half_rad), 2.0)
    return np.concatenate(
        [axes, cosine[..., None], np.sin(np.minimum(half_rad, np.pi / 2))[..., None]], axis=-1
    ).astype(np.float32)


def _squares(image: NDArray[np.float64], size_px: int) -> NDArray[np.float64]:
    """Values of an image, (H, W, N), in each square of pixels, (rows, columns, size_px ** 2, N); 0 beyond it."""
    height, width, depth = image.shape
    padded = np.zeros((-(-height // size_px) * size_px, -(-width // size_px) * size_px, depth))
    padded[:height, :width] = image
    squares = padded.reshape(padded.shape[0] // size_px, size_px, padded.shape[1] // size_px, size_px, depth)
    return squares.swapaxes(1, 2).reshape(squares.shape[0], squares.shape[2], -1, depth)


SMALL = 0.3  # chord of the longest edge on the unit sphere, of triangles that are looked for by their corners
BOW = 0.35  # rad of sagitta per rad^2 of edge length: straight edges bow in a fisheye image by less than this
LEAST_MARGIN_PX = 0.05  # around boxes of triangles, beside twice what the chart is off
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
    projection: Projection,
    reach_m: float,
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
        projection: of the lens.
        reach_m: what looks small and lies further away is left out.
        planes: (T, 16), filled, columns as above.
        boxes: (T, 4), filled: first and last column, first and last row; or HIDDEN or BIG.
        distances_m: (T,), filled: of the nearest corner; where not hidden.
        seen: (3, 3), scratch space.
    """
    height, width, chart = projection.height, projection.width, projection.chart
    least_cos = np.cos(projection.widest_rad)
    least_margin_px = 2.0 * projection.chart_error_px + LEAST_MARGIN_PX
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
                margin = least_margin_px + BOW * projection.px_per_rad * chord2
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
    lens: Tiles,
    image: DepthImage,
) -> None:
    """Draw triangles into an image.

    Args:
        planes: (T, 16), see `find_planes`.
        boxes: (T, 4).
        order: (S,), in which to draw.
        lens: its rays and cones.
        image: changed.
    """
    regions, blocks, tiles = lens.regions, lens.blocks, lens.cones
    up, per = REGION_PX // BLOCK_PX, BLOCK_PX // TILE_PX
    for n in range(len(order)):
        t = order[n]
        left, right, top, bottom = boxes[t, 0], boxes[t, 1], boxes[t, 2], boxes[t, 3]
        if left != BIG:
            for v in range(top // TILE_PX, bottom // TILE_PX + 1):
                for u in range(left // TILE_PX, right // TILE_PX + 1):
                    _draw_tile(t, planes, v, u, lens, image)
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
                                hidden_behind = min(hidden_behind, image.farthest[v, u])
                        if _largest(planes, t, blocks, block_v, block_u) < hidden_behind:
                            continue
                        for v in range(block_v * per, last_v):
                            for u in range(block_u * per, last_u):
                                _draw_tile(t, planes, v, u, lens, image)


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
def _draw_tile(t: int, planes: NDArray[np.float32], v: int, u: int, lens: Tiles, image: DepthImage) -> None:
    """Draw into a tile, unless all that is seen there is nearer."""
    largest = _largest(planes, t, lens.cones, v, u)
    if largest < image.farthest[v, u] or _outside(planes, t, lens.cones, v, u):
        return
    if image.changed[v, u]:
        least = image.inverse_depth_bits[v, u, 0]
        for n in range(1, TILE_PX * TILE_PX):
            least = min(least, image.inverse_depth_bits[v, u, n])
        image.farthest_bits[v, u], image.changed[v, u] = least, False
        if largest < image.farthest[v, u]:
            return
    ax, ay, az, bx, by, bz = planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3], planes[t, 4], planes[t, 5]
    cx, cy, cz = planes[t, 6], planes[t, 7], planes[t, 8]
    zero, number, nothing = np.float32(0.0), np.int32(t), np.int32(0)
    xs, ys, zs = lens.rays[v, u, 0], lens.rays[v, u, 1], lens.rays[v, u, 2]
    near_here, seen_here = image.inverse_depth_bits[v, u], image.triangles[v, u]
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
    image.changed[v, u] = True


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
    count = len(corners_m)
    planes, boxes = np.empty((count, COLUMNS), dtype=np.float32), np.empty((count, 4), dtype=np.int16)
    distances_m = np.empty(count, dtype=np.float32)
    scratch = np.empty((3, 3))
    find_planes(corners_m, camera_from_world, origin_m, lens.projection, reach_m, planes, boxes, distances_m, scratch)
    # Roughly from near to far: what is hidden is then found early. The highest bits of single precision are in order.
    seen = np.flatnonzero(boxes[:, 0] != HIDDEN)
    buckets = (distances_m.view(np.int32)[seen] >> DROPPED_BITS).astype(np.uint16)
    order = seen[np.argsort(buckets, kind="stable")].astype(np.int32)
    rows, columns = lens.tiles.cones.shape[:2]
    inverse_depth = np.zeros((rows, columns, TILE_PX * TILE_PX), dtype=np.float32)
    triangles = np.full(inverse_depth.shape, NOTHING, dtype=np.int32)
    farthest, changed = np.zeros((rows, columns), dtype=np.float32), np.zeros((rows, columns), dtype=np.bool_)
    image = DepthImage(inverse_depth.view(np.int32), triangles, farthest, farthest.view(np.int32), changed)
    draw(planes, boxes, order, lens.tiles, image)
    return View(planes=planes, triangles=triangles, inverse_depth=inverse_depth)

"""Tables of a lens for the renderer: the ray of every pixel, and the pixels near a direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel, ray_grid
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
        chart: (CHART, CHART, 2) float32, the pixel of every direction, see `direction_chart`.
        chart_error_px: how far the chart is off at most.
        px_per_rad: the largest there is.
        widest_rad: largest angle of a ray off the optical axis.
        regions: (H / 128, W / 128, 5) float32, see `_cones`.
        blocks: (H / 32, W / 32, 5) float32.
        tiles: (H / 8, W / 8, 5) float32.
        tile_rays: (H / 8, W / 8, 3, 64) float32, the rays of each tile beside each other; 0 where not valid.
        tile_pixel_rad: (H / 8, W / 8, 64) float32, the widths of the pixels of each tile.
    """

    valid: NDArray[np.bool_]
    rays: NDArray[np.float32]
    along_u: NDArray[np.float32]
    along_v: NDArray[np.float32]
    across: NDArray[np.float32]
    off_axis_cos: NDArray[np.float64]
    chart: NDArray[np.float32]
    chart_error_px: float
    px_per_rad: float
    widest_rad: float
    regions: NDArray[np.float32]
    blocks: NDArray[np.float32]
    tiles: NDArray[np.float32]
    tile_rays: NDArray[np.float32]
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
        chart=chart,
        chart_error_px=chart_error_px(chart, rays_by_axis, grid.valid),
        px_per_rad=float(1.0 / narrowest),
        widest_rad=float(np.arccos(np.clip(rays[..., 2][grid.valid].min(initial=1.0), -1.0, 1.0))),
        regions=_cones(rays, REGION_PX, widest),
        blocks=_cones(rays, BLOCK_PX, widest),
        tiles=_cones(rays, TILE_PX, widest),
        tile_rays=np.ascontiguousarray(_squares(rays, TILE_PX).swapaxes(2, 3), dtype=np.float32),
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

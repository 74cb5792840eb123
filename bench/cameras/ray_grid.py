"""The rays of a camera's pixels or cells, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel
from bench.errors import ShapeError

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RayGrid:
    """Rays through the centres of square cells that tile the image from its first pixel.

    Attributes:
        cell_size_px: side of a cell; 1 for every pixel.
        pixels: (rows, columns, 2) float64, px, centre (u, v) of each cell. The last row and column may reach
            over the image's border where its size is no multiple of the cell.
        rays_camera: (rows, columns, 3) float64, unit rays; NaN where not valid.
        valid: (rows, columns) bool.
    """

    cell_size_px: int
    pixels: NDArray[np.float64]
    rays_camera: NDArray[np.float64]
    valid: NDArray[np.bool_]

    def at_centres(self, image: NDArray[Scalar]) -> NDArray[Scalar]:
        """An image's values at the centres of the cells, of border cells at the nearest pixel.

        Args:
            image: (H, W) of the camera's size.

        Returns:
            (rows, columns), the image's dtype.
        """
        height, width = image.shape
        rows = np.minimum(self.pixels[:, 0, 1].astype(np.intp), height - 1)
        columns = np.minimum(self.pixels[0, :, 0].astype(np.intp), width - 1)
        return image[np.ix_(rows, columns)]


@lru_cache(maxsize=16)
def ray_grid(camera: CameraModel, cell_size_px: int = 1) -> RayGrid:
    """The lookup of rays of a camera.

    Args:
        camera: any camera model; equal cameras share one lookup.
        cell_size_px: side of the square cells, px.

    Raises:
        ShapeError: a cell size below 1.
    """
    if cell_size_px < 1:
        raise ShapeError(f"cell_size_px: expected at least 1, got {cell_size_px}")
    middle = (cell_size_px - 1) / 2
    u = np.arange(0, camera.width, cell_size_px) + middle
    v = np.arange(0, camera.height, cell_size_px) + middle
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    rays, valid = camera.unproject(pixels.reshape(-1, 2))
    shape = pixels.shape[:2]
    grid = RayGrid(
        cell_size_px=cell_size_px, pixels=pixels, rays_camera=rays.reshape(*shape, 3), valid=valid.reshape(shape)
    )
    for array in (grid.pixels, grid.rays_camera, grid.valid):
        array.flags.writeable = False
    return grid

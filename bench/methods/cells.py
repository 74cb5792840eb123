"""What methods on cells share: where a cell's content was, and what could be seen of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.cameras import CameraModel, RayGrid


def flow_rays(
    camera: CameraModel, cells: RayGrid, flow: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Rays of each cell's content in the previous image.

    Args:
        camera: the lens.
        cells: of the current image.
        flow: (rows, columns, 2) float32, px, from the current to the previous image.

    Returns:
        rays_previous: (rows, columns, 3) float64, unit rays, previous camera frame; NaN where the lens has none.
        seen: (rows, columns) bool; inside the lens's field and the image, both times.
    """
    pixels = (cells.pixels + flow).reshape(-1, 2)
    rays, valid = camera.unproject(pixels)
    seen = (valid & camera.contains(pixels)).reshape(cells.valid.shape)
    return rays.reshape(cells.rays_camera.shape), seen & cells.valid


def seen_at_centres(image: NDArray[np.bool_], cells: RayGrid) -> NDArray[np.bool_]:
    """An image's mask, (H, W) bool, at the cells' centres: (rows, columns) bool."""
    height, width = image.shape
    rows = np.minimum(cells.pixels[:, 0, 1].astype(np.intp), height - 1)
    columns = np.minimum(cells.pixels[0, :, 0].astype(np.intp), width - 1)
    return image[np.ix_(rows, columns)]


def flow_parts(flow: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Flow, (rows, columns, 2), as the two parts that pictures look for."""
    return {"flow_u": flow[..., 0], "flow_v": flow[..., 1]}

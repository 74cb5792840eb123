"""Parts that methods with dense flow share: flow on cells, and where each cell's content was in the previous image."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bench.cameras import RayGrid
from bench.flow import flow_on_cells
from bench.methods.contract import MethodInput


def cell_flow(
    frame: MethodInput, flow: str, parameters: Mapping[str, object], cell_size_px: int
) -> NDArray[np.float32]:
    """Flow from the current to the previous image, which methods share.

    Args:
        frame: of the current image.
        flow: name of the dense flow, see `bench.flow.DENSE_FLOWS`.
        parameters: what the flow takes.
        cell_size_px: side of the cells.

    Returns:
        (rows, columns, 2) float32, px, mean over each cell.
    """
    now, before = frame.images[-1], frame.images[-2]
    return flow_on_cells(now, before, flow=flow, parameters=parameters, cell_size_px=cell_size_px)


def flow_rays(
    frame: MethodInput, cells: RayGrid, flow: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Rays of each cell's content in the previous image.

    Args:
        frame: of the current image.
        cells: of the current image.
        flow: (rows, columns, 2) float32, px, from the current to the previous image.

    Returns:
        rays_previous: (rows, columns, 3) float64, unit rays, previous camera frame; NaN where the lens has none.
        seen: (rows, columns) bool; inside the lens's field and the image, both times, and valid in the current one.
    """
    pixels = (cells.pixels + flow).reshape(-1, 2)
    rays, valid = frame.camera.unproject(pixels)
    seen = (valid & frame.camera.contains(pixels)).reshape(cells.valid.shape) & cells.valid
    return rays.reshape(cells.rays_camera.shape), seen & cells.at_centres(frame.valid)


def flow_parts(flow: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Flow, (rows, columns, 2), as the two parts that pictures look for."""
    return {"flow_u": flow[..., 0], "flow_v": flow[..., 1]}

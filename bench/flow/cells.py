"""Averages over square cells."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError


def cell_mean(values: NDArray[np.float32], cell_size_px: int) -> NDArray[np.float32]:
    """Mean over square cells that tile the image from its first pixel.

    Where the image's size is no multiple of the cell, the border pixels are repeated to fill the last cells.

    Args:
        values: (H, W) or (H, W, C) float32.
        cell_size_px: side of a cell, px.

    Returns:
        (ceil(H / cell), ceil(W / cell)[, C]) float32.

    Raises:
        ShapeError: a cell size below 1.

    Source:
        Mariotti and Eising 2020, section III-A: flow averaged on a 5 x 5 pixel grid.
    """
    if cell_size_px < 1:
        raise ShapeError(f"cell_size_px: expected at least 1, got {cell_size_px}")
    height, width = values.shape[:2]
    rows, columns = -(-height // cell_size_px), -(-width // cell_size_px)
    below, right = rows * cell_size_px - height, columns * cell_size_px - width
    if below or right:
        values = np.asarray(cv2.copyMakeBorder(values, 0, below, 0, right, cv2.BORDER_REPLICATE), dtype=np.float32)
    return np.asarray(cv2.resize(values, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)

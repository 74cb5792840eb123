"""The host's own body in an image, drawn by hand in a card."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Polygon = tuple[tuple[float, float], ...]


def body_mask(size_px: tuple[int, int], polygons: Sequence[Polygon]) -> NDArray[np.bool_] | None:
    """Fill polygons.

    Args:
        size_px: (width, height) of the stored images.
        polygons: corners (u, v) in stored pixels.

    Returns:
        (height, width) bool, True inside; None without polygons.
    """
    if not polygons:
        return None
    filled = np.zeros((size_px[1], size_px[0]), dtype=np.uint8)
    for polygon in polygons:  # one call for all leaves out where two overlap
        cv2.fillPoly(filled, [np.rint(polygon).astype(np.int32)], 1)
    return filled.astype(bool)

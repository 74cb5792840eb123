"""Exact masks made wrong in known ways: outlines that are off, and whole objects or parts that lack or are added."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
FEET = 0.2  # of an object's rows


def reshaped(mask: Mask, shape: str) -> Mask:
    """The mask of an object, not empty, as it is, as its hull or bounding box, its upper half or its lowest fifth."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    found = mask.astype(np.uint8)
    if shape == "hull":
        cv2.fillConvexPoly(found, cv2.convexHull(cv2.findNonZero(found)), 1)
    elif shape == "box":
        found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = 1
    elif shape == "upper_half":
        found[(rows[0] + rows[-1]) // 2 + 1 :] = 0
    elif shape == "feet":
        found[: rows[-1] + 1 - max(round(FEET * (rows[-1] + 1 - rows[0])), 1)] = 0
    return found > 0


def grown(mask: Mask, by_px: int) -> Mask:
    """The mask grown in a disc; shrunk for a negative number."""
    size = 2 * abs(by_px) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    change = cv2.dilate if by_px > 0 else cv2.erode
    return np.asarray(change(mask.astype(np.uint8), disc) > 0)


def shifted(mask: Mask, by_px: int) -> Mask:
    """The mask moved to the right; what leaves the image is gone."""
    return _mapped(mask, [[1.0, 0.0, by_px], [0.0, 1.0, 0.0]])


def with_ghost(mask: Mask, widths: float) -> Mask:
    """The mask of an object, not empty, and a copy of it to the right, so many of its widths away."""
    columns = np.flatnonzero(mask.any(axis=0))
    return mask | shifted(mask, round(widths * int(columns[-1] + 1 - columns[0])))


def with_shadow(mask: Mask, length: float) -> Mask:
    """The mask of an object, not empty, and a shadow that begins at its lowest row and falls down and to the right.

    Args:
        mask: (H, W) bool.
        length: of the shadow, over the object's height.
    """
    lowest = int(np.flatnonzero(mask.any(axis=1))[-1])
    return mask | _mapped(mask, [[1.0, -length, length * lowest], [0.0, -length, (1 + length) * lowest]])


def merged(masks: Sequence[Mask], within_px: int) -> list[Mask]:
    """The masks of objects, not empty, and for every two that are at most so far apart the convex hull of both."""
    away_px = [cv2.distanceTransform((~mask).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for mask in masks]
    pairs = [(one, other) for other in range(len(masks)) for one in range(other)]
    near = [masks[one] | masks[other] for one, other in pairs if away_px[one][masks[other]].min() <= within_px]
    return [*masks, *(reshaped(both, "hull") for both in near)]


def _mapped(mask: Mask, matrix: list[list[float]]) -> Mask:
    size_px = (mask.shape[1], mask.shape[0])
    return np.asarray(cv2.warpAffine(mask.view(np.uint8), np.array(matrix), size_px, flags=cv2.INTER_NEAREST) > 0)

"""How well a region that was made from lidar points covers what the camera really sees of an object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionFit:
    """A region against a mask; both hold at least one pixel.

    Attributes:
        iou: |region n mask| / |region u mask|.
        missing: share of the mask that the region leaves out.
        surplus: pixels of the region outside the mask, over |mask|.
        boundary_px: mean distance from the outline of either to the outline of the other, px.
        centroid_px: distance between their centroids, px.
        filled_iou: IoU with the mask whose holes are filled, such as those between the spokes of a wheel.
        solid: |mask| / |filled mask|: about the best IoU that a polygon without holes can reach.
    """

    iou: float
    missing: float
    surplus: float
    boundary_px: float
    centroid_px: float
    filled_iou: float
    solid: float

    @property
    def area_error(self) -> float:
        """(|region| - |mask|) / |mask|: positive for a region that is too large."""
        return self.surplus - self.missing


def region_fit(region: Mask, mask: Mask) -> RegionFit:
    """Compare a region with a mask.

    Args:
        region: (H, W) bool, not empty.
        mask: (H, W) bool, not empty.
    """
    window = _window(region | mask)
    region, mask = region[window], mask[window]
    both, size, covered = _count(region & mask), _count(mask), _count(region)
    assert size, "the object is seen"
    assert covered, "the object has a region"
    filled = _filled(mask)
    return RegionFit(
        iou=both / (size + covered - both),
        missing=(size - both) / size,
        surplus=(covered - both) / size,
        boundary_px=_outline_distance_px(region, mask),
        centroid_px=float(np.linalg.norm(_centroid(region) - _centroid(mask))),
        filled_iou=_count(region & filled) / _count(region | filled),
        solid=size / _count(filled),
    )


def _count(mask: Mask) -> int:
    return int(np.count_nonzero(mask))


def _filled(mask: Mask) -> Mask:
    """The mask with every pixel that its outer outlines enclose."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros(mask.shape, np.uint8), outlines, -1, 1, cv2.FILLED) > 0)


def _window(mask: Mask) -> tuple[slice, slice]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _centroid(mask: Mask) -> NDArray[np.float64]:
    return np.array([np.mean(places) for places in np.nonzero(mask)])


def _outline_distance_px(first: Mask, second: Mask) -> float:
    outlines = [_outline(mask) for mask in (first, second)]
    distances = [cv2.distanceTransform((~line).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
                 for line in outlines]  # fmt: skip
    there, back = distances[1][outlines[0]].mean(), distances[0][outlines[1]].mean()
    return float((there + back) / 2)


def _outline(mask: Mask) -> Mask:
    """Pixels of the mask with a 4-neighbour outside of it."""
    framed = np.pad(mask, 1)
    inner = framed[:-2, 1:-1] & framed[2:, 1:-1] & framed[1:-1, :-2] & framed[1:-1, 2:]
    return mask & ~inner

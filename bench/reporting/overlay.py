"""Fast overlays of masks and polygons on an image, for galleries; no figure, no fonts, only OpenCV."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import LinearRing, Polygon

from bench.errors import ShapeError
from bench.reference.records import ReferenceFrame, Status
from bench.reporting.canvas import GREEN, category_colour, rgb

_SHIFT = 4  # fractional bits of OpenCV's drawing coordinates


def overlay_mask(
    image: NDArray[np.uint8], *, mask: NDArray[np.bool_], colour: str = GREEN, strength: float = 0.5
) -> NDArray[np.uint8]:
    """Tint the pixels of a mask.

    Args:
        image: (H, W) grey or (H, W, 3) BGR uint8.
        mask: (H, W) bool.
        colour: "#rrggbb".
        strength: 0 leaves the image, 1 paints it over.

    Returns:
        (H, W, 3) BGR uint8, a new image.

    Raises:
        ShapeError: mask and image differ in size.
    """
    if mask.shape != image.shape[:2]:
        raise ShapeError(f"mask: expected {image.shape[:2]}, got {mask.shape}")
    tinted = _bgr(image)
    tinted[mask] = ((1 - strength) * tinted[mask] + strength * np.array(rgb(colour)[::-1])).astype(np.uint8)
    return tinted


def overlay_polygons(
    image: NDArray[np.uint8], *, polygons: Sequence[Polygon], colours: Sequence[str], thickness: int = 1
) -> NDArray[np.uint8]:
    """Outline polygons, given in pixels with the first pixel's centre at (0, 0), to a sixteenth of a pixel.

    Returns:
        (H, W, 3) BGR uint8, a new image.
    """
    drawn = _bgr(image)
    for polygon, colour in zip(polygons, colours, strict=True):
        rings = [_fixed_point(ring) for ring in (polygon.exterior, *polygon.interiors) if not ring.is_empty]
        cv2.polylines(drawn, rings, True, rgb(colour)[::-1], thickness, cv2.LINE_AA, _SHIFT)
    return drawn


def overlay_frame(
    image: NDArray[np.uint8], *, reference: ReferenceFrame, detected: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """The detection tinted, the evaluated objects outlined in the colour of their kind of motion.

    Returns:
        (H, W, 3) BGR uint8, a new image.
    """
    evaluated = [o for o in reference.objects if o.status is Status.EVALUATED and o.polygon is not None]
    return overlay_polygons(
        overlay_mask(image, mask=detected & reference.valid),
        polygons=[o.polygon for o in evaluated if o.polygon is not None],
        colours=[category_colour(o.category) for o in evaluated],
        thickness=2,
    )


def _bgr(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy(), dtype=np.uint8)


def _fixed_point(ring: LinearRing) -> NDArray[np.int32]:
    corners: NDArray[np.float64] = np.asarray(ring.coords)[:, :2]
    fixed: NDArray[np.int32] = np.round(corners * 2**_SHIFT).astype(np.int32)
    return fixed

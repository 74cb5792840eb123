"""One frame as a picture of a video: true and false areas tinted, reference polygons, lidar points, a line of text."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import affine_transform

from bench.evaluation.counts import count_frame
from bench.harness import ProcessedFrame
from bench.reference.records import Status
from bench.reporting.canvas import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE, category_colour
from bench.reporting.count_view import PixelClass, pixel_classes
from bench.reporting.lidar_pixels import SeenSweep
from bench.reporting.overlay import overlay_mask, overlay_polygons

NEAREST_M, FARTHEST_M = 2.0, 40.0
TINT = 0.45
LEAST_WIDTH_PX = 640  # smaller images are enlarged, or nobody can read the line
LINE_PX = 26
TINTS = {
    PixelClass.TRUE_POSITIVE: TRUE_POSITIVE,
    PixelClass.FALSE_NEGATIVE: FALSE_NEGATIVE,
    PixelClass.FALSE_POSITIVE: FALSE_POSITIVE,
}


def draw_frame(processed: ProcessedFrame, seen: SeenSweep | None = None) -> NDArray[np.uint8]:
    """Draw a processed frame.

    Args:
        processed: the frame.
        seen: its lidar sweep, if it is to be drawn; near points are yellow, far ones blue.

    Returns:
        (H, W, 3) BGR uint8 of even sides, the image with a line of text below.
    """
    height, width = processed.reference.valid.shape
    reference = processed.reference
    detected = processed.segmentation.mask_at(width, height) & reference.valid
    classes = pixel_classes(reference, detected=detected)
    picture = processed.pixels
    for kind, colour in TINTS.items():
        picture = overlay_mask(picture, mask=classes == kind, colour=colour, strength=TINT)
    scale = max(1, -(-LEAST_WIDTH_PX // width))
    picture = np.repeat(np.repeat(picture, scale, axis=0), scale, axis=1)
    if seen is not None:
        picture = _with_points(picture, seen, scale)
    shown = [o for o in reference.objects if o.status is Status.EVALUATED and o.polygon is not None]
    picture = overlay_polygons(
        picture,
        polygons=[_scaled(o.polygon, scale) for o in shown if o.polygon is not None],
        colours=[category_colour(o.category) for o in shown],
        thickness=2,
    )
    frame, objects = count_frame(reference, detected, component_size_px=0)
    tp, fn = sum(o.tp for o in objects), sum(o.fn for o in objects)
    text = f"{processed.image.timestamp_ns / 1e9:.3f} s   TP {tp}  FN {fn}  FP {frame.fp_px} px   {len(shown)} objects"
    return _captioned(picture, text)


def draw_plain(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """An image that could not be scored, of the size that `draw_frame` gives, with the reason."""
    scale = max(1, -(-LEAST_WIDTH_PX // image.shape[1]))
    bgr = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image
    return _captioned(np.repeat(np.repeat(np.asarray(bgr, dtype=np.uint8), scale, axis=0), scale, axis=1), text)


def _with_points(picture: NDArray[np.uint8], seen: SeenSweep, scale: int) -> NDArray[np.uint8]:
    share = np.clip(np.log(seen.range_m / NEAREST_M) / np.log(FARTHEST_M / NEAREST_M), 0.0, 1.0)
    levels = np.round(255 * (1.0 - share)).astype(np.uint8)
    colours = np.asarray(cv2.applyColorMap(levels[:, None], cv2.COLORMAP_VIRIDIS), dtype=np.uint8).reshape(-1, 3)
    places = np.round((seen.pixels + 0.5) * scale - 0.5).astype(np.int64)
    order = np.argsort(-seen.range_m)  # near points over far ones
    drawn = picture.copy()
    rows = np.clip(places[order, 1], 0, picture.shape[0] - 1)
    columns = np.clip(places[order, 0], 0, picture.shape[1] - 1)
    drawn[rows, columns] = colours[order]
    return drawn


def _scaled(polygon: Polygon, scale: int) -> Polygon:
    shift = 0.5 * scale - 0.5
    return affine_transform(polygon, [scale, 0, 0, scale, shift, shift])


def _captioned(picture: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    height, width = picture.shape[:2]
    framed = np.zeros((height + LINE_PX + (height + LINE_PX) % 2, width + width % 2, 3), dtype=np.uint8)
    framed[:height, :width] = picture
    shown = "".join(c if c.isascii() and c.isprintable() else "?" for c in text)
    cv2.putText(framed, shown, (6, height + 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return framed

"""The areas that a frame is scored by: what each pixel counts as, and its colour over the image."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from bench.errors import ShapeError
from bench.evaluation.counts import count_frame
from bench.harness import ProcessedFrame
from bench.records.reference import ReferenceFrame
from bench.reporting import canvas
from bench.reporting.overlay import overlay_areas, unknown_bands


class PixelClass(IntEnum):
    """Class that a pixel counts as; every pixel has exactly one."""

    OUTSIDE = 0  # not in V
    BACKGROUND = 1  # in V, neither reference nor detection
    TRUE_POSITIVE = 2
    FALSE_NEGATIVE = 3
    FALSE_POSITIVE = 4
    IGNORED = 5
    UNKNOWN = 6  # in an unknown band: may be the object's, counts neither way


AREA_COLOURS = {
    PixelClass.TRUE_POSITIVE: canvas.GREEN,
    PixelClass.FALSE_NEGATIVE: canvas.SKY_BLUE,
    PixelClass.FALSE_POSITIVE: canvas.VERMILION,
    PixelClass.UNKNOWN: canvas.YELLOW,
}
AREA_NAMES = {
    PixelClass.TRUE_POSITIVE: "found",
    PixelClass.FALSE_NEGATIVE: "missed",
    PixelClass.FALSE_POSITIVE: "wrongly marked",
    PixelClass.UNKNOWN: "unknown band, counts neither way",
}


def detected_pixels(processed: ProcessedFrame) -> NDArray[np.bool_]:
    """(H, W) bool, where the method marks motion in a processed frame, within V."""
    height, width = processed.reference.valid.shape
    return processed.segmentation.mask_at(width, height) & processed.reference.valid


def pixel_classes(reference: ReferenceFrame, *, detected: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Say of every pixel what it counts as.

    Args:
        reference: the frame's reference.
        detected: (H, W) bool; the method's mask at every pixel.

    Returns:
        (H, W) uint8 of `PixelClass`.

    Raises:
        ShapeError: `detected` has another size than the reference.
    """
    if detected.shape != reference.labels.shape:
        raise ShapeError(f"detected: expected {reference.labels.shape}, got {detected.shape}")
    region = reference.labels > 0
    classes = np.full(region.shape, PixelClass.BACKGROUND, dtype=np.uint8)
    classes[detected] = PixelClass.FALSE_POSITIVE
    classes[reference.ignored] = PixelClass.IGNORED
    classes[unknown_bands(reference) > 0] = PixelClass.UNKNOWN
    classes[region & detected] = PixelClass.TRUE_POSITIVE
    classes[region & ~detected] = PixelClass.FALSE_NEGATIVE
    classes[~reference.valid] = PixelClass.OUTSIDE
    return classes


def areas_of(classes: NDArray[np.uint8]) -> dict[str, NDArray[np.bool_]]:
    """The areas that a frame is scored by, (H, W) bool, by their colour."""
    return {colour: classes == kind for kind, colour in AREA_COLOURS.items()}


def overlay_counts(processed: ProcessedFrame) -> NDArray[np.uint8]:
    """The image of a processed frame with the areas that it is scored by tinted, (H, W, 3) BGR uint8."""
    classes = pixel_classes(processed.reference, detected=detected_pixels(processed))
    return overlay_areas(processed.pixels, areas_of(classes), strength=0.45)


def false_positive_text(processed: ProcessedFrame) -> str:
    """For example "false positives 12.3 % of the image"."""
    frame, _ = count_frame(processed.reference, detected_pixels(processed), component_size_px=0)
    return f"false positives {100 * frame.fp_px / (frame.width * frame.height):.1f} % of the image"

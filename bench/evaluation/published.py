"""The paper's table, to stand beside ours. Its recordings are private: same form, never the same data."""

from __future__ import annotations

from typing import NamedTuple

from bench.records.reference import Category

AUTHORS = (("Mariotti", "Letizia"), ("Eising", "Ciarán"))  # family name, given name
YEAR = 2020
TITLE = "Spherical formulation of geometric motion segmentation constraints in fisheye cameras"
SOURCE = f"{' and '.join(family for family, _ in AUTHORS)} {YEAR}, {TITLE}"


class PublishedMetrics(NamedTuple):
    """A row of the paper's table.

    Attributes:
        object_frames: the paper's "# Frames"; its rows sum to 8093 over 5000 images, so they are object-frames.
        detection_rate: any pixel of the object.
        tpr: mean coverage of the detected object-frames; to compare with `tpr`.
        iou: to compare with `iou_detected`: 55 % for crossing exceeds detection rate x TPR = 46 %, which bounds the
            mean over all object-frames, so the paper averages over the detected ones.
    """

    object_frames: int
    detection_rate: float
    tpr: float
    iou: float


CATEGORIES = {
    Category.CROSSING: PublishedMetrics(3848, 0.72, 0.64, 0.55),
    Category.OVERTAKING: PublishedMetrics(2757, 0.98, 0.81, 0.70),
    Category.PRECEDING: PublishedMetrics(789, 0.48, 0.30, 0.19),
    Category.APPROACHING: PublishedMetrics(224, 0.89, 0.42, 0.30),
    Category.STATIC_EGO: PublishedMetrics(475, 0.95, 0.78, 0.69),
}
IMAGE_FRAMES = 5000
FALSE_POSITIVE_COVERAGE = 0.13

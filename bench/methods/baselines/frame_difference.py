"""The oldest detector of motion: grey values that changed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import ClassVar

import cv2
import numpy as np

from bench.errors import UsageError
from bench.methods.contract import MethodInput, Segmentation

GREY_LEVELS = 255


@dataclass(frozen=True, kw_only=True)
class FrameDifference:
    """Marks pixels whose grey value differs from the one in the image before.

    Attributes:
        threshold_grey: difference above which a pixel moves, grey levels of 255. The default is what
            `background-subtraction` begins with: four standard deviations of a grey value of variance 15, which OpenCV
            takes for a new background.

    Raises:
        UsageError: a threshold that is not in [0, 255).

    Source:
        Jain and Nagel, On the analysis of accumulative difference pictures, 1979.
    """

    name: ClassVar[str] = "frame-difference"
    history: ClassVar[int] = 1

    threshold_grey: float = 4 * 15**0.5

    def __post_init__(self) -> None:
        if not 0 <= self.threshold_grey < GREY_LEVELS:
            raise UsageError(f"{self.name}: expected threshold_grey in [0, {GREY_LEVELS}), got {self.threshold_grey}")

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result."""
        return asdict(self)

    def segment(self, frame: MethodInput) -> Segmentation:
        """Compare the last image with the one before it."""
        difference = np.where(frame.valid, cv2.absdiff(frame.images[-1], frame.images[-2]), 0)
        return Segmentation(
            cell_size_px=1,
            mask=difference > self.threshold_grey,
            likelihood=difference.astype(np.float32) / np.float32(GREY_LEVELS),
            likelihood_is_score=True,
        )

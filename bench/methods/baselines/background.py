"""Background subtraction: a mixture of Gaussians for every pixel."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import ClassVar

import cv2
import numpy as np

from bench.errors import UsageError
from bench.methods.contract import MethodInput, Segmentation

FOREGROUND, SHADOW = 255, 127


@dataclass(frozen=True, kw_only=True)
class BackgroundSubtraction:
    """Marks pixels that the grey values of the last second do not explain: MOG2 of OpenCV.

    The model is learnt anew for every image, from the images before it, oldest first; so an image's mask depends
    neither on where a drive was cut into pieces nor on what was segmented before. It has no likelihood, since OpenCV
    gives none. Every other parameter is OpenCV's own. It is made for a camera that stands.

    Attributes:
        images: images before the current one that the model learns from, fewer where there are fewer; 15 are one
            second at 15 frames per second. Time grows with their number.
        deviations: a pixel is background within so many standard deviations.
        shadows: whether what is recognised as a shadow is background.

    Raises:
        UsageError: a number that is out of its domain.

    Source:
        Zivkovic 2004; Zivkovic and van der Heijden 2006.
    """

    name: ClassVar[str] = "background-subtraction"
    history: ClassVar[int] = 1

    images: int = 15
    deviations: float = 4.0
    shadows: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.images <= 500 or self.deviations <= 0:
            raise UsageError(f"{self.name}: expected images in 1 to 500 and deviations > 0")

    @property
    def longest_history(self) -> int:
        """Earlier images that it can use."""
        return self.images

    def settings(self) -> dict[str, object]:
        """Every parameter that decides the result."""
        return asdict(self)

    def segment(self, frame: MethodInput) -> Segmentation:
        """Learn from the earlier images, then judge the last one."""
        *earlier, current = frame.images[-self.images - 1 :]
        model = cv2.createBackgroundSubtractorMOG2(
            history=max(self.images, 2), varThreshold=self.deviations**2, detectShadows=self.shadows
        )
        for image in earlier:
            model.apply(image)
        found = np.asarray(model.apply(current, learningRate=0))
        return Segmentation(cell_size_px=1, mask=(found == FOREGROUND) & frame.valid)

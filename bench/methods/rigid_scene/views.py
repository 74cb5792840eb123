"""The images of a method at the two sizes that are worked on."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.contract import MethodInput

FINE_PX = 640  # width about which outlines are drawn, and twice that on which all else is computed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """The images at the two sizes that are worked on.

    Attributes:
        fine: (H, W) uint8 each, of the size of the answer, oldest first.
        given: all that the method is given, with images, lens and valid region at half of that size, rounded down.
        cell_size_px: pixels of the given images for one of the fine ones.
    """

    fine: tuple[NDArray[np.uint8], ...]
    given: MethodInput
    cell_size_px: int

    @classmethod
    def of(cls, frame: MethodInput) -> Views:
        """Those of what a method is given; its images are grey."""
        height, width = frame.valid.shape
        cell = fine_cell_px(width)
        fine_size = -(-width // cell), -(-height // cell)
        size = max(fine_size[0] // 2, 1), max(fine_size[1] // 2, 1)
        fine = tuple(image if cell == 1 else resized(image, fine_size) for image in frame.images)
        given = replace(
            frame,
            images=tuple(resized(image, size) for image in fine),
            camera=frame.camera.scaled(*size),
            valid=resized(frame.valid.astype(np.uint8) * 255, size) > 250,
        )
        return cls(fine=fine, given=given, cell_size_px=cell)


def fine_cell_px(width: int) -> int:
    """Pixels of images of a width for one of those that are worked on."""
    return max(round(width / FINE_PX), 1)


def resized(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """An image at a smaller size (width, height), each pixel the mean of those that it stands for."""
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)

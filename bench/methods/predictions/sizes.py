"""Predictions smaller or larger than the image, brought to the size at which images are evaluated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.methods.predictions.faults import WrongSizeError

Size = tuple[int, int]
LARGEST_PX = 1 << 26  # of one prediction


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSizes:
    """The sizes of an image.

    Attributes:
        evaluated_px: (width, height) at which it is scored.
        stored_px: (width, height) of its file.
    """

    evaluated_px: Size
    stored_px: Size

    def refuse_unfit(self, size_px: Size, *, file: Path, field: str | None = None) -> None:
        """Refuse a size that is no whole fraction or multiple of the image's.

        Raises:
            WrongSizeError: it is not, or larger than any prediction need be.
        """
        got = "{} x {}".format(*size_px)
        bases = (self.evaluated_px, self.stored_px)
        if not any(_times(base, size_px) or _times(size_px, base) for base in bases):
            known = " or ".join(dict.fromkeys("{} x {}".format(*base) for base in bases))
            expected = f"{known} px, or a whole fraction or multiple of it"
            raise WrongSizeError(file, field=field, expected=expected, got=got)
        if size_px[0] * size_px[1] > LARGEST_PX:
            raise WrongSizeError(file, field=field, expected=f"at most {LARGEST_PX} pixels", got=got)


def on_cells(values: NDArray[Any], sizes: ImageSizes) -> tuple[NDArray[np.float32], int]:
    """Bring a map to square cells that tile the evaluated image.

    A map of a whole fraction of the evaluated size stays as it is, each of its pixels a cell. One of a whole multiple
    is averaged over the block of each image pixel. One that fits only the stored size is brought to that by the same
    two rules, and from there to the evaluated size as images are, by their mean over areas.

    Args:
        values: (rows, columns) numbers in [0, 1] or bool, of a size that `ImageSizes.refuse_unfit` lets pass.
        sizes: of the image.

    Returns:
        (rows, columns) float32 in [0, 1], and the side of a cell, px.
    """
    size = values.shape[1], values.shape[0]
    if factor := _times(sizes.evaluated_px, size):
        return values.astype(np.float32, copy=False), factor
    if factor := _times(size, sizes.evaluated_px):
        return _block_mean(values, factor), 1
    if factor := _times(sizes.stored_px, size):
        stored = np.repeat(np.repeat(values.astype(np.float32), factor, axis=0), factor, axis=1)
    else:
        stored = _block_mean(values, _times(size, sizes.stored_px))
    evaluated = cv2.resize(stored, sizes.evaluated_px, interpolation=cv2.INTER_AREA)
    return np.asarray(evaluated, dtype=np.float32), 1


def _times(large: Size, small: Size) -> int:
    """How often `small` goes into `large` along both sides; 0 where it does not."""
    if min(small) < 1 or large[0] % small[0] or large[1] % small[1]:
        return 0
    factor = large[0] // small[0]
    return factor if factor == large[1] // small[1] else 0


def _block_mean(values: NDArray[Any], factor: int) -> NDArray[np.float32]:
    rows, columns = values.shape[0] // factor, values.shape[1] // factor
    blocks = values.reshape(rows, factor, columns, factor)
    means: NDArray[np.float64] = blocks.mean(axis=(1, 3), dtype=np.float64)
    return means.astype(np.float32)

"""A mask or a score map in a PNG file, and how one of another size is brought to the image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.atomic import refuse_escape
from bench.errors import DataError
from bench.plain_text import listed
from bench.recordings.files import read_whole
from bench.recordings.images import PNG_START, decode_values

Size = tuple[int, int]
STATEMENT = "predictions.yaml"  # in a folder of predictions: what they are
LARGEST_BYTES = 1 << 28  # of a file
LARGEST_SCORE = 65535
SHOWN_VALUES = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSizes:
    """The sizes of an image.

    Attributes:
        evaluated_px: (width, height) at which it is scored.
        stored_px: (width, height) of its file.
    """

    evaluated_px: Size
    stored_px: Size

    def refuse_unfit(self, size_px: Size, *, file: Path) -> None:
        """Refuse a size that is no whole fraction or multiple of the image's.

        Raises:
            DataError: it is none.
        """
        bases = (self.evaluated_px, self.stored_px)
        if not any(_times(base, size_px) or _times(size_px, base) for base in bases):
            expected = " or ".join(dict.fromkeys("{} x {}".format(*base) for base in bases))
            expected += " px, or a whole fraction or multiple of it"
            raise DataError(file, expected=expected, got="{} x {}".format(*size_px))

    def on_cells(self, values: NDArray[Any]) -> tuple[NDArray[np.float32], int]:
        """Bring a map to square cells that tile the evaluated image.

        A map of a whole fraction of the evaluated size stays as it is, each of its pixels a cell. One of a whole
        multiple is averaged over the block of each image pixel. One that fits only the stored size is enlarged to that
        where it is smaller, and then scaled to the evaluated size as images are, by its mean over areas.

        Args:
            values: (rows, columns) numbers in [0, 1] or bool, of a size that `refuse_unfit` lets pass.

        Returns:
            (rows, columns) float32 in [0, 1], and the side of a cell, px.
        """
        rows, columns = values.shape
        if cell_px := _times(self.evaluated_px, (columns, rows)):
            return values.astype(np.float32, copy=False), cell_px
        if block := _times((columns, rows), self.evaluated_px):
            blocks = values.reshape(rows // block, block, columns // block, block)
            means: NDArray[np.float64] = blocks.mean(axis=(1, 3), dtype=np.float64)
            return means.astype(np.float32), 1
        enlarged = values.astype(np.float32)
        for axis in (0, 1):
            enlarged = enlarged.repeat(max(_times(self.stored_px, (columns, rows)), 1), axis=axis)
        scaled = cv2.resize(enlarged, self.evaluated_px, interpolation=cv2.INTER_AREA)
        return np.asarray(scaled, dtype=np.float32), 1


def _times(large: Size, small: Size) -> int:
    """Return how often `small` goes into `large` along both sides; 0 where it does not."""
    if min(small) < 1 or large[0] % small[0] or large[1] % small[1]:
        return 0
    factor = large[0] // small[0]
    return factor if factor == large[1] // small[1] else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Files that are named as an image is: one where all is well.

    Attributes:
        root: the folder of predictions; links that lead out of it are not followed.
        files: by one of the image's names each.
        sizes: of the image.
        are_scores: files hold scores of 16 bits, not masks.
    """

    root: Path
    files: tuple[Path, ...]
    sizes: ImageSizes
    are_scores: bool

    def content(self) -> bytes:
        """The bytes of the file.

        Raises:
            DataError: there is none, or several; it is too large or no file.
        """
        if len(self.files) != 1:
            got = " and ".join(file.relative_to(self.root).as_posix() for file in self.files) or "none"
            raise DataError(self.root, expected="one prediction of an image", got=got)
        (file,) = self.files
        refuse_escape(self.root, file, file=file)
        return read_whole(file, expected="a PNG file", largest_bytes=LARGEST_BYTES)

    def values(self, content: bytes) -> NDArray[Any]:
        """Decode the file.

        Args:
            content: of the file.

        Returns:
            (rows, columns) bool, moving; or float32 scores in [0, 1]; of the size at which they are stored.

        Raises:
            DataError: cut short, no grey PNG, of a size that does not fit, or with values of no mask or no scores.
        """
        (file,) = self.files
        values = decode_values(content, file=file)
        if not content.startswith(PNG_START):
            raise DataError(file, expected="a PNG, in which every value is as it was written", got="a JPEG")
        if values.ndim != 2:
            raise DataError(file, expected="one grey channel", got=f"{values.shape[2]} channels")
        self.sizes.refuse_unfit((values.shape[1], values.shape[0]), file=file)
        if self.are_scores:
            if values.dtype != np.uint16:
                expected, hint = f"scores of 16 bits, as {STATEMENT} says", "write masks into a folder of their own"
                raise DataError(file, expected=expected, got="8 bits", hint=hint)
            return values.astype(np.float32) / np.float32(LARGEST_SCORE)
        present = np.unique(values).tolist()
        if values.dtype == np.uint16 or not (set(present) <= {0, 255} or set(present) <= {0, 1}):
            expected = "a mask of 8 bits, of the values 0 and 255, or 0 and 1"
            got = f"{8 * values.itemsize} bits, the values {listed(list(map(str, present)), SHOWN_VALUES)}"
            hint = f"write scores as 16-bit PNG (0 to 65535) with `sixteen_bits: score` in {STATEMENT}"
            raise DataError(file, expected=expected, got=got, hint=hint)
        moving: NDArray[np.bool_] = values > 0
        return moving

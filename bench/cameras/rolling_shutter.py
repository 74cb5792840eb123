"""Rolling shutter: the rows of an image are exposed one after the other.

The time of an image is that of its middle row. Rows are counted as the sensor is mounted: `direction` says which way
the readout moves over the stored image, so that the rows of a sensor mounted on its side are the image's columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bench.cameras.model import CameraModel
from bench.errors import ShapeError

ReadoutDirection = Literal["down", "up", "left", "right"]
LONGEST_READOUT_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class RollingShutter:
    """Readout of a camera whose rows are exposed one after the other.

    Attributes:
        readout_s: number of rows times the time from one row to the next, s. It belongs to the whole image, whatever
            the size at which that is evaluated.
        direction: which way the readout moves over the image; "down" begins with the top row, "left" with the
            rightmost column.

    Raises:
        ShapeError: a readout that is not in (0, 0.2] s, or no direction.
    """

    readout_s: float
    direction: ReadoutDirection = "down"

    def __post_init__(self) -> None:
        if not 0 < self.readout_s <= LONGEST_READOUT_S or math.isnan(self.readout_s):
            raise ShapeError(f"readout_s: expected seconds in (0, {LONGEST_READOUT_S}], got {self.readout_s}")
        if self.direction not in get_args(ReadoutDirection):
            expected = ", ".join(get_args(ReadoutDirection))
            raise ShapeError(f"direction: expected one of {expected}, got {self.direction!r}")

    def row_time_offset_s(self, pixels: NDArray[np.floating], camera: CameraModel) -> NDArray[np.float64]:
        """Time of the pixels' rows after that of the image.

        Args:
            pixels: (..., 2), px, (u, v).
            camera: the lens at the size in which the pixels are counted.

        Returns:
            (...) float64, s, from minus to plus half of the readout, which pixels beyond the image have; 0 for NaN.
        """
        upright = self.direction in {"down", "up"}
        place, size = pixels[..., 1 if upright else 0], camera.height if upright else camera.width
        share = np.clip(np.nan_to_num((place + 0.5) / size - 0.5), -0.5, 0.5)
        return np.asarray((self.readout_s if self.direction in {"down", "right"} else -self.readout_s) * share)

"""Where in the image objects are missed and false positives lie: sums of pixels over images, by camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.evaluation.counts import Regions, count_by_cell

CELL_PX = 8

Grid = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageMap:
    """Sums over the scored images of one camera and size, on square cells that tile the image from its first pixel.

    Attributes:
        camera: name.
        width: of the images, px.
        height: of the images, px.
        cell_px: side of a cell, px.
        frames: images summed.
        reference_px: (rows, columns) int64, pixels of all G.
        missed_px: (rows, columns) int64, pixels of all G minus D.
        false_px: (rows, columns) int64, pixels of D minus (all G u I).
    """

    camera: str
    width: int
    height: int
    cell_px: int
    frames: int
    reference_px: Grid
    missed_px: Grid
    false_px: Grid

    @property
    def missed_rate(self) -> NDArray[np.float64]:
        """(rows, columns) float64, share of the reference's pixels that were missed; NaN where there never were any."""
        seen = self.reference_px > 0
        return np.where(seen, self.missed_px / np.where(seen, self.reference_px, 1), np.nan)

    @property
    def false_rate(self) -> NDArray[np.float64]:
        """(rows, columns) float64, mean share of the cell that was false; NaN without images."""
        area_px = count_by_cell(np.ones((self.height, self.width), dtype=bool), self.cell_px)
        return self.false_px / (area_px * self.frames) if self.frames else np.full(area_px.shape, np.nan)


class ImageMapSums:
    """Adds up the images of one camera and size.

    Args:
        camera: name.
        width: of the images, px.
        height: of the images, px.
    """

    def __init__(self, *, camera: str, width: int, height: int) -> None:
        self._of = (camera, width, height)
        self._frames = 0
        self._reference, self._true, self._false = (
            np.zeros((-(-height // CELL_PX), -(-width // CELL_PX)), dtype=np.int64) for _ in range(3)
        )

    def add(self, regions: Regions) -> None:
        """Take in an image."""
        self._frames += 1
        self._reference += count_by_cell(regions.moving, CELL_PX, window=regions.window)
        self._true += count_by_cell(regions.true, CELL_PX, window=regions.window)
        self._false += count_by_cell(regions.false, CELL_PX)

    def finish(self) -> ImageMap:
        """What came together."""
        camera, width, height = self._of
        return ImageMap(
            camera=camera,
            width=width,
            height=height,
            cell_px=CELL_PX,
            frames=self._frames,
            reference_px=self._reference,
            missed_px=self._reference - self._true,
            false_px=self._false,
        )


def add_image_maps(maps: Iterable[ImageMap]) -> tuple[ImageMap, ...]:
    """Add those of the same camera, size and cell; the order in which they come does not matter.

    Returns:
        One per camera, size and cell, in that order.
    """
    sums: dict[tuple[str, int, int, int], ImageMap] = {}
    for item in maps:
        key = (item.camera, item.width, item.height, item.cell_px)
        sums[key] = _sum(sums[key], item) if key in sums else item
    return tuple(sums[key] for key in sorted(sums))


def _sum(one: ImageMap, other: ImageMap) -> ImageMap:
    return ImageMap(
        camera=one.camera,
        width=one.width,
        height=one.height,
        cell_px=one.cell_px,
        frames=one.frames + other.frames,
        reference_px=one.reference_px + other.reference_px,
        missed_px=one.missed_px + other.missed_px,
        false_px=one.false_px + other.false_px,
    )

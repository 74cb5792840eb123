"""Places in the image where a method was right and wrong: sums over the images of a camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

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

    @classmethod
    def of(cls, regions: Regions, *, camera: str) -> ImageMap:
        """Count one image."""
        height, width = regions.moving.shape
        return cls(
            camera=camera,
            width=width,
            height=height,
            cell_px=CELL_PX,
            frames=1,
            reference_px=count_by_cell(regions.moving, CELL_PX),
            missed_px=count_by_cell(regions.moving & ~regions.true, CELL_PX),
            false_px=count_by_cell(regions.false, CELL_PX),
        )

    def __add__(self, other: ImageMap) -> ImageMap:
        """The sums over the images of both, which are of the same camera, size and cell."""
        return replace(
            self,
            frames=self.frames + other.frames,
            reference_px=self.reference_px + other.reference_px,
            missed_px=self.missed_px + other.missed_px,
            false_px=self.false_px + other.false_px,
        )

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


def add_image_maps(maps: Iterable[ImageMap]) -> tuple[ImageMap, ...]:
    """Add those of the same camera, size and cell; the order in which they come does not matter.

    Returns:
        One per camera, size and cell, in that order.
    """
    sums: dict[tuple[str, int, int, int], ImageMap] = {}
    for item in maps:
        key = (item.camera, item.width, item.height, item.cell_px)
        sums[key] = sums[key] + item if key in sums else item
    return tuple(sums[key] for key in sorted(sums))

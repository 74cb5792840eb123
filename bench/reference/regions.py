"""Pixels of an image that are an object's, and which object they belong to where several overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from bench.geometry.raster import Raster
from bench.records.reference import IgnoreReason, Outline, ReferenceObject, Status


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Region:
    """Pixels of one object by itself, before occlusion.

    Attributes:
        polygon: in pixels (u, v), may reach beyond the image.
        polygon_px: its pixels inside V.
        window: rows and columns of the image that hold all pixels; may be empty.
        core: (rows, columns) bool, of the window; for certain.
        possible: (rows, columns) bool, the core and the band around it.
    """

    polygon: Outline
    polygon_px: int
    window: tuple[slice, slice]
    core: NDArray[np.bool_]
    possible: NDArray[np.bool_]

    @classmethod
    def of(cls, polygon: Outline, raster: Raster) -> Region:
        """A region without a band: all of its pixels, inside V, are certain."""
        pixels = int(np.count_nonzero(raster.covered))
        window, covered = raster
        return cls(polygon=polygon, polygon_px=pixels, window=window, core=covered, possible=covered)


def compose(
    objects: Sequence[ReferenceObject], regions: Sequence[Region | None], valid: NDArray[np.bool_]
) -> tuple[tuple[ReferenceObject, ...], NDArray[np.int32], NDArray[np.bool_], NDArray[np.bool_]]:
    """Give every pixel to the nearest annotated object that covers it.

    Static and ignored objects occlude as well: behind a parked car nothing can be detected. In the band of a nearer
    object it is unknown whether a farther one is seen. An evaluated object of which nothing certain remains becomes
    ignored as occluded.

    Args:
        objects: nearest first.
        regions: their pixels inside V; None for an object out of view.
        valid: (H, W) bool, the region V.

    Returns:
        objects: with `region_px` and `unknown_px` filled in.
        labels: (H, W) int32, k + 1 for pixels of G of object k, else 0.
        ignored: (H, W) bool, the region I: bands, and polygons of ignored objects, minus every G.
        unknown: (H, W) bool, of I the bands of evaluated objects.
    """
    labels = np.zeros(valid.shape, dtype=np.int32)
    ignored, unknown, hidden, uncertain = (np.zeros(valid.shape, dtype=bool) for _ in range(4))
    settled = []
    for number, (found, region) in enumerate(zip(objects, regions, strict=True), start=1):
        if region is None:
            settled.append(found)
            continue
        window, core, possible = region.window, region.core, region.possible
        visible = possible & ~hidden[window]
        certain = core & visible & ~uncertain[window]
        hidden[window] |= core
        uncertain[window] |= possible & ~core
        region_px = int(np.count_nonzero(certain))
        result = found
        if found.status is Status.EVALUATED and region_px:
            band = visible & ~certain
            np.copyto(labels[window], number, where=certain)
            unknown[window] |= band
            result = replace(found, region_px=region_px, unknown_px=int(np.count_nonzero(band)))
        elif found.status is Status.EVALUATED:
            result = replace(found, status=Status.IGNORED, reason=IgnoreReason.OCCLUDED)
        if result.status is Status.IGNORED:
            ignored[window] |= possible & (labels[window] == 0)  # later G begin where this polygon ends
        settled.append(result)
    return tuple(settled), labels, ignored | unknown, unknown


def trace_polygon(covered: NDArray[np.bool_], corner: NDArray[np.int64]) -> Outline | None:
    """The polygon around covered pixels, a quarter of a pixel outside of their centres; of several parts where they do
    not touch.

    Args:
        covered: (rows, columns) bool, of a window.
        corner: (2,) int64, (u, v) of the window's first pixel.

    Returns:
        None where no pixel is covered.
    """
    fine = np.repeat(np.repeat(_without_touching_corners(covered), 2, axis=0), 2, axis=1).view(np.uint8)
    rings, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if not len(rings):
        return None
    outlines: list[Any] = [shapely.linearrings(ring[:, 0] / 2 - 0.25 + corner) for ring in rings]
    parents = tree[0, :, 3].tolist()
    parts: list[Polygon] = [
        shapely.polygons(outline, [outlines[hole] for hole, parent in enumerate(parents) if parent == number] or None)
        for number, outline in enumerate(outlines)
        if parents[number] < 0
    ]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _without_touching_corners(covered: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill the upper one of two gaps where pixels meet at a corner only: there the outline would touch itself."""
    joined = covered.copy()
    upper_left, upper_right = joined[:-1, :-1], joined[:-1, 1:]
    lower_left, lower_right = joined[1:, :-1], joined[1:, 1:]
    while True:
        falling = upper_left & lower_right & ~upper_right & ~lower_left
        rising = upper_right & lower_left & ~upper_left & ~lower_right
        if not (falling.any() or rising.any()):
            return joined
        upper_right |= falling
        upper_left |= rising

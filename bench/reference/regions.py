"""Pixels of an image that are an object's, by kinds of regions, and whose they are where several objects overlap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from bench.records.reference import IgnoreReason, Outline, ReferenceObject, Status
from bench.reference.raster import Raster, rasterise
from bench.reference.scanned import ScannedObject
from bench.reference.silhouette import silhouette


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


def convex_hull(scanned: ScannedObject) -> Region | None:
    """The paper's bounding polygon."""
    return _hull_region(scanned, ratio=None)


def concave_hull(scanned: ScannedObject) -> Region | None:
    """A hull as tight as `ReferenceSettings.concave_ratio` says."""
    return _hull_region(scanned, ratio=scanned.settings.concave_ratio)


def surface_patch_polygon(scanned: ScannedObject) -> Region | None:
    """The union of the surface patches; the concave hull where too few returns lie in rows."""
    likely, corner = scanned.surface.likely, scanned.surface.corner
    polygon = trace_polygon(likely, corner)
    if polygon is None:
        return concave_hull(scanned)
    return Region.of(polygon, scanned.exposure.crop(likely, corner))


SURFACE_PATCHES = "surface-patches"
# The pixels of a scanned object with enough returns, all of them certain; None where these span no area.
REGION_KINDS: dict[str, Callable[[ScannedObject], Region | None]] = {
    "convex": convex_hull,
    "concave": concave_hull,
    SURFACE_PATCHES: surface_patch_polygon,
}


def annotated_outline(scanned: ScannedObject) -> Region | None:
    """The region that shows the annotated shape; of an object whose points are named, the hull of these."""
    if not len(scanned.parts_world):
        return convex_hull(scanned)
    exposure = scanned.exposure
    raster = silhouette(exposure.seen(exposure.camera_from_world.apply(scanned.parts_world)), exposure.camera.model)
    rows, columns = raster.window
    polygon = trace_polygon(raster.covered, np.array([columns.start, rows.start]))
    return None if polygon is None else Region.of(polygon, exposure.in_valid(raster))


def _hull_region(scanned: ScannedObject, *, ratio: float | None) -> Region | None:
    seen, camera = np.isfinite(scanned.pixels[:, 0]), scanned.exposure.camera.model
    pixels = scanned.pixels if seen.all() else scanned.pixels[seen]
    polygon = hull_polygon(pixels, ratio=ratio, width=camera.width, height=camera.height)
    if polygon is None:
        return None
    raster = rasterise(polygon, width=camera.width, height=camera.height)
    return Region.of(polygon, scanned.exposure.in_valid(raster))


def hull_polygon(pixels: NDArray[np.float64], *, ratio: float | None, width: int, height: int) -> Polygon | None:
    """The hull of projected points.

    Args:
        pixels: (N, 2) float64, px, (u, v), finite; may lie outside the image.
        ratio: tightness of a concave hull, 0 to 1; None for the convex hull.
        width: of the image, px.
        height: of the image, px.

    Returns:
        The polygon, cut off one image size beyond the border; None for fewer than three points or points on a line.
    """
    if len(pixels) < 3:
        return None
    row = shapely.linestrings(pixels)  # the hulls take its corners; far faster to build than a MultiPoint
    hull = shapely.convex_hull(row) if ratio is None else shapely.concave_hull(row, ratio=ratio)
    frame = (-width, -height, 2 * width, 2 * height)
    left, top, right, bottom = shapely.bounds(hull).tolist()
    if left < frame[0] or top < frame[1] or right > frame[2] or bottom > frame[3]:  # never for an empty one, all NaN
        hull = max(shapely.get_parts(shapely.clip_by_rect(hull, *frame)), key=lambda part: part.area, default=hull)
    return hull if isinstance(hull, Polygon) and not hull.is_empty else None


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
    for number, (item, region) in enumerate(zip(objects, regions, strict=True), start=1):
        if region is None:
            settled.append(item)
            continue
        window, core, possible = region.window, region.core, region.possible
        visible = possible & ~hidden[window]
        certain = core & visible & ~uncertain[window]
        hidden[window] |= core
        uncertain[window] |= possible & ~core
        region_px = int(np.count_nonzero(certain))
        if item.status is Status.EVALUATED and region_px:
            band = visible & ~certain
            np.copyto(labels[window], number, where=certain)
            unknown[window] |= band
            item = replace(item, region_px=region_px, unknown_px=int(np.count_nonzero(band)))
        elif item.status is Status.EVALUATED:
            item = replace(item, status=Status.IGNORED, reason=IgnoreReason.OCCLUDED)
        if item.status is Status.IGNORED:
            ignored[window] |= possible & (labels[window] == 0)  # later G begin where this polygon ends
        settled.append(item)
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
    if not covered.any():
        return None
    fine = np.repeat(np.repeat(_without_touching_corners(covered), 2, axis=0), 2, axis=1).view(np.uint8)
    rings, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
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

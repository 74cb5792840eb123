"""Kinds of regions by name: how the pixels of a scanned object follow from its returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from typing_extensions import override

from bench.errors import UnknownNameError
from bench.geometry.raster import rasterise
from bench.reference.regions import Region, trace_polygon
from bench.reference.scanned import ScannedObject


class RegionKind(ABC):
    """A kind of region.

    Attributes:
        clears_shape: returns within the ground clearance above the bottom of the annotated shape are always left out,
            not only where the protocol says so.
        follows_outline: it is meant to end where the object ends, so that `audit` asks how well it does.
    """

    clears_shape: ClassVar[bool] = False
    follows_outline: ClassVar[bool] = True

    @abstractmethod
    def region(self, scanned: ScannedObject) -> Region | None:
        """The region of an object with enough returns, all of it certain; None where these span no area."""


class ConvexHull(RegionKind):
    """The paper's bounding polygon."""

    follows_outline: ClassVar[bool] = False

    @override
    def region(self, scanned: ScannedObject) -> Region | None:
        return _hull_region(scanned, ratio=None)


class ConcaveHull(RegionKind):
    """A hull as tight as `ReferenceSettings.concave_ratio` says."""

    @override
    def region(self, scanned: ScannedObject) -> Region | None:
        return _hull_region(scanned, ratio=scanned.settings.concave_ratio)


class SurfacePatches(RegionKind):
    """The union of the surface patches, a surface-patch polygon; the concave hull where too few returns lie in rows."""

    clears_shape: ClassVar[bool] = True

    @override
    def region(self, scanned: ScannedObject) -> Region | None:
        likely, corner = scanned.surface.likely, scanned.surface.corner
        polygon = trace_polygon(likely, corner) if likely.any() else None
        if polygon is None:
            return ConcaveHull().region(scanned)
        return Region.of(polygon, scanned.exposure.crop(likely, corner))


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


REGION_KINDS: dict[str, RegionKind] = {
    "convex": ConvexHull(),
    "concave": ConcaveHull(),
    "surface-patches": SurfacePatches(),
}


def region_kind(name: str) -> RegionKind:
    """The kind of a name.

    Raises:
        UnknownNameError: no such kind.
    """
    if name not in REGION_KINDS:
        raise UnknownNameError("kind of region", name, REGION_KINDS)
    return REGION_KINDS[name]

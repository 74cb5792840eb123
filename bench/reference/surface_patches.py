"""Regions that are the surface which the returns of an object stand for; see `patches`."""

from __future__ import annotations

from typing import ClassVar

from typing_extensions import override

from bench.reference.hulls import ConcaveHull
from bench.reference.kinds import RegionKind
from bench.reference.polygons import trace_polygon
from bench.reference.regions import Region
from bench.reference.scanned import ScannedObject


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

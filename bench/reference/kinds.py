"""Kinds of regions by name: how the pixels of a scanned object follow from its returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from importlib import import_module
from typing import ClassVar

from bench.errors import UnknownNameError
from bench.reference.regions import Region
from bench.reference.scanned import ScannedObject

REGION_KINDS = {
    "convex": "bench.reference.hulls:ConvexHull",  # the paper's bounding polygon
    "concave": "bench.reference.hulls:ConcaveHull",  # a tighter hull
    "surface-patches": "bench.reference.surface_patches:SurfacePatches",  # the surface that each return stands for
}


class RegionKind(ABC):
    """A kind of region.

    Attributes:
        clears_shape: returns within the ground clearance above the bottom of the annotated shape are always left out,
            not only where the protocol says so.
    """

    clears_shape: ClassVar[bool] = False

    @abstractmethod
    def region(self, scanned: ScannedObject) -> Region | None:
        """The region of an object with enough returns, all of it certain; None where these span no area."""


def region_kind(name: str) -> RegionKind:
    """The kind of a name.

    Raises:
        UnknownNameError: no such kind.
    """
    if name not in REGION_KINDS:
        raise UnknownNameError("kind of region", name, REGION_KINDS)
    module, attribute = REGION_KINDS[name].split(":")
    kind: RegionKind = getattr(import_module(module), attribute)()
    return kind

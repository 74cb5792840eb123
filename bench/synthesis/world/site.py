"""Where things may still be put, and what has been put there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from bench.geometry import RigidTransform
from bench.synthesis.mesh import Mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """The static world.

    Attributes:
        mesh: world frame.
        obstacles: footprints, world xy, of everything solid that stands on the road or the pavement or beside them.
    """

    mesh: Mesh
    obstacles: tuple[shapely.Polygon, ...]


class Site:
    """The ground while it is being built on.

    Args:
        keep_clear: world xy, where nothing may stand: the ways of actors and host.
    """

    def __init__(self, keep_clear: Sequence[shapely.Polygon]) -> None:
        self._keep_clear = shapely.union_all(list(keep_clear))
        self._ways = shapely.Point(0, 0) if self._keep_clear.is_empty else self._keep_clear
        shapely.prepare(self._keep_clear)
        self.obstacles: list[shapely.Polygon] = []

    def free(self, footprint: shapely.Polygon) -> bool:
        """Whether nothing stands or moves there."""
        if shapely.intersects(self._keep_clear, footprint):
            return False
        return not (self.obstacles and shapely.intersects(np.array(self.obstacles), footprint).any())

    def claim(self, footprint: shapely.Polygon) -> bool:
        """Take a place if it is free; whether it was."""
        if not self.free(footprint):
            return False
        self.obstacles.append(footprint)
        return True

    def away_m(self, footprint: shapely.Polygon) -> float:
        """Distance to the ways of actors and host; to the world's origin if there are none."""
        return float(shapely.distance(self._ways, footprint))

    def near(self, places_m: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
        """(N,) bool: whether places (N, 2), world xy, lie within a distance of the ways of actors and host."""
        return np.asarray(shapely.dwithin(self._ways, shapely.points(places_m), within_m))


def footprint(at: RigidTransform, low_m: ArrayLike, high_m: ArrayLike) -> shapely.Polygon:
    """A rectangle in a frame that stands upright, seen from above: (2,) lowest and highest x and y."""
    (x0, y0), (x1, y1) = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
    corners = np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
    return shapely.Polygon(at.apply(corners)[:, :2])


def around(mesh: Mesh, at: RigidTransform) -> shapely.Polygon:
    """The rectangle along its axes that a mesh needs in a frame."""
    flat_m = mesh.corners_m[..., :2]
    return footprint(at, flat_m.min(axis=(0, 1)), flat_m.max(axis=(0, 1)))


def spot(at: RigidTransform, radius_m: float) -> shapely.Polygon:
    """A square around the origin of a frame."""
    return footprint(at, [-radius_m, -radius_m], [radius_m, radius_m])

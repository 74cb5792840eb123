"""The ground as triangles: asphalt, pavement, ramps and grass, from their areas on the plan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.synthesis.mesh import Mesh, Surface, surfaced
from bench.synthesis.world.kerbs import KERB_FOOT_M, LOWERED_M
from bench.synthesis.world.materials import GRASS, SOIL
from bench.synthesis.world.plan import KERB_WIDTH_M, RAMP_M, Plan
from bench.synthesis.world.solids import flat

VERGE_M = 0.02  # grass lies lower than the pavement beside it
POLYGON = 3  # as shapely numbers kinds of geometry
CELL_M = 12.0  # large triangles would cost float32 places on the texture

Heights = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def ground(plan: Plan, *, asphalt: Surface, slabs: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Everything flat that the street stands on, each area once."""
    kerb_m = plan.spec.kerb_m
    green = Surface(albedo=float(rng.uniform(0.2, 0.32)), contrast=GRASS.contrast, texel_m=GRASS.texel_m)
    return [
        area_mesh(plan.road, asphalt, height_m=0.0),
        area_mesh(plan.pavement, slabs, height_m=kerb_m),
        area_mesh(plan.median, SOIL, height_m=max(kerb_m, 0.05)),
        area_mesh(plan.verge, green, height_m=kerb_m - VERGE_M),
        *_ramps(plan, slabs),
    ]


def area_mesh(area: BaseGeometry, surface: Surface, *, height_m: float, heights_m: Heights | None = None) -> Mesh:
    """A flat area, or one whose height follows its places.

    Args:
        area: world xy.
        surface: of all of it.
        height_m: above the road.
        heights_m: (N, 2) places -> (N,) heights, instead.
    """
    pieces = shapely.get_parts(_cut(area))
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(pieces[shapely.area(pieces) > 1e-6]))
    if len(triangles) == 0:
        return surfaced(np.empty((0, 3, 3)), surface)
    flat_m = shapely.get_coordinates(shapely.get_exterior_ring(triangles)).reshape(-1, 4, 2)[:, :3]
    one, two = flat_m[:, 1] - flat_m[:, 0], flat_m[:, 2] - flat_m[:, 0]
    clockwise = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0] < 0
    flat_m[clockwise] = flat_m[clockwise][:, ::-1]
    z = height_m if heights_m is None else heights_m(flat_m.reshape(-1, 2)).reshape(-1, 3)
    return surfaced(flat(flat_m, z), surface)


def _cut(area: BaseGeometry) -> BaseGeometry:
    """The area in cells of a grid."""
    if area.is_empty:
        return area
    x0, y0, x1, y1 = area.bounds
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(x0, x1, CELL_M), np.arange(y0, y1, CELL_M)))
    cells = shapely.box(x, y, x + CELL_M, y + CELL_M)
    shapely.prepare(area)
    cells = cells[shapely.intersects(area, cells)]
    inside = shapely.contains(area, cells)
    parts = np.concatenate([cells[inside], shapely.intersection(cells[~inside], area)])
    parts = shapely.get_parts(parts)
    pieces: BaseGeometry = shapely.geometrycollections(parts[shapely.get_type_id(parts) == POLYGON])
    return pieces


def _ramps(plan: Plan, slabs: Surface) -> list[Mesh]:
    """Slopes from the lowered kerb up to the pavement, and the little walls beside them."""
    kerb_m = plan.spec.kerb_m

    def rising(places_m: NDArray[np.float64]) -> NDArray[np.float64]:
        away_m = shapely.distance(plan.road, shapely.points(places_m)) - KERB_WIDTH_M
        return np.asarray(LOWERED_M + (kerb_m - LOWERED_M) * np.clip(away_m / RAMP_M, 0.0, 1.0))

    walls = []
    for polygon in shapely.get_parts(plan.ramps):
        rim_m = shapely.get_coordinates(polygon.exterior)
        low, high = flat(rim_m, rising(rim_m)), flat(rim_m, kerb_m)
        walls += [np.stack([low[:-1], low[1:], high[1:]], axis=1), np.stack([low[:-1], high[1:], high[:-1]], axis=1)]
    slopes = area_mesh(plan.ramps, slabs, height_m=0.0, heights_m=rising)
    return [slopes, *(surfaced(wall[_stands_free(wall, plan)], slabs) for wall in walls)]


def _stands_free(walls_m: NDArray[np.float64], plan: Plan) -> NDArray[np.bool_]:
    """Triangles (T, 3, 3) of walls that have any height, and no kerb before them."""
    edges = walls_m[:, 1:] - walls_m[:, :1]
    area_m2 = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    middles = shapely.points(walls_m[..., :2].mean(axis=1))
    return np.asarray((area_m2 > 1e-6) & (shapely.distance(plan.road, middles) > KERB_WIDTH_M + KERB_FOOT_M))

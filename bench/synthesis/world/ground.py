"""The ground as triangles: asphalt, pavement, ramps, grass, kerb stones, gutters and slabs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.synthesis.mesh import Mesh, Surface, quads, surfaced
from bench.synthesis.world.plan import KERB_WIDTH_M, RAMP_M, Alignment, Plan, Site
from bench.synthesis.world.solids import CONCRETE, GRASS, KERB, SETTS, SOIL, SQUARE, flat

STONE_M = 1.0  # length of a kerb stone
KERB_FOOT_M = 0.02  # kerbs reach this far into the ground
LOWERED_M = 0.025  # height of a lowered kerb, low enough for wheels and high enough for a white cane
GUTTER_M = 0.3
GUTTER_LIFT_M, SLAB_LIFT_M = 0.001, 0.002
SLABS_M = (-12.0, 62.0)  # slabs are laid one by one along this stretch, as far as they can be distinguished
SLABS_SEEN_M = 25.0  # from where ego vehicle and actors drive: a slab farther away is a fifth of a pixel high
JOINT_M = 0.008


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stones:
    """Kerb stones on the plan.

    Attributes:
        starts_m: (N, 2) float64, world xy, on the edge of the road.
        ends_m: (N, 2) float64; the road lies to the left of start to end.
        lowered: (N,) bool.
    """

    starts_m: NDArray[np.float64]
    ends_m: NDArray[np.float64]
    lowered: NDArray[np.bool_]

    @property
    def outwards(self) -> NDArray[np.float64]:
        """(N, 2) unit vectors away from the road."""
        along = self.ends_m - self.starts_m
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        return np.asarray(np.stack([along[:, 1], -along[:, 0]], axis=1))


def laid_stones(plan: Plan) -> Stones:
    """Cut the edges of the road into stones."""
    lines = shapely.get_parts(shapely.segmentize(plan.kerbs, STONE_M))
    steps = [shapely.get_coordinates(line) for line in lines]
    starts = np.concatenate([np.empty((0, 2)), *(step[:-1] for step in steps)])
    ends = np.concatenate([np.empty((0, 2)), *(step[1:] for step in steps)])
    long = np.linalg.norm(ends - starts, axis=1) > 0.02
    starts, ends = starts[long], ends[long]
    middles, along = (starts + ends) / 2, ends - starts
    probe = middles + 0.02 * np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    backwards = ~shapely.contains_xy(plan.road, probe[:, 0], probe[:, 1])
    starts[backwards], ends[backwards] = ends[backwards], starts[backwards].copy()
    lowered = shapely.distance(plan.ramps, shapely.points(middles)) < 2 * KERB_WIDTH_M
    return Stones(starts_m=starts, ends_m=ends, lowered=np.asarray(lowered))


def kerbs(plan: Plan, stones: Stones, rng: np.random.Generator) -> list[Mesh]:
    """Faces and tops of the stones, each of its own shade, and a gutter of setts or concrete."""
    count, out = len(stones.starts_m), stones.outwards
    height = np.where(stones.lowered, min(LOWERED_M, plan.spec.kerb_m), plan.spec.kerb_m)
    shade = KERB.albedo * rng.uniform(0.82, 1.12) * rng.uniform(0.9, 1.1, count)
    shifts = rng.uniform(0, 8, (count, 2))
    foot_a, foot_b = (flat(p, -KERB_FOOT_M) for p in (stones.starts_m, stones.ends_m))
    edge_a, edge_b = (flat(p, height) for p in (stones.starts_m, stones.ends_m))
    back_a, back_b = (flat(p + KERB_WIDTH_M * out, height) for p in (stones.starts_m, stones.ends_m))
    # Seen from the road, which lies to the left of the line from a to b, b is on the left.
    faces = np.stack([foot_b, foot_a, edge_a, edge_b], axis=1)
    tops = np.stack([edge_b, edge_a, back_a, back_b], axis=1)
    meshes = [quads(tops, KERB, albedos=shade, shifts_m=shifts)]
    if plan.spec.kerb_m > 0:
        meshes.append(quads(faces, KERB, albedos=0.94 * shade, shifts_m=shifts))
    if rng.random() < 0.7:
        gutter: Surface = (SETTS, CONCRETE)[int(rng.integers(2))]
        inner = [flat(p - GUTTER_M * out, GUTTER_LIFT_M) for p in (stones.starts_m, stones.ends_m)]
        outer = [flat(p, GUTTER_LIFT_M) for p in (stones.starts_m, stones.ends_m)]
        strip = np.stack([inner[1], inner[0], outer[0], outer[1]], axis=1)
        meshes.append(quads(strip, gutter, albedos=gutter.albedo * rng.uniform(0.9, 1.1, count), shifts_m=shifts))
    return meshes


def paving(plan: Plan, site: Site, slabs: Surface, rng: np.random.Generator) -> list[Mesh]:
    """Slabs of the pavements beside the ego vehicle's street, in courses with joints, each of its own shade."""
    size = np.array([(0.5, 0.5), (0.4, 0.4), (0.6, 0.4), (0.75, 0.5)][int(rng.integers(4))])
    section, width_m = plan.section, min(plan.spec.pavement_m, 3.0)
    meshes = []
    for edge_m, sign in ((section.right_kerb_m, -1.0), (section.left_kerb_m, 1.0)):
        across = edge_m + sign * (KERB_WIDTH_M + np.arange(0.0, width_m - size[1], size[1]) + size[1] / 2)
        cells = _courses(plan.lane, across, size, rng)
        rims = cells.reshape(-1, 2)
        inside = shapely.contains_xy(plan.pavement, rims[:, 0], rims[:, 1]).reshape(-1, 4).all(axis=1)
        cells = cells[inside]
        shade = slabs.albedo * (1.06 + 0.05 * rng.standard_normal(len(cells)))
        shifts = rng.uniform(0, 6, (len(cells), 2))
        seen = site.near(cells.mean(axis=1), SLABS_SEEN_M)
        lifted = flat(cells[seen], plan.spec.kerb_m + SLAB_LIFT_M)
        meshes.append(quads(lifted, slabs, albedos=shade[seen], shifts_m=shifts[seen]))
    return meshes


def _courses(
    lane: Alignment, across_m: NDArray[np.float64], size_m: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Corners of slabs in rows along the lane, every second row half a slab on."""
    along = np.arange(*SLABS_M, size_m[0])
    bonded = 0.5 * size_m[0] * (np.arange(len(across_m)) % 2) * int(rng.integers(2))
    centres = np.stack(np.broadcast_arrays(along[None, :] + bonded[:, None], across_m[:, None]), axis=-1).reshape(-1, 2)
    half = (size_m - JOINT_M) / 2
    return lane.patches(centres, half * SQUARE)


VERGE_M = 0.02  # grass lies lower than the pavement beside it
POLYGON = 3  # as shapely numbers kinds of geometry
CELL_M = 12.0  # large triangles would cost float32 precision of the texture

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
    """A flat area, or one whose height follows its positions.

    Args:
        area: world xy.
        surface: of all of it.
        height_m: above the road.
        heights_m: (N, 2) positions -> (N,) heights, instead.
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

    def rising(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
        away_m = shapely.distance(plan.road, shapely.points(positions_m)) - KERB_WIDTH_M
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

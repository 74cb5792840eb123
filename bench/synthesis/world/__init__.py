"""The static world: everything that never moves.

`build_world` draws a plan (road, kerbs, pavements as polygons), turns it into triangles, wears and paints it, and
puts parked cars, lamps, trees, furniture and fronts where nothing else stands and no actor comes by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from bench.synthesis.mesh import COLUMN_OF, Mesh, Surface, box, joined, quads
from bench.synthesis.scenario import StreetSpec
from bench.synthesis.world.plan import Plan, Site, drawn_plan, ground, kerbs, laid_stones, paving
from bench.synthesis.world.road_surface import markings, wear
from bench.synthesis.world.roadside import (
    fast_road,
    fronts,
    guard_rails,
    lamps,
    parked_cars,
    roadsides,
    street_furniture,
    trees,
)
from bench.synthesis.world.solids import (
    GRASS,
    LEAVES,
    PANE,
    SKY,
    blobs,
    boxes,
    drawn_asphalt,
    drawn_slabs,
    drawn_wall,
    tinted,
)
from bench.synthesis.world.structures import drawn_trees

SKY_RADIUS_M = 500.0
LAND_M = -0.05  # below everything else that is flat
RING_M = (60.0, 260.0)  # where houses and woods stand, from the middle of the street
AWAY_M = 12.0  # and at least so far from it
HOUSES, WOODS = 26, 16


def surroundings(plan: Plan, rng: np.random.Generator) -> list[Mesh]:
    """The sky as a box so far away that it stands still, the land as a plane, and a skyline."""
    r = SKY_RADIUS_M
    sky = box([2 * r, 2 * r, r], [0.0, 0.0, 0.5 * r - 5.0], SKY)
    reach = 0.7 * r
    corners = [[-reach, -reach, LAND_M], [reach, -reach, LAND_M], [reach, reach, LAND_M], [-reach, reach, LAND_M]]
    land = quads(corners, tinted(GRASS, float(rng.uniform(0.85, 1.1))))
    return [sky, land, *_skyline(plan, rng)]


def _skyline(plan: Plan, rng: np.random.Generator) -> list[Mesh]:
    """Blocks and clumps of trees, away from everything that is built in detail."""
    middle = plan.lane.points((plan.lane.begin_m + plan.lane.end_m) / 2, 0.0)[0]
    count = HOUSES + WOODS
    azimuths = np.arange(count) * (2 * np.pi / count) * 7 + rng.normal(0, 0.1, count)
    radii = RING_M[0] + (RING_M[1] - RING_M[0]) * rng.random(count)
    positions = middle + radii[:, None] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
    built = shapely.union(plan.verge, plan.paved)
    free = shapely.distance(built, shapely.points(positions)) > AWAY_M
    houses, woods = positions[:HOUSES][free[:HOUSES]], positions[HOUSES:][free[HOUSES:]]
    meshes = []
    for position in houses:
        size = rng.uniform((9.0, 9.0, 5.0), (24.0, 20.0, 20.0))
        centre = [*position, size[2] / 2 - 0.1]
        yaw = float(rng.uniform(0, np.pi))
        wall = drawn_wall(rng)
        meshes.append(boxes([centre], [size], wall, yaws_rad=[yaw]))
        rows = np.arange(2.2, size[2] - 1.0, 3.2)
        bands = np.stack([np.full(len(rows), position[0]), np.full(len(rows), position[1]), rows], axis=1)
        dark = Surface(albedo=wall.albedo * float(rng.uniform(0.45, 0.8)), contrast=PANE.contrast, texel_m=0.1)
        around = boxes(bands, [size[0] + 0.1, size[1] + 0.1, 1.3], dark, yaws_rad=np.full(len(rows), yaw))
        meshes.append(around.select(np.ptp(around.corners_m[..., 2], axis=1) > 0))  # lids stick out by 5 cm
    if len(woods):
        clumps = np.repeat(woods, 3, axis=0) + rng.normal(0, 6.0, (3 * len(woods), 2))
        size = rng.uniform((4.0, 4.0, 3.5), (8.0, 8.0, 7.0), (len(clumps), 3))
        centres = np.concatenate([clumps, 0.7 * size[:, 2:]], axis=1)
        meshes.append(blobs(centres, size, Surface(albedo=LEAVES.albedo, contrast=0.35, texel_m=0.1), rng))
    return meshes


UNSEEN_M, LEVEL_M = (-1.0, 0.26), 1e-6  # heights of undersides that no camera on a car sees
JOINTS = 0.85  # of the slabs' albedo: what shows between them
# Of a dry dark surface's albedo, under a film of water of refractive index 1.33, which sends all but this share of what
# is scattered below it back down by total reflection (Angstrom 1925, after Lekner and Dorf 1988).
WET_ALBEDO = 1 / 1.33**2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """The static world.

    Attributes:
        mesh: world frame.
        obstacles: footprints, world xy, of everything solid that stands on the road or the pavement or beside them.
    """

    mesh: Mesh
    obstacles: tuple[shapely.Polygon, ...]


def build_world(spec: StreetSpec, rng: np.random.Generator, keep_clear: Sequence[shapely.Polygon] = ()) -> World:
    """Build everything that never moves around the ego vehicle's path.

    The ego vehicle's lane is centred on the world's x axis up to the origin. Each part draws its numbers from a
    generator of its own, so that asking for more trees, say, leaves the road as it is.

    Args:
        spec: what is asked for; the rest is drawn.
        rng: of this recording's world.
        keep_clear: world xy; nothing solid is put where these are: the swept footprints of actors and ego.

    Returns:
        World: the mesh, and the footprints of what is solid.
    """
    plans, surfaces, wears, paints, stones, slabs, far, cars, lit, grown, put, built, fast = rng.spawn(13)
    plan, site = drawn_plan(spec, plans), Site(keep_clear)
    asphalt, paved = drawn_asphalt(surfaces), drawn_slabs(surfaces)
    meshes = surroundings(plan, far)
    porous = ground(plan, asphalt=asphalt, slabs=tinted(paved, JOINTS), rng=surfaces)
    porous += kerbs(plan, laid_stones(plan), stones) + paving(plan, site, paved, slabs)
    porous += wear(plan, asphalt, wears)
    meshes += [_darkened(mesh) for mesh in porous] if spec.wet else porous
    meshes += markings(plan, paints)
    meshes += guard_rails(plan, site)
    meshes += fast_road(plan, site, fast)
    meshes += parked_cars(plan, site, cars)
    sides, forms = roadsides(plan), drawn_trees(grown)
    for side in sides:
        meshes += lamps(plan, side, site, lit)
        meshes += trees(plan, side, site, grown, forms)
    for side in sides:
        meshes += street_furniture(plan, side, site, put)
        meshes += fronts(plan, side, site, built)
    return World(mesh=_without_undersides(joined(*meshes)), obstacles=tuple(site.obstacles))


def _darkened(mesh: Mesh) -> Mesh:
    """The mesh as rain has darkened it."""
    factors = np.ones(mesh.surfaces.shape[1])
    factors[COLUMN_OF["albedo"]] = WET_ALBEDO
    return replace(mesh, surfaces=mesh.surfaces * factors)


def _without_undersides(mesh: Mesh) -> Mesh:
    """The mesh without faces that look straight down at the ground next to them: what stands on it, and parked cars."""
    heights_m = mesh.corners_m[..., 2]
    low = (heights_m > UNSEEN_M[0]).all(axis=1) & (heights_m < UNSEEN_M[1]).all(axis=1)
    # Of a level triangle the z of the vector product is the whole of it; it is negative where the face looks down.
    one_m, two_m = mesh.corners_m[:, 1, :] - mesh.corners_m[:, 0, :], mesh.corners_m[:, 2, :] - mesh.corners_m[:, 0, :]
    level = np.ptp(heights_m, axis=1) < LEVEL_M
    return mesh.select(~(low & level & (one_m[:, 0] * two_m[:, 1] < one_m[:, 1] * two_m[:, 0])))

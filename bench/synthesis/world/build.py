"""The static world, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from bench.synthesis.mesh import Mesh
from bench.synthesis.scenario import StreetSpec
from bench.synthesis.world.greenery import drawn_trees
from bench.synthesis.world.ground import ground
from bench.synthesis.world.kerbs import kerbs, laid_stones, paving
from bench.synthesis.world.markings import markings
from bench.synthesis.world.materials import drawn_asphalt, drawn_slabs, tinted
from bench.synthesis.world.parking import parked_cars
from bench.synthesis.world.plan import drawn_plan
from bench.synthesis.world.roadside import fronts, guard_rails, lamps, roadsides, things, trees
from bench.synthesis.world.site import Site, World
from bench.synthesis.world.solids import assembled
from bench.synthesis.world.surroundings import surroundings
from bench.synthesis.world.wear import wear

UNSEEN_M, LEVEL_M = (-1.0, 0.26), 1e-6  # heights of undersides that no camera on a car sees
JOINTS = 0.85  # of the slabs' albedo: what shows between them


def build_world(spec: StreetSpec, rng: np.random.Generator, keep_clear: Sequence[shapely.Polygon] = ()) -> World:
    """Build everything that never moves around the host's way.

    The host's lane is centred on the world's x axis up to the origin. Each part draws its numbers from a generator of
    its own, so that asking for more trees, say, leaves the road as it is.

    Args:
        spec: what is asked for; the rest is drawn.
        rng: of this recording's world.
        keep_clear: world xy; nothing solid is put where these are: the swept footprints of actors and host.

    Returns:
        World: the mesh, and the footprints of what is solid.
    """
    plans, surfaces, wears, paints, stones, slabs, far, cars, lit, grown, put, built = rng.spawn(12)
    plan, site = drawn_plan(spec, plans), Site(keep_clear)
    asphalt, paved = drawn_asphalt(surfaces), drawn_slabs(surfaces)
    meshes = surroundings(plan, far)
    meshes += ground(plan, asphalt=asphalt, slabs=tinted(paved, JOINTS), rng=surfaces)
    meshes += kerbs(plan, laid_stones(plan), stones) + paving(plan, site, paved, slabs)
    meshes += wear(plan, asphalt, wears) + markings(plan, paints)
    meshes += guard_rails(plan, site)
    meshes += parked_cars(plan, site, cars)
    sides, forms = roadsides(plan), drawn_trees(grown)
    for side in sides:
        meshes += lamps(plan, side, site, lit)
        meshes += trees(plan, side, site, grown, forms)
    for side in sides:
        meshes += things(plan, side, site, put)
        meshes += fronts(plan, side, site, built)
    return World(mesh=_without_undersides(assembled(meshes)), obstacles=tuple(site.obstacles))


def _without_undersides(mesh: Mesh) -> Mesh:
    """The mesh without faces that look straight down at the ground next to them: what stands on it, and parked cars."""
    heights_m = mesh.corners_m[..., 2]
    low = (heights_m > UNSEEN_M[0]).all(axis=1) & (heights_m < UNSEEN_M[1]).all(axis=1)
    # Of a level triangle the z of the vector product is the whole of it; it is negative where the face looks down.
    one_m, two_m = mesh.corners_m[:, 1, :] - mesh.corners_m[:, 0, :], mesh.corners_m[:, 2, :] - mesh.corners_m[:, 0, :]
    level = np.ptp(heights_m, axis=1) < LEVEL_M
    return mesh.picked(~(low & level & (one_m[:, 0] * two_m[:, 1] < one_m[:, 1] * two_m[:, 0])))

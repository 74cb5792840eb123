"""What is far away: the sky, the land, and houses and woods on the horizon."""

from __future__ import annotations

import numpy as np
import shapely

from bench.synthesis.mesh import Mesh, Surface, box, quad
from bench.synthesis.world.materials import GRASS, LEAVES, PANE, SKY, drawn_wall, tinted
from bench.synthesis.world.plan import Plan
from bench.synthesis.world.solids import blobs, boxes

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
    land = quad(corners, tinted(GRASS, float(rng.uniform(0.85, 1.1))))
    return [sky, land, *_skyline(plan, rng)]


def _skyline(plan: Plan, rng: np.random.Generator) -> list[Mesh]:
    """Blocks and clumps of trees, away from everything that is built in detail."""
    middle = plan.lane.points((plan.lane.begin_m + plan.lane.end_m) / 2, 0.0)[0]
    count = HOUSES + WOODS
    azimuths = np.arange(count) * (2 * np.pi / count) * 7 + rng.normal(0, 0.1, count)
    radii = RING_M[0] + (RING_M[1] - RING_M[0]) * rng.random(count)
    places = middle + radii[:, None] * np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
    built = shapely.union(plan.verge, plan.paved)
    free = shapely.distance(built, shapely.points(places)) > AWAY_M
    houses, woods = places[:HOUSES][free[:HOUSES]], places[HOUSES:][free[HOUSES:]]
    meshes = []
    for place in houses:
        size = rng.uniform((9.0, 9.0, 5.0), (24.0, 20.0, 20.0))
        centre = [*place, size[2] / 2 - 0.1]
        yaw = float(rng.uniform(0, np.pi))
        wall = drawn_wall(rng)
        meshes.append(boxes([centre], [size], wall, yaws_rad=[yaw]))
        rows = np.arange(2.2, size[2] - 1.0, 3.2)
        bands = np.stack([np.full(len(rows), place[0]), np.full(len(rows), place[1]), rows], axis=1)
        dark = Surface(albedo=wall.albedo * float(rng.uniform(0.45, 0.8)), contrast=PANE.contrast, texel_m=0.1)
        around = boxes(bands, [size[0] + 0.1, size[1] + 0.1, 1.3], dark, yaws_rad=np.full(len(rows), yaw))
        meshes.append(around.picked(np.ptp(around.corners_m[..., 2], axis=1) > 0))  # lids stick out by 5 cm
    if len(woods):
        clumps = np.repeat(woods, 3, axis=0) + rng.normal(0, 6.0, (3 * len(woods), 2))
        size = rng.uniform((4.0, 4.0, 3.5), (8.0, 8.0, 7.0), (len(clumps), 3))
        centres = np.concatenate([clumps, 0.7 * size[:, 2:]], axis=1)
        meshes.append(blobs(centres, size, Surface(albedo=LEAVES.albedo, contrast=0.35, texel_m=0.1), rng))
    return meshes

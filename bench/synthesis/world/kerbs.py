"""Kerb stones along every edge of the road, the gutter before them, and slabs behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from bench.synthesis.mesh import Mesh, Surface, quads
from bench.synthesis.world.alignment import Alignment
from bench.synthesis.world.materials import CONCRETE, KERB, SETTS
from bench.synthesis.world.plan import KERB_WIDTH_M, Plan
from bench.synthesis.world.site import Site
from bench.synthesis.world.solids import flat

STONE_M = 1.0  # length of a kerb stone
KERB_FOOT_M = 0.02  # kerbs reach this far into the ground
LOWERED_M = 0.025  # height of a lowered kerb, low enough for wheels and high enough for a white cane
GUTTER_M = 0.3
GUTTER_LIFT_M, SLAB_LIFT_M = 0.001, 0.002
SLABS_M = (-12.0, 62.0)  # slabs are laid one by one along this stretch, as far as they can be told apart
SLABS_SEEN_M = 25.0  # from where host and actors drive: a slab farther away is a fifth of a pixel high
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
    # Seen from the road, which lies to the left of the way from a to b, b is on the left.
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
    """Slabs of the pavements beside the host's street, in courses, each of its own shade; joints show between them."""
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
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return lane.patches(centres, np.broadcast_to(corners, (len(centres), 4, 2)))

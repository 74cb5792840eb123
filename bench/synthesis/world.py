"""The static world: a street with markings, kerbs, buildings and lamp posts under a sky."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.geometry import RigidTransform
from bench.synthesis.mesh import Mesh, Surface, box, convex, joined, quad, tube
from bench.synthesis.scenario import StreetSpec

BEHIND_M, AHEAD_M = -40.0, 100.0  # the street that is built, along the host's lane
STEP_M = 5.0  # length of the straight pieces that make the street
BEND_STEP_M = 1.0  # and of those that make it where it bends
LARGEST_TURN_RAD = np.pi / 2  # a bend ends in the side street, or the street would run into itself
VERGE_M = 0.02  # grass lies lower than the pavement, so that the two may overlap inside a bend
KERB_FOOT = np.array([0.0, 0.0, 0.02])  # kerbs reach this far into the ground
PAINT_M = 0.003  # thickness of a marking
SKY_RADIUS_M = 500.0
LINE_M, DASH_M, GAP_M = 0.12, 3.0, 6.0  # markings of a street in town

ASPHALT = Surface(albedo=0.36, contrast=0.25, texel_m=0.006)
PAINT = Surface(albedo=0.80, contrast=0.08, texel_m=0.006)
SLABS = Surface(albedo=0.48, contrast=0.18)
KERB = Surface(albedo=0.58, contrast=0.15)
GRASS = Surface(albedo=0.25, contrast=0.40, texel_m=0.02)
GLAZING = Surface(albedo=0.13, contrast=0.45, texel_m=0.03)
IRON = Surface(albedo=0.30, contrast=0.20)
SKY = Surface(albedo=0.90, contrast=0.04, texel_m=1.5, lit=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """The host's lane: straight up to the world's origin, then an arc, then straight again.

    Attributes:
        curvature_per_m: 1 / radius of the arc, positive to the left.
        bend_m: length of the arc.
    """

    curvature_per_m: float
    bend_m: float

    def place(self, along_m: float, left_m: float) -> RigidTransform:
        """World from a frame at a way along the lane and an offset to its left, x along the lane."""
        arc_m = min(max(along_m, 0.0), self.bend_m)
        turn = self.curvature_per_m * arc_m
        chord_m = arc_m * float(np.sinc(turn / (2 * np.pi)))
        ahead, left = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
        end = chord_m * np.array([np.cos(turn / 2), np.sin(turn / 2), 0.0])
        return RigidTransform.from_yaw(turn, end + (along_m - arc_m) * ahead + left_m * left)

    def inside_of_bend(self, start_m: float, end_m: float, side: int) -> bool:
        """Whether a stretch lies in the arc, on the side of its centre, where fronts would cut the street."""
        return side * self.curvature_per_m > 0 and end_m > 0 and start_m < self.bend_m


def street(spec: StreetSpec, rng: np.random.Generator) -> Mesh:
    """Build the world around the host's way; the host's lane is centred on the world's x axis at the origin."""
    bend_m = LARGEST_TURN_RAD / abs(spec.curvature_per_m) if spec.curvature_per_m else 0.0
    lane = Alignment(curvature_per_m=spec.curvature_per_m, bend_m=min(bend_m, AHEAD_M))
    right_m = -(0.5 + spec.lanes_right) * spec.lane_width_m
    left_m = (0.5 + spec.lanes_left) * spec.lane_width_m
    meshes = [_sky(), _far_ground()]
    meshes += _strip(lane, BEHIND_M, AHEAD_M, right_m, left_m, 0.0, ASPHALT)
    meshes += _markings(lane, spec, right_m, left_m)
    for edge_m, side in ((right_m, -1), (left_m, 1)):
        meshes += _roadside(lane, spec, edge_m, side, rng)
    return joined(meshes)


def _sky() -> Mesh:
    """A box: so far away that it stands still, and with few faces, which every ray has to pass."""
    r = SKY_RADIUS_M
    return box([2 * r, 2 * r, r], [0.0, 0.0, 0.5 * r - 5.0], SKY)


def _far_ground() -> Mesh:
    r = 0.7 * SKY_RADIUS_M
    return quad([[-r, -r, -0.05], [r, -r, -0.05], [r, r, -0.05], [-r, r, -0.05]], GRASS)


def _strip(
    lane: Alignment, start_m: float, end_m: float, right_m: float, left_m: float, height_m: float, surface: Surface
) -> Iterator[Mesh]:
    """A band along the lane, in straight pieces that share their ends."""
    ends = _cuts(lane, start_m, end_m)
    lift = np.array([0.0, 0.0, height_m])
    for a, b in pairwise(ends):
        places = [(a, right_m), (b, right_m), (b, left_m), (a, left_m)]
        yield quad([lane.place(along, left).translation_m + lift for along, left in places], surface)


def _cuts(lane: Alignment, start_m: float, end_m: float) -> NDArray[np.float64]:
    """Where a stretch of street is cut into straight pieces."""
    bounds = np.unique(np.clip([start_m, 0.0, lane.bend_m, end_m], start_m, end_m))
    cuts = [np.array([start_m])]
    for a, b in pairwise(bounds):
        step_m = BEND_STEP_M if 0.0 <= a < lane.bend_m else STEP_M
        cuts.append(np.linspace(a, b, max(1, round((b - a) / step_m)) + 1)[1:])
    return np.concatenate(cuts)


def _markings(lane: Alignment, spec: StreetSpec, right_m: float, left_m: float) -> Iterator[Mesh]:
    half = LINE_M / 2
    for line_m in (right_m + 0.3, left_m - 0.3):
        yield from _strip(lane, BEHIND_M, AHEAD_M, line_m - half, line_m + half, PAINT_M, PAINT)
    for k in range(1, spec.lanes_left + spec.lanes_right + 1):
        line_m = right_m + k * spec.lane_width_m
        for start_m in np.arange(BEHIND_M + 2.0, AHEAD_M - DASH_M, DASH_M + GAP_M):
            yield from _strip(lane, start_m, start_m + DASH_M, line_m - half, line_m + half, PAINT_M, PAINT)


def _roadside(lane: Alignment, spec: StreetSpec, edge_m: float, side: int, rng: np.random.Generator) -> Iterator[Mesh]:
    """Kerb, pavement, lamp posts and buildings of one side; `side` is 1 to the left, -1 to the right."""
    inner_m, outer_m = edge_m + 0.15 * side, edge_m + spec.pavement_m * side
    far_m = edge_m + 40.0 * side
    yield from _kerb(lane, spec, edge_m, inner_m)
    yield from _strip(lane, BEHIND_M, AHEAD_M, min(inner_m, outer_m), max(inner_m, outer_m), spec.kerb_m, SLABS)
    yield from _strip(lane, BEHIND_M, AHEAD_M, min(outer_m, far_m), max(outer_m, far_m), spec.kerb_m - VERGE_M, GRASS)
    for along_m in np.arange(BEHIND_M + rng.uniform(0, 9), AHEAD_M, 18.0):
        at = lane.place(along_m, edge_m + 0.6 * side)
        yield tube([0, 0, 0], [0, 0, 6.0], 0.08, IRON, taper=0.6).moved(at)
    along_m = BEHIND_M
    while spec.buildings and along_m < AHEAD_M:
        length_m = float(rng.uniform(8.0, 15.0))
        if not lane.inside_of_bend(along_m, along_m + length_m, side):
            yield from _building(lane.place(along_m + length_m / 2, outer_m), length_m, side, rng)
        along_m += length_m + float(rng.choice([0.0, 0.0, 3.5]))


def _kerb(lane: Alignment, spec: StreetSpec, edge_m: float, inner_m: float) -> Iterator[Mesh]:
    if spec.kerb_m == 0:
        yield from _strip(lane, BEHIND_M, AHEAD_M, min(edge_m, inner_m), max(edge_m, inner_m), 0.0, SLABS)
        return
    ends = _cuts(lane, BEHIND_M, AHEAD_M)
    for a, b in pairwise(ends):
        feet = np.array([lane.place(s, d).translation_m for s in (a, b) for d in (edge_m, inner_m)])
        yield convex(np.concatenate([feet - KERB_FOOT, feet + np.array([0.0, 0.0, spec.kerb_m])]), KERB)


def _building(front: RigidTransform, length_m: float, side: int, rng: np.random.Generator) -> Iterator[Mesh]:
    """A house whose front stands at y = 0 of its frame, with rows of windows and a door."""
    floors = int(rng.integers(2, 5))
    height_m, depth_m = 3.1 * floors + 0.6, 10.0
    wall = Surface(albedo=float(rng.uniform(0.35, 0.75)), contrast=float(rng.uniform(0.12, 0.25)), texel_m=0.012)
    body = box([length_m, depth_m, height_m], [0.0, side * depth_m / 2, height_m / 2], wall)
    openings = [
        _front_patch(x, 1.0 + 3.1 * floor, (1.2, 1.5), side) for floor in range(floors) for x in _columns(length_m)
    ]
    openings[0] = _front_patch(_columns(length_m)[0], 0.1, (1.1, 2.2), side)
    plinth = box([length_m, 0.08, 0.5], [0.0, -0.04 * side, 0.25], KERB)
    shift = rng.uniform(0, 8, 2)
    yield body.with_texture_shift(shift).moved(front)
    yield plinth.moved(front)
    for opening in openings:
        yield quad(opening, GLAZING).with_texture_shift(rng.uniform(0, 8, 2)).moved(front)


def _columns(length_m: float) -> NDArray[np.float64]:
    count = int(length_m // 2.6)
    return np.asarray((np.arange(count) - (count - 1) / 2) * (length_m / count))


def _front_patch(x_m: float, sill_m: float, size_m: tuple[float, float], side: int) -> ArrayLike:
    """Corners of a patch just before the front, facing the street."""
    x0, x1 = x_m - side * size_m[0] / 2, x_m + side * size_m[0] / 2
    y, top_m = -0.02 * side, sill_m + size_m[1]
    return [[x0, y, sill_m], [x1, y, sill_m], [x1, y, top_m], [x0, y, top_m]]

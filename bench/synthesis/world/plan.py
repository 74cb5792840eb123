"""The ground: lanes, areas of road, kerb and pavement seen from above, what is occupied, and all of it as triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform
from bench.synthesis.mesh import Mesh, Surface, quads, surfaced
from bench.synthesis.scenario import AHEAD_M, BEHIND_M, ZEBRA_M, Side, SideStreetSpec, StreetSpec
from bench.synthesis.world.solids import CONCRETE, GRASS, KERB, SETTS, SOIL, SQUARE, flat

STEP_M = 5.0  # length of the straight pieces that make a street
BEND_STEP_M = 1.0  # and of those that make it where it bends


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alignment:
    """A lane: straight up to its origin, then an arc, then straight again.

    Attributes:
        curvature_per_m: 1 / radius of the arc, positive to the left.
        bend_m: length of the arc.
        world_from_start: the lane's origin in the world, x along the lane.
        begin_m: where what is built begins, along the lane.
        end_m: where it ends.
    """

    curvature_per_m: float = 0.0
    bend_m: float = 0.0
    world_from_start: RigidTransform
    begin_m: float
    end_m: float

    def pose(self, along_m: float, left_m: float, height_m: float = 0.0, *, yaw_rad: float = 0.0) -> RigidTransform:
        """World from a frame beside the lane, x along the lane but for a yaw."""
        x, y = self.points(along_m, left_m)[0]
        forward = self.world_from_start.rotation[:, 0]
        yaw = np.arctan2(forward[1], forward[0]) + self._yaws(np.array([along_m]))[0] + yaw_rad
        return RigidTransform.from_yaw(float(yaw), [float(x), float(y), height_m])

    def points(self, along_m: ArrayLike, left_m: ArrayLike) -> NDArray[np.float64]:
        """(N, 2) float64, m, world, of N distances along the lane and offsets to its left (or one for all)."""
        along, left = np.atleast_1d(along_m).astype(np.float64), np.asarray(left_m, dtype=np.float64)
        x, y = self._bent(along, left) if self.curvature_per_m else (along, left)
        ahead = np.empty((max(x.size, y.size), 2))
        ahead[:, 0], ahead[:, 1] = x, y
        start = self.world_from_start
        return np.asarray(ahead @ start.rotation[:2, :2].T + start.translation_m[:2])

    def _bent(
        self, along_m: NDArray[np.float64], left_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """x and y in the frame of the lane's origin."""
        yaws = self._yaws(along_m)
        arcs = np.clip(along_m, 0.0, self.bend_m)
        chords = arcs * np.sinc(yaws / (2 * np.pi))
        beyond = along_m - arcs
        x = chords * np.cos(yaws / 2) + beyond * np.cos(yaws) - left_m * np.sin(yaws)
        y = chords * np.sin(yaws / 2) + beyond * np.sin(yaws) + left_m * np.cos(yaws)
        return x, y

    def cells(self, start_m: float, end_m: float, right_m: float, left_m: float) -> NDArray[np.float64]:
        """(N, 4, 2) float64, m, world: a band along the lane, cut into straight pieces that share their ends."""
        cuts = self.cuts(start_m, end_m)
        return self.pieces(cuts[:-1], cuts[1:], right_m, left_m)

    def pieces(
        self, starts_m: NDArray[np.float64], ends_m: NDArray[np.float64], right_m: float, left_m: float
    ) -> NDArray[np.float64]:
        """(N, 4, 2) float64, m, world: short stretches of a band along the lane."""
        corners = ((starts_m, right_m), (ends_m, right_m), (ends_m, left_m), (starts_m, left_m))
        return np.stack([self.points(along, left) for along, left in corners], axis=1)

    def cuts(self, start_m: float, end_m: float) -> NDArray[np.float64]:
        """Positions at which a stretch is cut into straight pieces, ends included."""
        bounds = np.unique(np.clip([start_m, 0.0, self.bend_m, end_m], start_m, end_m))
        cuts = [np.array([start_m])]
        for a, b in pairwise(bounds):
            step_m = BEND_STEP_M if 0.0 <= a < self.bend_m else STEP_M
            cuts.append(np.linspace(a, b, max(1, int(np.ceil((b - a) / step_m))) + 1)[1:])
        return np.concatenate(cuts)

    def patches(self, centres_m: ArrayLike, corners_m: ArrayLike) -> NDArray[np.float64]:
        """Small flat shapes beside the lane.

        Args:
            centres_m: (N, 2), m, along the lane and to its left.
            corners_m: (N, K, 2), m, about each centre, x along the lane; (K, 2) for all.

        Returns:
            (N, K, 2) float64, m, world.
        """
        centres = np.asarray(centres_m, dtype=np.float64).reshape(-1, 2)
        corners = np.asarray(corners_m, dtype=np.float64)
        forward = self.world_from_start.rotation[:, 0]
        yaws = np.arctan2(forward[1], forward[0]) + self._yaws(centres[:, 0])
        cosine, sine = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
        x, y = corners[..., 0], corners[..., 1]
        rotated = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        return np.asarray(rotated + self.points(centres[:, 0], centres[:, 1])[:, None])

    def _yaws(self, along_m: NDArray[np.float64]) -> NDArray[np.float64]:
        if not self.curvature_per_m:
            return np.zeros_like(along_m)
        return self.curvature_per_m * np.clip(along_m, 0.0, self.bend_m)


class Site:
    """The ground while it is being built on.

    Args:
        keep_clear: world xy, where nothing may stand: the ground that actors and ego vehicle cover.
    """

    def __init__(self, keep_clear: Sequence[shapely.Polygon]) -> None:
        self._keep_clear = shapely.union_all(list(keep_clear))
        self._paths = shapely.Point(0, 0) if self._keep_clear.is_empty else self._keep_clear
        shapely.prepare(self._keep_clear)
        self.obstacles: list[shapely.Polygon] = []

    def free(self, footprint: shapely.Polygon) -> bool:
        """Return True where the area is free of obstacles and paths."""
        if shapely.intersects(self._keep_clear, footprint):
            return False
        return not (self.obstacles and shapely.intersects(np.array(self.obstacles), footprint).any())

    def claim(self, footprint: shapely.Polygon) -> bool:
        """Occupy an area if it is free; whether it was."""
        if not self.free(footprint):
            return False
        self.obstacles.append(footprint)
        return True

    def away_m(self, footprint: shapely.Polygon) -> float:
        """Distance to the paths of actors and ego vehicle; to the world's origin if there are none."""
        return float(shapely.distance(self._paths, footprint))

    def near(self, positions_m: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
        """(N,) bool: whether positions (N, 2), world xy, lie close to the paths of actors and ego vehicle."""
        return np.asarray(shapely.dwithin(self._paths, shapely.points(positions_m), within_m))


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


PARKING_M = 2.2  # width of a parking lane: a car and its doors
BAY_M, BAY_WIDTH_M, AISLE_M = 5.0, 2.5, 6.0  # of a car park: bays at a right angle to the aisle
SHOULDER_M, MEDIAN_M = 0.5, 2.0  # of an avenue
KERB_WIDTH_M = 0.15
SIDE_STREET_M = 45.0  # length of a side street
CORNER_RADIUS_M = 3.5  # of the kerb at a corner, for cars at walking pace
RAMP_M = 1.1  # depth of the slope behind a lowered kerb
SIDES: tuple[Side, Side] = ("left", "right")
VERGE_M = 45.0  # width of the grass on both sides


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """The street across: offsets to the left of the ego vehicle's lane, m.

    Attributes:
        right_m: edge of the rightmost lane.
        left_m: edge of the leftmost lane.
        right_kerb_m: where the road ends.
        left_kerb_m: where it ends on the other side.
        right_rows: rows of bays on that side of a car park.
        left_rows: on the other side.
    """

    right_m: float
    left_m: float
    right_kerb_m: float
    left_kerb_m: float
    right_rows: int = 0
    left_rows: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """The ground from above, world axes.

    Attributes:
        spec: what was asked for.
        lane: the ego vehicle's.
        section: across it.
        mouths: side streets, each with its lane, which starts at the kerb of the ego vehicle's street.
        road: asphalt.
        median: between the carriageways of an avenue; empty without one.
        pavement: behind the kerbs, without the ramps.
        ramps: behind lowered kerbs.
        paved: road, kerbs and pavements.
        verge: on both sides of that.
        kerbs: edges of the road that have a kerb.
    """

    spec: StreetSpec
    lane: Alignment
    section: Section
    mouths: tuple[tuple[SideStreetSpec, Alignment], ...]
    road: BaseGeometry
    median: BaseGeometry
    pavement: BaseGeometry
    ramps: BaseGeometry
    paved: BaseGeometry
    verge: BaseGeometry
    kerbs: BaseGeometry


def drawn_plan(spec: StreetSpec, rng: np.random.Generator) -> Plan:
    """Lay out the ground; the drawn part is how deep a car park is and where drives cross the kerb."""
    lane = Alignment(
        curvature_per_m=spec.curvature_per_m,
        bend_m=spec.bend_m,
        world_from_start=RigidTransform.from_yaw(0.0, [0.0, 0.0, 0.0]),
        begin_m=BEHIND_M,
        end_m=AHEAD_M,
    )
    section = _section(spec, rng)
    mouths = tuple((street, _mouth(lane, section, street)) for street in spec.side_streets)
    whole = (section.right_kerb_m, section.left_kerb_m)
    sides = [(side_lane, -street.width_m / 2, street.width_m / 2) for street, side_lane in mouths]
    road: BaseGeometry = shapely.union_all([band(lane, *whole), *(band(*side) for side in sides)])
    pavements = [band(*side, margin_m=min(spec.pavement_m, 2.5)) for side in sides]
    paved = shapely.union_all([band(lane, *whole, margin_m=spec.pavement_m), *pavements])
    if mouths:  # closing by a disc rounds the corners where streets meet
        road = road.buffer(CORNER_RADIUS_M, quad_segs=6).buffer(-CORNER_RADIUS_M, quad_segs=6)
    ends = [_end(lane, lane.begin_m, *whole), _end(lane, lane.end_m, *whole)]
    ends += [_end(side[0], side[0].end_m, *side[1:]) for side in sides]
    ramps = _ramps(spec, lane, section, mouths, rng)
    kerb = road.buffer(KERB_WIDTH_M, join_style="mitre")
    median: BaseGeometry = shapely.Polygon()
    if spec.kind == "avenue":
        right_m = section.left_m + SHOULDER_M
        median = band(lane, right_m, right_m + MEDIAN_M)
    return Plan(
        spec=spec,
        lane=lane,
        section=section,
        mouths=mouths,
        road=road.difference(median),
        median=median,
        pavement=paved.difference(kerb).difference(ramps),
        ramps=ramps,
        paved=shapely.union(paved, road),
        verge=shapely.union_all([band(lane, *whole, margin_m=VERGE_M)]).difference(paved).difference(road),
        kerbs=shapely.line_merge(road.difference(median).boundary.difference(shapely.union_all(ends))),
    )


def band(lane: Alignment, right_m: float, left_m: float, *, margin_m: float = 0.0) -> BaseGeometry:
    """The ground along a whole lane between two offsets to its left, with a margin on both sides."""
    return cells_area(lane.cells(lane.begin_m, lane.end_m, right_m - margin_m, left_m + margin_m))


def cells_area(cells_m: NDArray[np.float64]) -> BaseGeometry:
    """The ground that (N, 4, 2) cells cover, also where they fold over in the inside of a bend."""
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(list(map(shapely.points, cells_m)))))


def _section(spec: StreetSpec, rng: np.random.Generator) -> Section:
    right_m = -(0.5 + spec.lanes_right) * spec.lane_width_m
    left_m = (0.5 + spec.lanes_left) * spec.lane_width_m
    right_rows, left_rows = (int(n) for n in rng.choice([1, 3], size=2, p=[0.4, 0.6]))
    beyond = {side: PARKING_M if spec.has_parking(side) else 0.0 for side in SIDES}
    if spec.kind == "car_park":
        depth_m = {1: BAY_M, 3: 3 * BAY_M + AISLE_M}  # one row, or two back to back and one across the next aisle
        return Section(
            right_m=right_m, left_m=left_m, right_kerb_m=right_m - depth_m[right_rows],
            left_kerb_m=left_m + depth_m[left_rows], right_rows=right_rows, left_rows=left_rows,
        )  # fmt: skip
    if spec.kind == "avenue":
        lanes = 1 + spec.lanes_left + spec.lanes_right
        beyond["left"] += 3 * SHOULDER_M + MEDIAN_M + lanes * spec.lane_width_m
        beyond["right"] += SHOULDER_M
    return Section(
        right_m=right_m, left_m=left_m, right_kerb_m=right_m - beyond["right"], left_kerb_m=left_m + beyond["left"]
    )


def _mouth(lane: Alignment, section: Section, street: SideStreetSpec) -> Alignment:
    """A side street's lane, from the kerb outwards."""
    edge_m, sign = (section.left_kerb_m, 1) if street.side == "left" else (section.right_kerb_m, -1)
    start = lane.pose(street.at_m, edge_m, yaw_rad=sign * np.pi / 2)
    return Alignment(world_from_start=start, begin_m=-1.0, end_m=SIDE_STREET_M)


def _end(lane: Alignment, along_m: float, right_m: float, left_m: float) -> BaseGeometry:
    """The line across the end of a street, where there is no kerb."""
    line = shapely.LineString(lane.points([along_m, along_m], np.array([right_m, left_m])))
    return line.buffer(0.01, cap_style="square")


Mouths = tuple[tuple[SideStreetSpec, Alignment], ...]


def _ramps(
    spec: StreetSpec, lane: Alignment, section: Section, mouths: Mouths, rng: np.random.Generator
) -> BaseGeometry:
    """Stretches with a lowered kerb: at zebra crossings and at the drives of some houses."""
    drives = rng.uniform(BEHIND_M + 15.0, AHEAD_M - 30.0, (2, 3))
    if spec.kerb_m < 0.05 or spec.kind != "street":
        return shapely.Polygon()
    areas = []
    for edge_m, sign, own in ((section.right_kerb_m, -1, drives[0]), (section.left_kerb_m, 1, drives[1])):
        inner_m, outer_m = edge_m + sign * KERB_WIDTH_M, edge_m + sign * (KERB_WIDTH_M + RAMP_M)
        positions = [(at_m, ZEBRA_M / 2) for at_m in spec.zebra_at_m] + [(float(at_m), 1.6) for at_m in own]
        for at_m, half_m in positions:
            cells = lane.cells(at_m - half_m, at_m + half_m, *sorted((inner_m, outer_m)))
            areas.append(cells_area(cells))
    area = shapely.union_all(areas)
    for street, side_lane in mouths:
        area = area.difference(shapely.LineString(side_lane.points([-3.0, 3.0], 0.0)).buffer(street.width_m / 2 + 5.0))
    return area if spec.pavement_m > RAMP_M + KERB_WIDTH_M + 0.3 else shapely.Polygon()


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


GRASS_M = 0.02  # grass lies lower than the pavement beside it
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
        area_mesh(plan.verge, green, height_m=kerb_m - GRASS_M),
        *_ramp_meshes(plan, slabs),
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


def _ramp_meshes(plan: Plan, slabs: Surface) -> list[Mesh]:
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

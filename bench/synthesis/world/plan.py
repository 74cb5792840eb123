"""The plan of the ground seen from above: lanes, areas of road, kerb and pavement, and what is occupied."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform
from bench.synthesis.mesh import Mesh
from bench.synthesis.scenario import AHEAD_M, BEHIND_M, ZEBRA_M, Side, SideStreetSpec, StreetSpec

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

"""The plan of the ground: what is road, kerb and pavement, as polygons seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from bench.geometry import RigidTransform
from bench.synthesis.scenario import StreetSpec
from bench.synthesis.scenario.recording import AHEAD_M, BEHIND_M, ZEBRA_M, Side, SideStreetSpec
from bench.synthesis.world.alignment import Alignment

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
    """The street across: offsets to the left of the host's lane, m.

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
        lane: the host's.
        section: across it.
        mouths: side streets, each with its lane, which starts at the kerb of the host's street.
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
    road: BaseGeometry = _area([band(lane, *whole), *(band(way, *_half(s)) for s, way in mouths)])
    paved = _area([band(lane, *_wider(*whole, spec.pavement_m)), *_side_pavements(mouths, spec.pavement_m)])
    if mouths:  # closing by a disc rounds the corners where streets meet
        road = road.buffer(CORNER_RADIUS_M, quad_segs=6).buffer(-CORNER_RADIUS_M, quad_segs=6)
    ends = shapely.union_all([_end(way, half_m) for way, half_m in _ends(lane, section, mouths)])
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
        verge=_area([band(lane, *_wider(*whole, VERGE_M))]).difference(paved).difference(road),
        kerbs=shapely.line_merge(road.difference(median).boundary.difference(ends)),
    )


def band(way: Alignment, right_m: float, left_m: float) -> BaseGeometry:
    """The ground along a whole lane between two offsets to its left."""
    return cells_area(way.cells(way.begin_m, way.end_m, right_m, left_m))


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
    edge_m, turn = (section.left_kerb_m, 1) if street.side == "left" else (section.right_kerb_m, -1)
    start = lane.place(street.at_m, edge_m, turned_rad=turn * np.pi / 2)
    return Alignment(world_from_start=start, begin_m=-1.0, end_m=SIDE_STREET_M)


def _half(street: SideStreetSpec) -> tuple[float, float]:
    return -street.width_m / 2, street.width_m / 2


def _wider(right_m: float, left_m: float, by_m: float) -> tuple[float, float]:
    return right_m - by_m, left_m + by_m


def _area(parts: Sequence[BaseGeometry]) -> BaseGeometry:
    return shapely.union_all(list(parts))


Mouths = tuple[tuple[SideStreetSpec, Alignment], ...]


def _side_pavements(mouths: Mouths, pavement_m: float) -> list[BaseGeometry]:
    return [band(way, *_wider(*_half(street), min(pavement_m, 2.5))) for street, way in mouths]


def _ends(
    lane: Alignment, section: Section, mouths: Mouths
) -> list[tuple[tuple[Alignment, float], tuple[float, float]]]:
    whole = (section.right_kerb_m, section.left_kerb_m)
    ends = [((lane, lane.begin_m), whole), ((lane, lane.end_m), whole)]
    return ends + [((way, way.end_m), _half(street)) for street, way in mouths]


def _end(at: tuple[Alignment, float], half_m: tuple[float, float]) -> BaseGeometry:
    """The line across the end of a street, where there is no kerb."""
    way, along_m = at
    return shapely.LineString(way.points([along_m, along_m], np.array(half_m))).buffer(0.01, cap_style="square")


def _ramps(
    spec: StreetSpec, lane: Alignment, section: Section, mouths: Mouths, rng: np.random.Generator
) -> BaseGeometry:
    """Where the kerb is lowered: at zebra crossings and at the drives of some houses."""
    drives = rng.uniform(BEHIND_M + 15.0, AHEAD_M - 30.0, (2, 3))
    if spec.kerb_m < 0.05 or spec.kind != "street":
        return shapely.Polygon()
    areas = []
    for edge_m, sign, own in ((section.right_kerb_m, -1, drives[0]), (section.left_kerb_m, 1, drives[1])):
        inner_m, outer_m = edge_m + sign * KERB_WIDTH_M, edge_m + sign * (KERB_WIDTH_M + RAMP_M)
        places = [(at_m, ZEBRA_M / 2) for at_m in spec.zebra_at_m] + [(float(at_m), 1.6) for at_m in own]
        for at_m, half_m in places:
            cells = lane.cells(at_m - half_m, at_m + half_m, *sorted((inner_m, outer_m)))
            areas.append(cells_area(cells))
    area = shapely.union_all(areas)
    for street, way in mouths:
        area = area.difference(shapely.LineString(way.points([-3.0, 3.0], 0.0)).buffer(street.width_m / 2 + 5.0))
    return area if spec.pavement_m > RAMP_M + KERB_WIDTH_M + 0.3 else shapely.Polygon()
